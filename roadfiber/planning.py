"""What a survey would know of the fiber, before anyone drives."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from solver.criticism.planning.plan import Plan, plan_survey
from solver.effect import Effect

__all__ = ["Plan", "plan"]


def plan(
    site: Path | str | Mapping[str, Any],
    *,
    wanted: float | None = None,
    wanted_depth: float | None = None,
    effects: Iterable[Effect] | None = None,
) -> Plan:
    """Plan a survey: the sigmas to expect along the fiber, the effects it could see, and what to add.

    Takes the normal equations of the fit at the expected route, so nothing is simulated and nothing is drawn at random
    but how drivers drive.

    Parameters
    ----------
    site : path of a site.toml with `[das] gauge_length` and a table `[plan]`, the folder of one, or the same content as
        a mapping; no other file is needed
    wanted, wanted_depth : standard deviation that is wanted across and in depth everywhere in view, m; None: any
    effects : that may be missing, for which the smallest size that would show is computed; the catalogue's where None,
        and none where empty, which takes seconds instead of half a minute

    Returns
    -------
    plan : its `table` of sigmas, `effect_table`, `advice`, `plot()`, `save()`, `to_json()`

    Raises
    ------
    InputError
        If the site cannot be planned; says which key, and how to mend it.

    Examples
    --------
    >>> lanes = [{"y": 0.0, "toward": "+x", "vehicles": {"car": 2, "truck": 1}}]
    >>> section = {"length": 40.0, "offset": 4.0, "snr_db": 15.0, "lanes": lanes, "sampling_rate": 5.0}
    >>> planned = rf.plan({"das": {"gauge_length": 10.0}, "plan": section}, wanted=0.06, effects=[])
    >>> planned.advice[0].partition(":")[0]
    '2 passes of a truck in the lane (y 0 m, toward +x) and one pass of a car in the lane (y 0 m, toward +x)'
    """
    chosen = None if effects is None else list(effects)
    return plan_survey(site, wanted=wanted, wanted_depth=wanted_depth, effects=chosen)
