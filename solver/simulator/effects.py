"""All effects that can be hidden in a simulated survey."""

import zlib
from collections.abc import Mapping

import numpy as np

from solver.simulator.hidden import Hidden, Setting
from solver.simulator.known import KNOWN
from solver.simulator.unknown import UNKNOWN

EFFECTS: dict[str, Hidden] = {**KNOWN, **UNKNOWN}
SETTINGS: dict[str, Setting] = {
    f"{name}_{key}": setting for name, hidden in EFFECTS.items() for key, setting in hidden.settings.items()
}
#: Those that a street of a few cars shows plainly.
SHOWN = ("gauge_length", "pulse_width", "stiffness_contrast", "time_averaging")


def effect_rng(seed: int, name: str) -> np.random.Generator:
    """Random stream of one effect, so that hiding one effect does not change another.

    >>> effect_rng(1, "braking").random() == effect_rng(1, "braking").random()
    True
    """
    return np.random.default_rng([seed, zlib.crc32(name.encode())])


def amount_of(effects: Mapping[str, float], seed: int, name: str) -> float:
    """Amount of an effect (0 if not hidden), or a setting of one (drawn if not given).

    Raises
    ------
    KeyError
        If the name is neither.

    >>> amount_of({"shear_lag": 2.0}, 0, "shear_lag"), amount_of({}, 0, "lowpass_order")
    (2.0, 4.0)
    """
    if name in effects:
        return float(effects[name])
    if name in SETTINGS:
        setting = SETTINGS[name]
        return float(effect_rng(seed, name).uniform(setting.low, setting.high))
    return 0.0 * bool(EFFECTS[name])


def hidden(effects: Mapping[str, float], seed: int) -> dict[str, float]:
    """Every effect that is not absent, each followed by all its settings.

    >>> hidden({"lowpass": 1.5, "braking": 0.0}, 0)
    {'lowpass': 1.5, 'lowpass_order': 4.0, 'lowpass_zero_phase': 0.0}
    """
    names = [name for name in EFFECTS if effects.get(name)]
    keys = (key for name in names for key in (name, *(f"{name}_{setting}" for setting in EFFECTS[name].settings)))
    return {key: amount_of(effects, seed, key) for key in keys}
