"""Which physical effect the model of a run lacks."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from solver.criticism.candidate import Candidate
from solver.criticism.diagnosis import diagnose as diagnose_problem
from solver.criticism.diagnosis import steps
from solver.criticism.diagnosis_figures import support_figure
from solver.criticism.diagnosis_files import diagnosis_facts, write_diagnosis
from solver.criticism.explanations import title_of_explanation
from solver.criticism.finding import Diagnosis as Finding
from solver.criticism.pages import diagnosis_page
from solver.criticism.plain_verdict import details, headline, size_words
from solver.criticism.probability_figure import probability_figure, probability_line, titles_of
from solver.criticism.quick_corridor import with_diagnosis
from solver.criticism.route_change import from_run
from solver.effect import Effect
from solver.run.fitted import fitted
from solver.run.run import Run, require_whole
from solver.run.titles import lower
from vision.contract import progress
from vision.contract.notebook import framed
from vision.contract.rounding import fall_words

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


#: Candidates that a terminal shows.
SHOWN = 6


@dataclass(frozen=True, repr=False)
class Diagnosis:
    """What a run's model lacks.

    Parameters
    ----------
    run : that was diagnosed; its corridor and its trust are those of the diagnosis
    finding : all figures, see `solver.criticism.diagnosis.Diagnosis`
    """

    run: Run
    finding: Finding

    @property
    def verdict(self) -> str:
        """`adequate`, `missing-effect`, `unknown-effect` or `inconclusive`."""
        return self.finding.verdict

    @property
    def words(self) -> str:
        """The verdict in the commands' terms, with the size of the effect and what the route takes up."""
        return self.finding.words

    @property
    def headline(self) -> str:
        """The verdict in a sentence, in plain words."""
        return headline(self.finding)

    @property
    def effect(self) -> str | None:
        """Name of the effect that explains most; None where nothing does."""
        return self.finding.candidates[0].effect if self.finding.candidates else None

    @property
    def table(self) -> "pd.DataFrame":
        """Effects, best first: title, effect, stage, verdict, fall of chi2, size, sigma, unit ..."""
        import pandas as pd

        rows = [asdict(one) for one in self.finding.candidates]
        return pd.DataFrame([{"title": c.title} | row for c, row in zip(self.finding.candidates, rows, strict=True)])

    @property
    def probabilities(self) -> "pd.DataFrame":
        """Every explanation, most probable first: explanation (title), kind, effects, stage, probability; sums to 1.

        Kinds are `nothing` (that would show), `effect`, `two` (an effect, and more beside it), `fault` and `unknown`.
        Empty where the noise is not understood.
        """
        import pandas as pd

        known = titles_of(self.finding.candidates)
        titles = [title_of_explanation(one, known) for one in self.finding.explanations]
        rows = [asdict(one) for one in self.finding.explanations]
        columns = ["explanation", "kind", "effects", "stage", "probability"]
        return pd.DataFrame(
            [{"explanation": title} | row for title, row in zip(titles, rows, strict=True)], columns=columns
        )

    @property
    def route(self) -> "pd.DataFrame":
        """The run's route, whose sigmas hold what the model may lack: columns as of `Run.route`."""
        return self.run.route

    @property
    def facts(self) -> dict[str, Any]:
        """The content of diagnosis.json."""
        return diagnosis_facts(self.finding)

    def plot(self) -> "Figure":
        """Draw how probable each explanation is; how much misfit each takes away where the noise is not understood."""
        found = self.finding
        return (
            probability_figure(found.explanations, found.candidates)
            if found.explanations
            else support_figure(found.candidates)
        )

    def save(self, folder: Path | str) -> None:
        """Write diagnosis.json and diagnosis.html into a folder; into the run's own with what follows for its route."""
        write_diagnosis(Path(folder), self.finding, self.run.name, self.run)

    def lines(self) -> list[str]:
        """What a terminal shows."""
        found = self.finding
        lines = [f"{found.verdict}: {self.headline}", *(f"  {line}" for line in details(found)), f"  {found.words}"]
        if found.explanations:
            lines.append(f"how probable: {probability_line(found.explanations, found.candidates)}")
        if self.run.corridor:
            lines.append(self.run.corridor)
        if found.separate:
            lines.append(f"what would tell them apart: {found.separate}")
        return lines + [f"  {c.effect:22s} {c.verdict:12s} {explained(c)}" for c in found.candidates[:SHOWN]]

    def __repr__(self) -> str:
        return f"<Diagnosis {self.run.name}: {self.verdict}: {self.headline}>"

    def _repr_html_(self) -> str:
        return framed(diagnosis_page(self.finding, self.run.name, self.run))


def explained(c: Candidate) -> str:
    """How much misfit a candidate takes away, and its size."""
    full = "" if c.refitted else " (predicted)"
    return f"chi2 {fall_words(c.delta_chi2, '8.0f')}{full}; {size_words(c)}"


def ranking_words(how: str, listed: Sequence[Candidate]) -> str:
    """Candidates as they were ranked: a sentence, and below it the best of them, a line each."""
    first = next((c for c in listed if c.verdict == "present"), None)
    sentence = "nothing shows so far" if first is None else f"{lower(first.title)} explains most so far"
    return "\n".join([f"{how}: {sentence}", *(f"  {c.effect:22s} {explained(c)}" for c in listed[:SHOWN])])


def diagnose(run: Run, *, effects: Iterable[Effect] = (), tell: Callable[[str], None] | None = None) -> Diagnosis:
    """Say which physical effect the model of a run lacks, if any.

    Audits the noise, tests every effect of the catalogue, and fits the best in full. Shows its progress; Ctrl-C ends it
    with KeyboardInterrupt.

    Parameters
    ----------
    run : as `locate` returns or `open` reads it
    effects : of your own, tested beside the catalogue's
    tell : called with what explains most by the score test, and then by full fits, such as `print`

    Raises
    ------
    InputError
        If the run is of a long fiber (see `diagnose_stretches`), code of its model was not given, or an effect breaks a
        promise.

    Examples
    --------
    >>> found = rf.diagnose(run)
    >>> found.verdict in ("adequate", "missing-effect", "unknown-effect", "inconclusive")
    True
    >>> round(float(found.probabilities.probability.sum()), 6)
    1.0
    """
    require_whole(run)
    known = list(run.known.extended(effects).values())
    fit, state = fitted(run)

    def ranked(how: str, listed: Sequence[Candidate]) -> None:
        if tell is not None:
            tell(ranking_words(how, listed))

    with progress("testing effects", steps(known)) as advance:
        found = diagnose_problem(fit.problem, state, effects=known, advance=advance, tell=ranked)
    found = from_run(run, found)
    return Diagnosis(with_diagnosis(run, found), found)
