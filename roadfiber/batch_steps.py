"""The steps of a batch: each is run for a site where its inputs changed, and kept where they did not.

A step that is done leaves a stamp in `OUT/.batch/SITE/`, with the checksum of what it was made from. Its results lie
where the verbs put them: the store beside the files, the run folder in `OUT/SITE`.
"""

import json
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any

from roadfiber.widening import FULL
from solver.survey.site import Site, read_site
from vision.contract.errors import InputError
from vision.contract.files import writing

#: How a step ended: run now; done before and unchanged; refused; not begun, for a step before it failed; not needed.
DONE, KEPT, FAILED, LEFT, NOTHING = "done", "kept", "failed", "left", "-"
#: Errors that may pass: another try is worth it. Whatever else goes wrong would go wrong again.
PASSING = (OSError, MemoryError)


@dataclass(frozen=True)
class Job:
    """What is to be done for one site.

    Parameters
    ----------
    site : path of its site.toml
    out : folder of the batch
    name : of the site's run folder there
    steps : those wanted
    corridor : of the route, as of `locate`
    """

    site: Path
    out: Path
    name: str
    steps: tuple[str, ...]
    corridor: str = FULL

    @property
    def run(self) -> Path:
        """The run folder."""
        return self.out / self.name

    @property
    def state(self) -> Path:
        """The folder of stamps and tracks."""
        return self.out / ".batch" / self.name

    def read(self) -> Site:
        """The site.toml, read and checked."""
        return read_site(self.site, moving=self.steps != ("ingest",))


@dataclass(frozen=True)
class Outcome:
    """How a step of a site ended.

    Parameters
    ----------
    site, step : names
    status : `DONE`, `KEPT`, `FAILED`, `LEFT` or `NOTHING`
    words : the result, or the error, in a line
    seconds, cpu : that it took, s
    facts : what it went through: bytes, frames, passes ...
    """

    site: str
    step: str
    status: str
    words: str = ""
    seconds: float = 0.0
    cpu: float = 0.0
    facts: dict[str, Any] = field(default_factory=dict)


def checksum_of(*parts: Any) -> str:
    """Checksum of values that JSON can hold.

    >>> checksum_of("a", 1) == checksum_of("a", 1), checksum_of("a", 1) == checksum_of("a", 2)
    (True, False)
    """
    return sha256(json.dumps([version("roadfiber"), *parts], default=str, sort_keys=True).encode()).hexdigest()


def states(files: Sequence[Path]) -> list[tuple[str, int, int]]:
    """Path, size (bytes) and time of change (ns) of files."""
    return [(str(path), path.stat().st_size, path.stat().st_mtime_ns) for path in files]


def tables(job: Job) -> tuple[Path, Path]:
    """Files of what was tracked: fixes on the road, and fixes that were dropped."""
    return job.state / "tracks.parquet", job.state / "dropped.parquet"


def needs_tracking(site: Site) -> bool:
    """Whether a site has a video and no trajectories."""
    return site.camera is not None and site.trajectories is None


def has_effects(site: Site) -> bool:
    """Whether a site's model may lack effects: that of a drive has none."""
    return site.route is None


def camera_of(site: Site) -> list[Any]:
    """What tracks depend on."""
    assert site.camera is not None, "a site that needs tracking has a camera"
    settings = site.camera.model_dump()
    return [settings, site.frame_section.model_dump(), states([x for x in settings.values() if isinstance(x, Path)])]


def ingest_inputs(job: Job, site: Site) -> str:
    """What a store depends on."""
    return checksum_of(site.das.said, site.das.store, states(site.das.files))


def track_inputs(job: Job, site: Site) -> str:
    """What a table of tracks depends on."""
    return checksum_of(camera_of(site))


def locate_inputs(job: Job, site: Site) -> str:
    """What a route depends on."""
    files = [*site.das.files, *(site.trajectories.files if site.trajectories else [])]
    files += [part.file for part in (site.anchors, site.route) if part]
    seen = camera_of(site) if needs_tracking(site) else []
    return checksum_of(site.model_dump(by_alias=True), states(files), seen, job.corridor)


def diagnose_inputs(job: Job, site: Site) -> str:
    """What a diagnosis depends on."""
    path = job.run / "fit.json"
    if not path.is_file():
        raise InputError(f"{job.run}: no run to diagnose; name locate among the steps")
    return checksum_of(sha256(path.read_bytes()).hexdigest())


def ingest_step(job: Job, site: Site) -> tuple[str, dict[str, Any]]:
    """Keep the record at the rate of the fit; a line on the result, and facts."""
    from roadfiber.ingesting import ingest

    done = ingest(job.site)
    words = f"{done.raw_bytes / 1e6:.0f} MB to {done.bytes / 1e6:.0f} MB"
    return words, {"raw_bytes": done.raw_bytes, "bytes": done.bytes}


def track_step(job: Job, site: Site) -> tuple[str, dict[str, Any]]:
    """Follow the vehicles of the video."""
    from roadfiber.locating import followed

    tracked = followed(site)
    assert tracked.dropped is not None, "a camera of site.toml is calibrated"
    for table, path in zip((tracked.table, tracked.dropped), tables(job), strict=True):
        with writing(path) as temporary:
            table.to_parquet(temporary, index=False)
    facts = {"vehicles": tracked.facts["tracks"], "frames": tracked.facts["frames"], "placed": tracked.placed}
    return f"{facts['vehicles']} vehicles in {facts['frames']} frames", facts


def locate_step(job: Job, site: Site) -> tuple[str, dict[str, Any]]:
    """Locate the fiber, with the tracks of the step before where there was one."""
    import pandas as pd

    from roadfiber.locating import locate, located
    from solver.run.run import Run
    from solver.survey.survey import Survey

    if needs_tracking(site) and "track" in job.steps:
        placed = read_stamp(job, "track")["facts"]["placed"]
        table, dropped = (pd.read_parquet(path) for path in tables(job))
        run: Any = located(Survey.of_site(site), table, dropped, placed, corridor=job.corridor)
    else:
        run = locate(job.site, corridor=job.corridor)
    run.save(job.run)
    facts = {"channels": len(run.route)} | ({"passes": len(run.passes)} if isinstance(run, Run) else {})
    return f"{run.headline} {run.trust.partition(':')[0]}", facts


def diagnose_step(job: Job, site: Site) -> tuple[str, dict[str, Any]]:
    """Say which effect the model lacks."""
    from roadfiber.diagnosing import diagnose
    from roadfiber.locating import open_street
    from roadfiber.stretching import diagnose_stretches

    run = open_street(job.run)
    found = diagnose_stretches(run) if run.too_long else diagnose(run)
    found.save(job.run)
    return f"{found.verdict}: {found.headline}", {"verdict": found.verdict, "effect": found.effect}


def diagnosed(job: Job, site: Site) -> list[Path]:
    """The file that a diagnosis leaves: another one of a long fiber."""
    stretches = job.run / "stretches.json"
    return [stretches if stretches.is_file() else job.run / "diagnosis.json"]


@dataclass(frozen=True)
class Step:
    """A step of a batch.

    Parameters
    ----------
    after : steps that must be over before it
    inputs : checksum of what it depends on
    run : does it; a line on its result, and facts
    left : files that must be there for it to be kept
    wanted : whether a site needs it
    """

    after: tuple[str, ...]
    inputs: Callable[[Job, Site], str]
    run: Callable[[Job, Site], tuple[str, dict[str, Any]]]
    left: Callable[[Job, Site], list[Path]]
    wanted: Callable[[Site], bool] = lambda site: True


STEPS = {
    "ingest": Step((), ingest_inputs, ingest_step, lambda job, site: [site.das.store / "store.json"]),
    "track": Step((), track_inputs, track_step, lambda job, site: list(tables(job)), needs_tracking),
    "locate": Step(("ingest", "track"), locate_inputs, locate_step, lambda job, site: [job.run / "fit.json"]),
    "diagnose": Step(("locate",), diagnose_inputs, diagnose_step, diagnosed, has_effects),
}


def read_stamp(job: Job, step: str) -> dict[str, Any]:
    """What a finished step left; empty where there is nothing, or nothing that can be read."""
    try:
        found = json.loads((job.state / f"{step}.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) and {"inputs", "left", "words", "facts"} <= set(found) else {}


def is_kept(job: Job, site: Site, step: Step, stamp: dict[str, Any], inputs: str) -> bool:
    """Whether a step was done before from the same inputs, and what it left is still as it was."""
    left = step.left(job, site)
    return (
        bool(stamp)
        and stamp["inputs"] == inputs
        and all(one.is_file() for one in left)
        and (stamp["left"] == checksum_of(states(left)))
    )


def take(job: Job, name: str, before: Sequence[Outcome]) -> Outcome:
    """Take one step of one site: the task that a worker runs.

    Parameters
    ----------
    job : the site
    name : of the step
    before : outcomes of the steps before it

    Raises
    ------
    OSError, MemoryError
        That may pass: the scheduler tries again. Any other error is an outcome.
    """
    if any(one.status in (FAILED, LEFT) for one in before):
        return Outcome(job.name, name, LEFT)
    begun, cpu = clock.perf_counter(), clock.process_time()
    try:
        status, words, facts = taken(job, name)
    except PASSING:
        raise
    except Exception as error:
        said = str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}"
        status, words, facts = FAILED, said, {}
    return Outcome(job.name, name, status, words, clock.perf_counter() - begun, clock.process_time() - cpu, facts)


def taken(job: Job, name: str) -> tuple[str, str, dict[str, Any]]:
    """Status, words and facts of a step."""
    step, site = STEPS[name], job.read()
    if not step.wanted(site):
        return NOTHING, "", {}
    inputs, stamp = step.inputs(job, site), read_stamp(job, name)
    if is_kept(job, site, step, stamp, inputs):
        return KEPT, stamp["words"], stamp["facts"]
    words, facts = step.run(job, site)
    stamp = {"inputs": inputs, "left": checksum_of(states(step.left(job, site))), "words": words, "facts": facts}
    with writing(job.state / f"{name}.json") as path:
        path.write_text(json.dumps(stamp, indent=1), encoding="utf-8")
    return DONE, words, facts
