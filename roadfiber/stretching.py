"""Stretches of a long fiber: each a run of its own, and what all of them lack."""

import json
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from roadfiber.diagnosing import Diagnosis, diagnose
from solver.catalogue.plain_words import with_unit
from solver.criticism.candidate import Candidate
from solver.criticism.diagnosis_files import write_texts
from solver.criticism.explanations import Weighed, title_of_explanation
from solver.criticism.probability_figure import (
    probability_figure,
    probability_line,
    titles_of,
)
from solver.criticism.quick_corridor import diagnosis_gate, lack_words
from solver.criticism.shared import Shared, pooled
from solver.criticism.stretch_page import stretch_page
from solver.effect import Effect
from solver.fit.held_out import FOLDS
from solver.run.report.report_words import told
from solver.run.run import Run
from solver.run.run_corridor import median_half
from solver.run.stretch import folder_of, saved, stretch_of, stretches_of
from solver.run.strict_json import strict
from solver.run.titles import lower, probability_words
from solver.run.trust import DIAGNOSIS, Gate, Verdict, with_gate
from vision.contract import progress
from vision.contract.notebook import framed
from vision.contract.rounding import with_sigma

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

#: Steps that the fit of a stretch takes at most, and usually.
STEPS = 40
#: Probability of one cause along all of the fiber below which a terminal does not show which it would be.
APART = 0.05


def stretch(run: Run, first: int, last: int) -> Run:
    """The run of some channels of a longer one, fitted by itself: it can be compared, diagnosed and given effects.

    Parameters
    ----------
    run : as `locate` returns or `open` reads it
    first, last : channels, as the DAS file counts

    Raises
    ------
    InputError
        If it has too few channels, no vehicle comes near it, or it is longer than is fitted as a whole.

    Examples
    --------
    >>> part = rf.stretch(run, *run.problem.channel[[5, -5]])
    >>> len(run.problem.channel) - len(part.problem.channel), part.trust[:15]
    (9, 'No check failed')
    """
    with progress(f"fitting channels {first} to {last}", STEPS + FOLDS) as advance:
        return stretch_of(run, int(first), int(last), advance)


@dataclass(frozen=True, repr=False)
class StretchDiagnosis:
    """What the stretches of a long run lack, each by itself and together.

    Parameters
    ----------
    run : the long one; its trust is that of the diagnosis
    parts : the diagnosis of each stretch, in the order of channels
    """

    run: Run
    parts: tuple[Diagnosis, ...]

    @cached_property
    def shared(self) -> Shared:
        """The explanations with one cause along all of the fiber, of stretches whose noise is understood."""
        known = sum(not one.generic for one in self.run.known.values())
        return Shared.of([one.finding.explanations for one in self.parts if one.finding.explanations], known)

    @property
    def channels(self) -> list[tuple[int, int]]:
        """First and last channel of each stretch."""
        return [(int(one.run.problem.channel[0]), int(one.run.problem.channel[-1])) for one in self.parts]

    @property
    def verdict(self) -> str:
        """`adequate` where every stretch is; else the verdict on one cause along all, or on the worst stretch."""
        verdicts = {one.verdict for one in self.parts}
        if self.alike is not None:
            return {"nothing": "adequate", "unknown": "unknown-effect"}.get(self.alike.kind, "missing-effect")
        worst = ("missing-effect", "unknown-effect", "inconclusive", "adequate")
        return next(one for one in worst if one in verdicts)

    @property
    def alike(self) -> Weighed | None:
        """The one cause along all of the fiber that holds 95 %; None where there is none, or stretches differ."""
        best = self.shared.weighed[0]
        return best if self.shared.alike >= 0.5 and best.probability >= 0.95 else None

    @property
    def effect(self) -> str | None:
        """Name of the effect that is missing along all of the fiber; None where there is none, or stretches differ."""
        cause = self.alike
        return cause.effects[0] if cause is not None and cause.kind in ("effect", "fault") else None

    def candidates(self, effect: str) -> list[Candidate]:
        """An effect's finding in each stretch that says something of its size."""
        every = (c for one in self.parts for c in one.finding.candidates if c.effect == effect)
        return [c for c in every if c.told is not None and np.isfinite(c.told.sigma) and c.told.sigma > 0]

    @property
    def headline(self) -> str:
        """The verdict in a sentence, in plain words."""
        cause = self.alike
        if cause is None:
            each = zip(self.channels, self.parts, strict=True)
            told = " ".join(f"Channels {a} to {b}: {one.headline}" for (a, b), one in each)
            return f"Stretch by stretch. {told}"
        if cause.kind == "nothing":
            return f"Nothing is missing that this survey could show, along {self._where}."
        if cause.kind == "unknown":
            return f"Something unknown acts along {self._where}, at the {cause.stage} stage."
        found = self.candidates(cause.effects[0])
        title = title_of_explanation(cause, titles_of(found))
        if not found:
            return f"{title}, along {self._where}."
        size, sigma, scatter = pooled([c.told for c in found if c.told is not None])
        number = with_unit(with_sigma(size, sigma), found[0].told.unit if found[0].told else "")
        apart = f"; its sizes differ by {scatter:.1f} of their sigmas" if scatter > 2 else ""
        return f"{title}, along {self._where}: {number}{apart}."

    @property
    def _where(self) -> str:
        """The stretches whose noise is understood."""
        known, count = sum(bool(one.finding.explanations) for one in self.parts), len(self.parts)
        return (
            f"all {count} stretches" if known == count else f"the {known} of {count} stretches with noise as expected"
        )

    def judged(self) -> Run:
        """The run whose checks hold the diagnoses; where stretches fail, their channels are not constrained."""
        gates = [diagnosis_gate(one.finding, median_half(one.run.result)) for one in self.parts]
        gate = self._gate(gates)
        channel, lost = self.run.result.channel, np.zeros(len(self.run.result.channel), bool)
        for (first, last), one in zip(self.channels, gates, strict=True):
            lost |= bool(gate.where) & one.failed & (channel >= first) & (channel <= last)
        result = replace(self.run.result, constrained=self.run.result.constrained & ~lost)
        trust = with_gate(self.run.facts["trust"], gate)
        return told(replace(self.run, result=result, facts=self.run.facts | {"trust": trust}))

    def _gate(self, gates: list[Gate]) -> Gate:
        """The check that the whole model lacks nothing, from those of stretches."""
        cause, every = self.alike, {one.verdict for one in gates}
        verdict: Verdict = "failed" if "failed" in every else "open" if "open" in every else "passed"
        worst = [n for n, one in enumerate(gates) if one.verdict == verdict]
        part = f"RUN/{folder_of(self.parts[worst[0]].run)}"
        mend = tuple(one.replace("RUN", part, 1) for one in gates[worst[0]].mend)
        if cause is not None and all(one.finding.explanations for one in self.parts):
            says = lower(self.headline).rstrip(".")
            if cause.kind == "nothing":
                return Gate(DIAGNOSIS, "passed", says)
            said = says if cause.kind == "unknown" else f"the model lacks {says}"
            return Gate(DIAGNOSIS, "passed" if verdict == "passed" else "failed", said, mend)
        found: dict[str, list[str]] = {}
        for n in worst:
            found.setdefault(lack_words(self.parts[n].finding), []).append("{} to {}".format(*self.channels[n]))
        if len(worst) == len(gates) and len(found) == 1:
            return Gate(DIAGNOSIS, verdict, next(iter(found)), mend)
        words = "; ".join(f"{says} at channels {', '.join(listed)}" for says, listed in found.items())
        local = verdict == "failed" and len(worst) < len(gates)
        where = "at channels " + ", ".join(ends for listed in found.values() for ends in listed) if local else ""
        return Gate(DIAGNOSIS, verdict, words, mend, where=where)

    @property
    def table(self) -> "pd.DataFrame":
        """A row per stretch: channels, verdict, effect, its probability, size and sigma, and a sentence."""
        import pandas as pd

        return pd.DataFrame([self._row(one) for one in self.parts])

    def _row(self, one: Diagnosis) -> dict[str, Any]:
        first = one.finding.candidates[0] if one.verdict == "missing-effect" else None
        told = None if first is None else first.told
        return {
            "first": int(one.run.problem.channel[0]),
            "last": int(one.run.problem.channel[-1]),
            "verdict": one.verdict,
            "effect": "" if first is None else first.effect,
            "probability": np.nan if first is None else first.probability,
            "size": np.nan if told is None else told.size,
            "sigma": np.nan if told is None else told.sigma,
            "unit": "" if told is None else told.unit,
            "headline": one.headline,
        }

    @property
    def facts(self) -> dict[str, Any]:
        """The content of stretches.json."""
        rows = self.table.drop(columns="unit").to_dict("records")
        found: dict[str, Any] = strict(
            {
                "format": "roadfiber stretches 1",
                "headline": self.headline,
                "verdict": self.verdict,
                "alike": self.shared.alike,
                "explanations": [asdict(one) for one in self.shared.weighed],
                "stretches": [row | {"folder": name} for row, name in zip(rows, self._folders, strict=True)],
            }
        )
        return found

    @property
    def _folders(self) -> list[str]:
        return [folder_of(one.run) for one in self.parts]

    def plot(self) -> "Figure":
        """Draw how probable each cause along all of the fiber is."""
        return probability_figure(self.shared.weighed, self._listed)

    @property
    def _listed(self) -> list[Candidate]:
        return [c for one in self.parts for c in one.finding.candidates]

    def save(self, folder: Path | str) -> None:
        """Write stretches.json, stretches.html and a run folder with its diagnosis for each stretch into a folder.

        Into the run's own with what follows for its route.
        """
        folder = Path(folder)
        for one in self.parts:
            one.save(saved(one.run, folder))
        facts = json.dumps(self.facts, allow_nan=False, indent=1)
        write_texts(folder, {"stretches.json": facts, "stretches.html": self.page}, self.run)

    @property
    def page(self) -> str:
        """stretches.html."""
        return stretch_page(self.run.name, self.facts, self.plot())

    def lines(self) -> list[str]:
        """What a terminal shows."""
        lines = [f"{self.verdict}: {self.headline}"]
        lines += [f"  channels {one['first']} to {one['last']}: {one['headline']}" for one in self.facts["stretches"]]
        alike = probability_words(self.shared.alike)
        lines.append(
            f"that one cause, or none, acts along all of it is {alike} probable, if it was as likely as not before"
        )
        if self.shared.alike < APART:
            return lines
        return [*lines, f"how probable, if so: {probability_line(self.shared.weighed, self._listed)}"]

    def __repr__(self) -> str:
        return f"<StretchDiagnosis {self.run.name}: {self.verdict}: {lower(self.headline)}>"

    def _repr_html_(self) -> str:
        return framed(self.page)


def diagnose_stretches(
    run: Run, *, effects: Iterable[Effect] = (), tell: Callable[[str], None] | None = None
) -> StretchDiagnosis:
    """Diagnose each stretch of a run by itself, and weigh what they lack together.

    Each stretch is fitted by itself from the route of the whole on. Shows its progress.

    Parameters
    ----------
    run : of a fiber of any length, as `locate` returns or `open` reads it
    effects : of your own, tested beside the catalogue's
    tell : called with the verdict on each stretch, such as `print`

    Raises
    ------
    InputError
        If code of its model was not given, or an effect breaks a promise.

    Examples
    --------
    >>> found = rf.diagnose_stretches(rf.stretch(run, *run.problem.channel[[4, 16]]))
    >>> len(found.table), found.verdict in ("adequate", "missing-effect", "unknown-effect", "inconclusive")
    (1, True)
    """
    given, found = list(effects), list[Diagnosis]()
    parts = [stretch(run, first, last) for first, last in stretches_of(run)]
    for part in parts:
        found.append(diagnose(part, effects=given))
        if tell is not None:
            tell(f"{part.name}: {found[-1].verdict}: {found[-1].headline}")
    whole = StretchDiagnosis(run, tuple(found))
    return replace(whole, run=whole.judged())
