"""What of roadfiber works on this machine, and what is missing for what."""

import os
import platform
import shutil
import sys
import tempfile
import webbrowser
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, distributions, packages_distributions, requires, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from packaging.requirements import Requirement

from roadfiber.own_packages import OWN, foreign

if TYPE_CHECKING:
    import pandas as pd

#: What each extra is for.
PURPOSES = {
    "workbench": "pages in the browser: `calibrate page`",
    "cluster": "many surveys on many machines",
    "gis": "GeoPackage, DXF and other files of maps",
    "docs": "`make docs`",
    "dev": "`make test`",
}
OPENCV = "opencv-contrib-python-headless"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "firefox")


@dataclass(frozen=True)
class Check:
    """One thing that was looked at.

    Parameters
    ----------
    name : of it
    state : "ok", "missing" (something optional is not there) or "broken" (roadfiber needs it)
    found : what was found
    mend : what to do about it; empty where nothing is to be done
    """

    name: str
    state: str
    found: str
    mend: str = ""


@dataclass(frozen=True, repr=False)
class Checkup:
    """What works on this machine.

    Parameters
    ----------
    checks : everything that was looked at
    """

    checks: tuple[Check, ...]

    @property
    def healthy(self) -> bool:
        """Whether all that roadfiber needs is there."""
        return all(one.state != "broken" for one in self.checks)

    @property
    def table(self) -> "pd.DataFrame":
        """A row per check: name, state, found, mend."""
        import pandas as pd

        return pd.DataFrame([asdict(one) for one in self.checks])

    @property
    def facts(self) -> dict[str, Any]:
        """What `roadfiber doctor --json` prints."""
        return {"healthy": self.healthy, "checks": [asdict(one) for one in self.checks]}

    def lines(self) -> list[str]:
        """What a terminal shows."""
        wide = max(len(one.name) for one in self.checks)
        return [
            f"{one.state:8}{one.name:{wide}}  {one.found}{f'; {one.mend}' if one.mend else ''}" for one in self.checks
        ]

    def __repr__(self) -> str:
        return "\n".join(self.lines())


def doctor() -> Checkup:
    """Look at what roadfiber needs on this machine: versions, packages, ONNX providers, fonts, browser, cache, extras.

    Returns
    -------
    checkup : `healthy`, `table`, and `lines()` that say what is missing for what

    Examples
    --------
    >>> found = rf.doctor()
    >>> found.table["name"].tolist()[:2], found.healthy
    (['python', 'roadfiber'], True)
    """
    return Checkup(tuple(checks()))


def checks() -> Iterator[Check]:
    """Everything that is looked at, in order."""
    yield Check("python", "ok", f"{platform.python_version()} on {platform.system()} {platform.machine()}")
    yield Check("roadfiber", "ok", f"{version('roadfiber')} in {Path(__file__).parents[1]}")
    yield own_packages()
    yield core()
    yield opencv()
    yield from (torch_check(), onnx(), fonts(), browser(), cache(), cores())
    yield from map(extra, extras())


def own_packages() -> Check:
    """That no other package has a name of roadfiber's."""
    wrong = foreign(Path(__file__).parents[1])
    owners = packages_distributions()
    others = sorted({one for name in OWN for one in owners.get(name, []) if one != "roadfiber"})
    if others:
        wrong.append(f"{', '.join(others)} install packages of the same names over them; remove these, install again")
    if wrong:
        return Check("own packages", "broken", "; ".join(wrong))
    return Check("own packages", "ok", f"{', '.join(OWN)} are roadfiber's")


def needs(of_extra: str | None) -> list[Requirement]:
    """What roadfiber requires by itself, or for one extra, on this machine."""
    every = [Requirement(text) for text in requires("roadfiber") or []]
    found = []
    for one in every:
        for_extra = one.marker is not None and "extra" in str(one.marker)
        if of_extra is None and not for_extra and (one.marker is None or one.marker.evaluate()):
            found.append(one)
        if of_extra is not None and for_extra and one.marker is not None and one.marker.evaluate({"extra": of_extra}):
            found.append(one)
    return found


def unmet(wanted: list[Requirement]) -> list[str]:
    """Requirements that are not met, with the version that is there."""
    found = []
    for one in wanted:
        try:
            there = version(one.name)
        except PackageNotFoundError:
            found.append(str(one.name))
            continue
        if not one.specifier.contains(there, prereleases=True):
            found.append(f"{one.name}{one.specifier} (there is {there})")
    return found


def core() -> Check:
    """The packages that roadfiber cannot do without."""
    wanted = needs(None)
    if missing := unmet(wanted):
        return Check("packages", "broken", f"not there: {', '.join(missing)}", "pip install roadfiber")
    return Check(
        "packages", "ok", f"all {len(wanted)}: " + ", ".join(f"{one.name} {version(one.name)}" for one in wanted)
    )


def opencv() -> Check:
    """That OpenCV is the build that roadfiber needs, and alone: others overwrite its files without pip noticing."""
    there = sorted({name for d in distributions() if (name := (d.metadata["Name"] or "").lower()).startswith("opencv")})
    if there != [OPENCV]:
        mend = f"pip uninstall {' '.join(there)}; pip install {OPENCV}"
        return Check("opencv", "broken", f"there are {', '.join(there) or 'none'}; only {OPENCV} may be", mend)
    return Check("opencv", "ok", f"{OPENCV} alone")


def torch_check() -> Check:
    """Whether PyTorch computes."""
    try:
        import torch

        works = float(torch.ones(2, dtype=torch.float64).sum()) == 2.0
    except (ImportError, OSError) as error:
        return Check("pytorch", "broken", str(error).splitlines()[0], "install the CPU build of PyTorch")
    return Check("pytorch", "ok" if works else "broken", f"{torch.__version__}, {torch.get_num_threads()} threads")


def onnx() -> Check:
    """What runs detectors."""
    try:
        import onnxruntime
    except ImportError as error:
        return Check("onnx providers", "broken", str(error), "pip install onnxruntime")
    names = [one.removesuffix("ExecutionProvider") for one in onnxruntime.get_available_providers()]
    return Check("onnx providers", "ok", ", ".join(names))


def fonts() -> Check:
    """What pictures are labeled in."""
    from matplotlib import rcParams
    from matplotlib.font_manager import findfont

    name = rcParams["font.sans-serif"][0]
    try:
        path = findfont(name, fallback_to_default=False)
    except ValueError:
        return Check("fonts", "missing", f"no {name}", "pictures are labeled in another font; reinstall matplotlib")
    return Check("fonts", "ok", f"{name} ({Path(path).name})")


def browser() -> Check:
    """What opens pages; they are files, and can be opened elsewhere."""
    path = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if path is None:
        try:
            path = webbrowser.get().__class__.__name__
        except webbrowser.Error:
            mend = "needed for `calibrate page`; reports can be opened on another machine"
            return Check("browser", "missing", "none found", mend)
    return Check("browser", "ok", path)


def cache() -> Check:
    """Whether detections can be kept for a second look."""
    from vision.cache import cache_folder

    folder = cache_folder()
    mend = "name a folder that can be written with ROADFIBER_CACHE; until then a second look at a video takes as long"
    if folder is None:
        return Check("cache", "missing", "this user has no home", mend)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        return Check("cache", "missing", f"{folder}: {error.strerror}", mend)
    return Check("cache", "ok", f"{folder}, {shutil.disk_usage(folder).free / 1e9:.0f} GB free")


def cores() -> Check:
    """What a diagnosis can use."""
    forks = sys.platform == "linux"
    count = len(os.sched_getaffinity(0)) if forks else os.cpu_count() or 1
    return Check(
        "cores", "ok", f"{count}" if forks else f"{count}, of which a diagnosis uses one: it forks on Linux only"
    )


def extras() -> list[str]:
    """Names of roadfiber's extras, as its own metadata have them."""
    from importlib.metadata import metadata

    return sorted(metadata("roadfiber").get_all("Provides-Extra") or [])


def extra(name: str) -> Check:
    """Whether an extra is installed."""
    purpose = PURPOSES.get(name, "")
    missing = unmet([one for one in needs(name) if one.name != "roadfiber"])
    if missing:
        return Check(f"[{name}]", "missing", f"{', '.join(missing)}: for {purpose}", f"pip install 'roadfiber[{name}]'")
    return Check(f"[{name}]", "ok", f"for {purpose}")
