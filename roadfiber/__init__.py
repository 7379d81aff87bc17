"""Video and Distributed Acoustic Sensing (DAS) to a fiber route with honest uncertainty.

    import roadfiber as rf

    survey = rf.read("site.toml")              # or rf.Survey(das=patch, tracks=table, anchors=table, frame=...)
    run = rf.locate(survey)
    run.route                                  # DataFrame: channel, x, y, z, sigmas, latitude, longitude ...
    run.save("run")
    print(rf.diagnose(run).verdict)            # which physical effect the model lacks
    better = rf.add(run, "gauge_length")       # or an effect of your own, an object
    rf.ladder(run, better).plot()

What can be mended raises `InputError`. What is heavy (PyTorch, pandas, SciPy, matplotlib) is loaded when a name is
first used.
"""

import os
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from roadfiber.in_notebooks import prepare
from roadfiber.own_packages import require_own

# Read when torch is first imported: threads that spin while they wait make a busy machine four times slower.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
require_own(Path(__file__).parents[1])
prepare()

if TYPE_CHECKING:
    from roadfiber.batching import Batch as Batch
    from roadfiber.batching import batch as batch
    from roadfiber.cameras import Calibrated as Calibrated
    from roadfiber.cameras import Quality as Quality
    from roadfiber.cameras import calibrate as calibrate
    from roadfiber.cameras import quality as quality
    from roadfiber.cameras import track as track
    from roadfiber.checkup import Checkup as Checkup
    from roadfiber.checkup import doctor as doctor
    from roadfiber.combining import Combined as Combined
    from roadfiber.combining import combine as combine
    from roadfiber.comparing import Comparison as Comparison
    from roadfiber.comparing import compare as compare
    from roadfiber.comparing_stretches import StretchComparison as StretchComparison
    from roadfiber.comparing_stretches import compare_stretches as compare_stretches
    from roadfiber.diagnosing import Diagnosis as Diagnosis
    from roadfiber.diagnosing import diagnose as diagnose
    from roadfiber.growing import Ladder as Ladder
    from roadfiber.growing import Story as Story
    from roadfiber.growing import add as add
    from roadfiber.growing import clock_offset as clock_offset
    from roadfiber.growing import explain as explain
    from roadfiber.growing import ladder as ladder
    from roadfiber.ingesting import Ingested as Ingested
    from roadfiber.ingesting import ingest as ingest
    from roadfiber.ingesting import view as view
    from roadfiber.listening import Vehicles as Vehicles
    from roadfiber.listening import vehicles as vehicles
    from roadfiber.locating import locate as locate
    from roadfiber.locating import open as open
    from roadfiber.locating import read as read
    from roadfiber.planning import Plan as Plan
    from roadfiber.planning import plan as plan
    from roadfiber.schemas import schema as schema
    from roadfiber.simulating import Simulated as Simulated
    from roadfiber.simulating import simulate as simulate
    from roadfiber.stretching import StretchDiagnosis as StretchDiagnosis
    from roadfiber.stretching import diagnose_stretches as diagnose_stretches
    from roadfiber.stretching import stretch as stretch
    from roadfiber.studying import Study as Study
    from roadfiber.studying import study as study
    from solver.drive.drive import Drive as Drive
    from solver.drive.drive_run import DriveRun as DriveRun
    from solver.effect import Effect as Effect
    from solver.effect import Parameter as Parameter
    from solver.effect import effect as effect
    from solver.run.run import Run as Run
    from solver.survey.survey import Survey as Survey
    from vision.contract.errors import InputError as InputError
    from vision.contract.frame import LocalFrame as LocalFrame
    from vision.tracked import Tracked as Tracked

#: Name -> module that it is loaded from at its first use.
_HOMES = {
    "Batch": "roadfiber.batching",
    "Calibrated": "roadfiber.cameras",
    "Checkup": "roadfiber.checkup",
    "Combined": "roadfiber.combining",
    "Comparison": "roadfiber.comparing",
    "Diagnosis": "roadfiber.diagnosing",
    "Drive": "solver.drive.drive",
    "DriveRun": "solver.drive.drive_run",
    "Effect": "solver.effect",
    "Ingested": "roadfiber.ingesting",
    "InputError": "vision.contract.errors",
    "Ladder": "roadfiber.growing",
    "LocalFrame": "vision.contract.frame",
    "Parameter": "solver.effect",
    "Plan": "roadfiber.planning",
    "Quality": "roadfiber.cameras",
    "Run": "solver.run.run",
    "Simulated": "roadfiber.simulating",
    "Story": "roadfiber.growing",
    "StretchComparison": "roadfiber.comparing_stretches",
    "StretchDiagnosis": "roadfiber.stretching",
    "Study": "roadfiber.studying",
    "Survey": "solver.survey.survey",
    "Tracked": "vision.tracked",
    "Vehicles": "roadfiber.listening",
    "add": "roadfiber.growing",
    "batch": "roadfiber.batching",
    "calibrate": "roadfiber.cameras",
    "clock_offset": "roadfiber.growing",
    "combine": "roadfiber.combining",
    "compare": "roadfiber.comparing",
    "compare_stretches": "roadfiber.comparing_stretches",
    "diagnose": "roadfiber.diagnosing",
    "diagnose_stretches": "roadfiber.stretching",
    "doctor": "roadfiber.checkup",
    "effect": "solver.effect",
    "explain": "roadfiber.growing",
    "ingest": "roadfiber.ingesting",
    "ladder": "roadfiber.growing",
    "locate": "roadfiber.locating",
    "open": "roadfiber.locating",
    "plan": "roadfiber.planning",
    "quality": "roadfiber.cameras",
    "read": "roadfiber.locating",
    "schema": "roadfiber.schemas",
    "simulate": "roadfiber.simulating",
    "stretch": "roadfiber.stretching",
    "study": "roadfiber.studying",
    "track": "roadfiber.cameras",
    "turn": "roadfiber.growing",
    "vehicles": "roadfiber.listening",
    "view": "roadfiber.ingesting",
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    """Load a public name when it is first used."""
    if name not in _HOMES:
        raise AttributeError(f"module 'roadfiber' has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Names that the package offers."""
    return sorted({*globals(), *_HOMES})
