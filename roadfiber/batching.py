"""Many surveys on many cores or machines: every step of every site a task of one graph."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from roadfiber.batch_cluster import cluster
from roadfiber.batch_steps import DONE, FAILED, LEFT, NOTHING, STEPS, Job, Outcome, take
from roadfiber.widening import FULL, check_corridor
from solver.run.strict_json import strict
from vision.contract import InputError, progress, require_writable

if TYPE_CHECKING:
    import pandas as pd
    from distributed import Client, Future

#: Tries after one that failed for a reason that may pass.
RETRIES = 2


@dataclass(frozen=True, repr=False)
class Batch:
    """What became of every step of every site.

    Parameters
    ----------
    outcomes : in the order of sites and steps
    out : folder of the run folders
    """

    outcomes: tuple[Outcome, ...]
    out: Path

    @property
    def failed(self) -> list[str]:
        """Names of the sites of which a step failed."""
        return [one.site for one in self.outcomes if one.status == FAILED]

    @cached_property
    def table(self) -> "pd.DataFrame":
        """A row per site: its name, each step's status, s of one core (`cpu`), and the last result or the error."""
        import pandas as pd

        rows: dict[str, dict[str, Any]] = {}
        for one in self.outcomes:
            row = rows.setdefault(one.site, {"site": one.site})
            row[one.step] = one.status
        for name, row in rows.items():
            mine = [one for one in self.outcomes if one.site == name]
            row["cpu"] = sum(one.cpu for one in mine)
            row["words"] = next((one.words for one in mine if one.status == FAILED), mine[-1].words)
        return pd.DataFrame(list(rows.values()))

    @property
    def headline(self) -> str:
        """How many sites are done, unchanged and failed, in a line."""
        sites = list(dict.fromkeys(one.site for one in self.outcomes))
        worked = {one.site for one in self.outcomes if one.status == DONE}
        failed = set(self.failed)
        counts = {
            "done": sum(site in worked - failed for site in sites),
            "unchanged": sum(site not in worked | failed for site in sites),
            "failed": len(failed),
        }
        return f"{len(sites)} sites: " + ", ".join(f"{count} {name}" for name, count in counts.items() if count)

    @cached_property
    def facts(self) -> dict[str, Any]:
        """What `roadfiber batch --json` prints."""
        checked: dict[str, Any] = strict(
            {"headline": self.headline, "failed": self.failed, "steps": [asdict(one) for one in self.outcomes]}
        )
        return checked

    def lines(self) -> list[str]:
        """What a terminal shows: a line per site."""
        wide = max(len(one.site) for one in self.outcomes)
        lines = []
        for row in self.table.to_dict("records"):
            steps = ", ".join(f"{step} {row[step]}" for step in STEPS if row.get(step, NOTHING) != NOTHING)
            lines.append(f"  {row['site']:{wide}s}  {steps}; {row['cpu']:.0f} s of one core; {row['words']}")
        return lines

    def __repr__(self) -> str:
        return "\n".join([f"<Batch {self.out}: {self.headline}", *self.lines()]) + ">"

    def _repr_html_(self) -> str:
        import pandas as pd

        with pd.option_context("display.max_colwidth", None):  # The error of a site is told to its end.
            return f"<p>{self.headline}</p>{self.table.to_html(index=False)}"


def batch(
    sites: Sequence[Path | str],
    out: Path | str = "runs",
    *,
    steps: Sequence[str] = tuple(STEPS),
    corridor: str = FULL,
    workers: int | None = None,
    scheduler: str | None = None,
) -> Batch:
    """Ingest, track, locate and diagnose many surveys: every step a task of one graph, on cores or machines.

    What was done before and is unchanged is kept. A site that fails is told and stops no other; a task whose worker is
    lost, or that meets an error of the machine, is tried again. Needs Dask: `pip install 'roadfiber[cluster]'`.

    Parameters
    ----------
    sites : paths of site.toml files, or of their folders
    out : folder for the run folders, named as the sites' folders are
    steps : of "ingest", "track", "locate", "diagnose"; "track" is for sites with a video and no trajectories
    corridor : "full", or "fit", which is faster, as of `locate`
    workers : processes on this machine; by default one per core
    scheduler : address of a Dask scheduler in their place, as "tcp://10.0.0.1:8786"; its workers must see the same
        paths

    Returns
    -------
    batch : its `table`, `failed`, `headline`, `facts`

    Raises
    ------
    InputError
        If Dask is not installed, the scheduler does not answer, two sites have one name, or a step or kind of corridor
        is unknown.

    Examples
    --------
    >>> done = rf.batch([folder / "survey"], folder / "runs", steps=["ingest"], workers=1)
    >>> done.table["ingest"].tolist(), done.failed
    (['done'], [])
    """
    check_corridor(corridor)
    jobs = jobs_of(sites, Path(out), steps, corridor)
    with cluster(workers, scheduler) as client:
        asked = submitted(client, jobs)
        wait_for(list(asked.values()))
        return Batch(tuple(outcomes(asked)), Path(out))


def jobs_of(sites: Sequence[Path | str], out: Path, steps: Sequence[str], corridor: str = FULL) -> list[Job]:
    """What is to be done for each site; InputError where that cannot be begun."""
    unknown = [name for name in steps if name not in STEPS]
    if unknown or not steps:
        raise InputError(f"steps {', '.join(unknown) or 'are none'}; give some of {', '.join(STEPS)}")
    if not sites:
        raise InputError("no sites; give the paths of their site.toml files, or of their folders")
    jobs: dict[str, Job] = {}
    wanted = tuple(name for name in STEPS if name in steps)
    for path in map(Path, sites):
        file = (path / "site.toml" if path.is_dir() else path).absolute()
        name = file.parent.name if file.name == "site.toml" else file.stem
        if name in jobs:
            raise InputError(
                f"{jobs[name].site} and {file} would share {out / name}; rename a folder, or run two batches"
            )
        jobs[name] = Job(file, out.absolute(), name, wanted, corridor)
    require_writable(out / "run")
    return list(jobs.values())


def wait_for(futures: "list[Future]") -> None:
    """Wait until all tasks are over, and show how many are."""
    from distributed import as_completed

    with progress("batch", len(futures)) as advance:
        for _ in as_completed(futures):
            advance(1)


def submitted(client: "Client", jobs: Sequence[Job]) -> "dict[tuple[Job, str], Future]":
    """Give the scheduler all tasks: each begins when those that it needs are over."""
    asked: dict[tuple[Job, str], Future] = {}
    for job in jobs:
        for name in job.steps:
            before = [asked[job, other] for other in STEPS[name].after if other in job.steps]
            asked[job, name] = client.submit(take, job, name, before, retries=RETRIES, pure=False)
    return asked


def outcomes(asked: "dict[tuple[Job, str], Future]") -> Iterator[Outcome]:
    """How every task ended; one whose worker was lost too often, or that failed at every try, is told as failed."""
    ended: dict[tuple[Job, str], Outcome] = {}
    for (job, name), future in asked.items():
        before = [ended[job, other] for other in STEPS[name].after if other in job.steps]
        if future.status == "finished":
            ended[job, name] = future.result()
        elif any(one.status in (FAILED, LEFT) for one in before):
            ended[job, name] = Outcome(job.name, name, LEFT)
        else:
            ended[job, name] = Outcome(job.name, name, FAILED, why(future))
        yield ended[job, name]


def why(future: "Future") -> str:
    """Say in a line why a task was given up."""
    from distributed import KilledWorker

    error = future.exception()
    if isinstance(error, KilledWorker):
        return "its worker was lost at every try; it may need more memory than a worker has"
    return f"{type(error).__name__}: {error}"
