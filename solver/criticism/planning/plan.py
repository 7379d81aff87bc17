"""A plan: what a survey would know of the fiber before anyone drives, what it could see, what to add."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from solver.catalogue.catalogue import built_in
from solver.criticism.planning.additions import (
    NEAR,
    Addition,
    Known,
    Sigmas,
    Way,
    anchor_options,
    pass_options,
    single,
    ways,
)
from solver.criticism.planning.detectable import Detectable, detectable
from solver.criticism.planning.planned import Planned
from solver.criticism.planning.planned_site import read_planned
from solver.criticism.scorer import Scorer
from solver.effect import Setting
from solver.fit.chain import Chain
from solver.fit.map_fit import MapFit
from solver.fit.posterior import Posterior, assemble
from solver.fit.result import FitResult
from solver.run.strict_json import strict
from vision.contract import InputError, progress, require_writable, writing_into

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from solver.effect import Effect

FORMAT = "roadfiber plan 1"
#: CSS pixels of the figure.
WIDTH = 960


@dataclass(frozen=True, repr=False)
class Plan:
    """A planned survey and what it would know.

    Parameters
    ----------
    planned : the survey
    result : what its fit would report
    wanted : sigmas that are wanted, m; infinite where nothing is
    expected : largest sigmas in view
    alone : what single additions would do, the best first
    ways : additions that lead to the wanted accuracy; none where nothing is wanted, or it is there
    effects : smallest sizes that would show; none where that was not asked
    """

    planned: Planned
    result: FitResult
    wanted: Sigmas
    expected: Sigmas
    alone: tuple[Addition, ...]
    ways: tuple[Way, ...]
    effects: tuple[Detectable, ...]

    @property
    def name(self) -> str:
        """Of the site."""
        return self.planned.site.name

    @cached_property
    def shown(self) -> NDArray[np.bool_]:
        """Which points of the route [channel] are in view."""
        length = self.planned.site.plan.length
        return np.asarray((self.result.distance >= 0) & (self.result.distance <= length))

    @property
    def table(self) -> "pd.DataFrame":
        """Expected sigmas along the fiber: channel, x, y, z (as expected), sigma_x, sigma_y, sigma_z (m), constrained.

        y is across, z in depth.
        """
        import pandas as pd

        route, sigma = self.result.route[self.shown], self.result.sigma[self.shown]
        columns = dict(zip(("x", "y", "z", "sigma_x", "sigma_y", "sigma_z"), np.hstack([route, sigma]).T, strict=True))
        channel, constrained = self.result.channel[self.shown], self.result.constrained[self.shown]
        return pd.DataFrame({"channel": channel} | columns | {"constrained": constrained})

    @property
    def effect_table(self) -> "pd.DataFrame":
        """Effects: name, title, stage, smallest size that would show, unit, usual size, whether it would show."""
        import pandas as pd

        return pd.DataFrame([asdict(one) for one in self.effects], columns=list(Detectable.__dataclass_fields__))

    @property
    def headline(self) -> str:
        """What the survey would know, in a sentence."""
        plan = self.planned.site.plan
        count, anchors = plan.vehicles, len(plan.anchors)
        passes = "one vehicle" if count == 1 else f"{count} vehicles"
        known = {0: "no anchor", 1: "one anchor"}.get(anchors, f"{anchors} anchors")
        return (
            f"Expected from {passes} and {known}: 1 sigma of {self.expected.across:.2f} m across and "
            f"{self.expected.depth:.2f} m in depth at most."
        )

    @property
    def advice(self) -> list[str]:
        """What to add, a line each."""
        if any(np.isfinite((self.wanted.across, self.wanted.depth))):
            return wanted_lines(self)
        return [f"{one.words}: {sigma_words(one.after)}" for one in best_of_kinds(self.alone)]

    @property
    def warnings(self) -> list[str]:
        """What else must be known before the figures are relied on; a line each."""
        plan, result = self.planned.site.plan, self.result
        lines = []
        share = float(np.median(result.data_share[self.shown, 2]))
        if share < 0.5:
            lines.append(
                f"the depth is hardly measured: {100 * (1 - share):.0f} % of what is known of it is the depth expected"
            )
        driven = [lane for lane in plan.lanes if any(lane.vehicles.values())]
        if not plan.anchors and len({lane.y for lane in driven}) == 1:
            lines.append("without an anchor, and with one lane, the fiber may be on either side of the road")
        if len({lane.toward for lane in driven}) == 1:
            lines.append("all vehicles drive one way: an offset of the clocks is taken for a shift of the fiber")
        return lines

    @cached_property
    def facts(self) -> dict[str, Any]:
        """The content of plan.json."""
        found: dict[str, Any] = strict(
            {
                "format": FORMAT,
                "name": self.name,
                "headline": self.headline,
                "expected": asdict(self.expected),
                "wanted": asdict(self.wanted),
                "noise": self.planned.noise,
                "sigmas": self.table.to_dict("list"),
                "warnings": self.warnings,
                "advice": self.advice,
                "single_additions": [asdict(one) for one in self.alone],
                "ways": [asdict(one) for one in self.ways],
                "effects": [asdict(one) for one in self.effects],
                "site": self.planned.site.model_dump(include={"name", "das", "plan", "ground"}),
            }
        )
        return found

    def plot(self, width: int = WIDTH) -> "Figure":
        """Draw the lanes and the expected corridor from above, and the sigmas along the road; width in CSS pixels."""
        from solver.criticism.planning.plan_figure import plan_figure

        return plan_figure(self, width)

    def to_json(self, path: Path | str) -> None:
        """Write plan.json; InputError where it cannot be written."""
        require_writable(Path(path))
        with writing_into(Path(path).parent) as folder:
            (folder / Path(path).name).write_text(self._json, encoding="utf-8")

    def save(self, folder: Path | str) -> None:
        """Write plan.html, plan.json and plan.csv into a folder; InputError where that cannot be."""
        folder = Path(folder)
        require_writable(folder / "plan.html")
        with writing_into(folder) as into:
            (into / "plan.html").write_text(self.page(), encoding="utf-8")
            (into / "plan.json").write_text(self._json, encoding="utf-8")
            self.table.round(4).to_csv(into / "plan.csv", index=False, lineterminator="\n")

    def page(self) -> str:
        """One page that opens offline."""
        from solver.criticism.planning.plan_page import plan_page

        return plan_page(self)

    @property
    def _json(self) -> str:
        return json.dumps(self.facts, allow_nan=False, indent=1)

    def __repr__(self) -> str:
        return f"<Plan {self.name}: {self.headline}>"

    def _repr_html_(self) -> str:
        from vision.contract.notebook import framed

        return framed(self.page())


def sigma_words(sigmas: Sigmas) -> str:
    """Sigmas in words.

    >>> sigma_words(Sigmas(0.05, 0.123))
    '0.050 m across, 0.123 m in depth'
    """
    return f"{sigmas.across:.3f} m across, {sigmas.depth:.3f} m in depth"


def best_of_kinds(additions: Sequence[Addition]) -> list[Addition]:
    """The best pass and the best anchor, the better one first."""
    return list({one.kind: one for one in reversed(additions)}.values())[::-1]


def wanted_lines(plan: Plan) -> list[str]:
    """What leads to the wanted accuracy, a line each."""
    if not plan.ways:
        return ["the wanted accuracy is reached as planned"]
    lines = []
    for way in plan.ways:
        if not way.additions:
            continue
        end = "reaches it" if way.reached else "does not reach it"
        lines.append(f"{counted(way.additions)}: {end}, with {sigma_words(way.additions[-1].after)}")
    return lines or ["neither a pass nor an anchor narrows it any more"]


def counted(additions: Sequence[Addition]) -> str:
    """Additions in words, those that are alike told once.

    >>> sure = Sigmas(0.1, 0.1)
    >>> counted([Addition("pass", "one pass of a car in the lane", sure)] * 2)
    '2 passes of a car in the lane'
    >>> counted([Addition("anchor", f"an anchor near x = {x} m", sure) for x in (60, 10)])
    'anchors near x = 60, 10 m'
    """
    counts = Counter(one.words for one in additions if one.kind == "pass")
    said = [words if n == 1 else words.replace("one pass", f"{n} passes", 1) for words, n in counts.items()]
    places = [one.words for one in additions if one.kind == "anchor"]
    if len(places) > 1:
        numbers = ", ".join(words.removeprefix(NEAR).removesuffix(" m") for words in places)
        places = [f"{NEAR.replace('an anchor', 'anchors')}{numbers} m"]
    return " and ".join([*said, *places])


def plan_survey(
    source: Path | str | Mapping[str, Any],
    *,
    wanted: float | None = None,
    wanted_depth: float | None = None,
    effects: "Sequence[Effect] | None" = None,
) -> Plan:
    """Plan a survey; see `rf.plan`. `effects` are those asked for: the catalogue where None, none where empty."""
    for name, value in (("wanted", wanted), ("wanted_depth", wanted_depth)):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise InputError(f"{name}: {value:g}; give a standard deviation in m, above 0")
    planned = Planned.of(read_planned(source))
    asked = list(built_in().values()) if effects is None else list(effects)
    fit = MapFit(planned.problem)
    chain = Chain.single(fit)
    visit = chain.visit(planned.state)
    result = assemble(
        planned.problem, chain, visit.state, method="plan", iterations=0, seconds=0.0, converged=True, near=visit
    )
    known = Known.of(planned, Posterior(chain, visit))
    limits = Sigmas(wanted or np.inf, wanted_depth or np.inf)
    passes, anchors = pass_options(planned), anchor_options(planned, known)
    expected = known.sigmas
    short = expected.across > limits.across or expected.depth > limits.depth
    told = single(known, [*passes, *anchors])
    return Plan(
        planned=planned,
        result=result,
        wanted=limits,
        expected=expected,
        alone=tuple(told),
        ways=tuple(ways(known, passes, anchors, limits)) if short else (),
        effects=tuple(sizes(planned, Scorer(fit, visit.state), asked)) if asked else (),
    )


def sizes(planned: Planned, scorer: Scorer, effects: "Sequence[Effect]") -> list[Detectable]:
    """Smallest sizes of effects that the survey would show."""
    problem, middle = planned.problem, planned.site.plan.length / 2
    setting = Setting(problem.gauge_length, problem.channel_spacing, x=middle, along=middle)
    with progress("testing effects", len(effects)) as advance:
        return detectable(scorer, effects, setting, advance)
