"""Small surveys in memory with effects hidden in them by other code than the effects' own, and their diagnosis."""

from collections.abc import Iterable, Mapping
from dataclasses import replace

from simulated import case_of

from solver import simulator
from solver.catalogue.catalogue import FAULTS, built_in
from solver.criticism.diagnosis import diagnose
from solver.criticism.finding import Diagnosis
from solver.fit.pose import with_slow_errors
from solver.fit.problem import Problem


def posed(
    effects: Mapping[str, float], *, passes: int = 2, seed: int = 11, end: float = 30.0, laid: str = "winding"
) -> Problem:
    """A street that the camera sees up to `end`, m, stated as `locate` states it, with effects hidden in its record."""
    street = simulator.Scenario(
        seed=seed, passes=passes, snr_db=25.0, noise="street", view=(0.0, end), effects=dict(effects), laid=laid
    )
    return with_slow_errors(replace(case_of(simulator.simulate(street)).problem, curved=True))


def diagnosed(problem: Problem, names: Iterable[str] | None = None) -> Diagnosis:
    """What a survey lacks, of some effects or of the whole catalogue; faults of the survey are searched for anyway.

    Passes held out are left to the commands.
    """
    known = built_in()
    asked = known.values() if names is None else [known[name] for name in names if name not in FAULTS]
    return diagnose(problem, effects=list(asked), held_out=False)
