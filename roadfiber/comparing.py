"""Compare the model of a run with the measurement."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from solver.criticism.comparison.compare import compare as compare_run
from solver.criticism.comparison.comparison import Comparison as Finding
from solver.criticism.comparison.comparison_files import facts_of, write_comparison
from solver.criticism.comparison.comparison_page import WIDE, render
from solver.criticism.comparison.comparison_words import headline, region_words, verdict
from solver.criticism.comparison.figures import figures_of
from solver.criticism.comparison.map_figure import map_figure
from solver.run.run import Run, require_whole

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

#: Columns of the table of regions.
REGION = ("words", "x", "time", "amount", "sigma", "unit", "chi2", "z")


@dataclass(frozen=True, repr=False)
class Comparison:
    """Model against measurement: where, when and how they differ.

    Parameters
    ----------
    run : that was compared
    finding : all figures, see `solver.criticism.comparison.Comparison`
    """

    run: Run
    finding: Finding

    @property
    def headline(self) -> str:
        """How much the model leaves, in a sentence."""
        return headline(self.finding, self.run)

    @property
    def verdict(self) -> str:
        """What that means, in a sentence or two."""
        return verdict(self.finding, self.run)

    @cached_property
    def facts(self) -> dict[str, Any]:
        """The content of compare.json."""
        return facts_of(self.finding, self.run)

    @property
    def regions(self) -> "pd.DataFrame":
        """Where the model fails, worst first: words, x (m), time (UTC), amount, sigma, unit, chi2, z."""
        import pandas as pd

        return pd.DataFrame(self.facts["regions"], columns=list(REGION))

    def lines(self) -> list[str]:
        """The same in words, a line each."""
        return [region_words(region, self.run) for region in self.finding.regions]

    def said(self) -> list[str]:
        """What a terminal shows."""
        return [self.headline, self.verdict, *(f"  {line}" for line in self.lines())]

    def plot(self, name: str = "maps") -> "Figure":
        """Draw one of its pictures.

        Parameters
        ----------
        name : maps (measured, model, residual), split, stack, channels, power or spectrum
        """
        if name == "maps":
            return map_figure(self.finding, self.run, WIDE)
        figures = figures_of(self.finding, self.run, WIDE)
        if name not in figures:
            raise ValueError(f"no picture {name!r}; choose maps, {', '.join(figures)}")
        return figures[name]

    def save(self, folder: Path | str) -> None:
        """Write compare.html, compare.json and the pictures into a folder, all or none."""
        write_comparison(Path(folder), self.finding, self.run)

    def pages(self, folder: Path | str) -> list[Path]:
        """Where `save` puts its page."""
        return [Path(folder) / "compare.html"]

    def __repr__(self) -> str:
        return f"<Comparison {self.run.name}: {self.headline}>"

    def _repr_html_(self) -> str:
        from vision.contract.notebook import framed

        return framed(render(self.finding, self.run))


def compare(run: Run) -> Comparison:
    """Compare the model of a run with the measurement: where, when and how they differ.

    Parameters
    ----------
    run : as `locate` returns or `open` reads it

    Raises
    ------
    InputError
        If the run is of a long fiber (see `compare_stretches`), of a drive, or several that were combined.

    Examples
    --------
    >>> comparison = rf.compare(run)
    >>> comparison.regions.columns[:3].tolist(), comparison.facts["noise_floor"] > 0.9
    (['words', 'x', 'time'], True)
    """
    require_whole(run)
    return Comparison(run, compare_run(run))
