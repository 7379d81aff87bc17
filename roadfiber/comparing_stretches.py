"""Compare the model of a long run with the measurement, stretch by stretch."""

from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from roadfiber.comparing import Comparison, compare
from roadfiber.stretching import stretch
from solver.criticism.comparison.comparison_words import MEANING, largest_source
from solver.run.run import Run
from solver.run.stretch import folder_of, saved, stretches_of

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
class StretchComparison:
    """Where the model of a long run fails: along all of the fiber, or in some stretches.

    Parameters
    ----------
    run : the long one
    parts : the comparison of each stretch, in the order of channels
    """

    run: Run
    parts: tuple[Comparison, ...]

    @property
    def channels(self) -> list[tuple[int, int]]:
        """First and last channel of each stretch."""
        return [(int(one.run.problem.channel[0]), int(one.run.problem.channel[-1])) for one in self.parts]

    @property
    def headline(self) -> str:
        """In which stretches model and measurement differ, and whether by one cause, in a sentence or two."""
        count, failing = len(self.parts), [one for one in self.parts if one.finding.regions]
        if not failing:
            return f"In none of {count} stretches does a place, a vehicle or a time stand out."
        worst = max(failing, key=lambda one: one.finding.excess)
        first, last = self.channels[self.parts.index(worst)]
        said = (
            f"Model and measurement differ in {len(failing)} of {count} stretches, most in channels {first} to {last}."
        )
        causes = Counter(largest_source(one.finding) for one in failing)
        cause, often = causes.most_common(1)[0]
        if cause is None or often < len(failing) or often < 2:
            return said
        return f"{said} In each of them one cause explains most: {MEANING[cause]}."

    @property
    def table(self) -> "pd.DataFrame":
        """A row per stretch: channels, misfit above the noise (a share of it), regions, what explains most, verdict."""
        import pandas as pd

        return pd.DataFrame(
            {
                "first": first,
                "last": last,
                "excess": one.finding.excess,
                "regions": len(one.finding.regions),
                "source": largest_source(one.finding) or "",
                "verdict": one.verdict,
            }
            for (first, last), one in zip(self.channels, self.parts, strict=True)
        )

    @property
    def regions(self) -> "pd.DataFrame":
        """Where the model fails in all stretches, worst first: columns of `Comparison.regions`, first, last."""
        import pandas as pd

        each = zip(self.channels, self.parts, strict=True)
        tables = [one.regions.assign(first=first, last=last) for (first, last), one in each]
        return pd.concat(tables, ignore_index=True).sort_values("chi2", ascending=False, ignore_index=True)

    @cached_property
    def facts(self) -> list[dict[str, Any]]:
        """Of each stretch its channels and the content of its compare.json."""
        each = zip(self.channels, self.parts, strict=True)
        return [{"first": first, "last": last, **one.facts} for (first, last), one in each]

    def said(self) -> list[str]:
        """What a terminal shows."""
        each = zip(self.channels, self.parts, strict=True)
        return [
            self.headline,
            *(f"channels {first} to {last}: {one.headline} {one.verdict}" for (first, last), one in each),
        ]

    def plot(self, name: str = "maps") -> "Figure":
        """Draw one of the pictures of the stretch that fails most; `parts` have their own.

        Parameters
        ----------
        name : as of `Comparison.plot`
        """
        return max(self.parts, key=lambda one: one.finding.excess).plot(name)

    def pages(self, folder: Path | str) -> list[Path]:
        """Where `save` puts the page of each stretch."""
        return [Path(folder) / folder_of(one.run) / "compare.html" for one in self.parts]

    def save(self, folder: Path | str) -> None:
        """Write a run folder with its comparison for each stretch into a folder, such as the run's."""
        for one in self.parts:
            one.save(saved(one.run, Path(folder)))

    def __repr__(self) -> str:
        return f"<StretchComparison {self.run.name}: {self.headline}>"

    def _repr_html_(self) -> str:
        from html import escape

        return f"<p>{escape(self.headline)}</p>{self.table.to_html(index=False)}"


def compare_stretches(run: Run) -> StretchComparison:
    """Compare the model with the measurement in each stretch of a run.

    Each stretch is fitted by itself from the route of the whole on. Shows its progress.

    Parameters
    ----------
    run : of a fiber of any length, as `locate` returns or `open` reads it

    Raises
    ------
    InputError
        If no vehicle comes near a stretch.

    Examples
    --------
    >>> found = rf.compare_stretches(rf.stretch(run, *run.problem.channel[[4, 16]]))
    >>> len(found.table), found.regions.columns[-2:].tolist()
    (1, ['first', 'last'])
    """
    return StretchComparison(run, tuple(compare(stretch(run, first, last)) for first, last in stretches_of(run)))
