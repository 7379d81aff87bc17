"""A located drive: what `locate` returns of a survey with `[route]`."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from solver.fit.result import Placed
from solver.run.geojson import feature, positions, route_features
from solver.run.located_fiber import LocatedFiber
from solver.run.route_table import route_table
from solver.run.titles import probability_words
from solver.survey.anchors import Anchor
from vision.contract import LocalFrame, require_writable, writing

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

#: CSS pixels of a figure in a notebook.
WIDTH = 960


@dataclass(frozen=True, eq=False, repr=False)
class DriveRun(LocatedFiber):
    """A located drive.

    Parameters
    ----------
    frame : the local frame of all x, y
    facts : the content of fit.json
    arrays : by name, see `solver.drive.drive_folder.EXPECTED`
    anchors : known points of the fiber
    folder : that it was opened from; None where it was not
    """

    frame: LocalFrame
    facts: dict[str, Any]
    arrays: Mapping[str, NDArray[Any]]
    anchors: list[Anchor]
    folder: Path | None = None

    @property
    def warnings(self) -> list[str]:
        """What must be known of record and tracks, and what a second drive or tap test should look at; a line each."""
        return list(self.facts["next"])

    @property
    def clock_offset(self) -> float:
        """The record's clock less the GPS's, s."""
        return float(self.facts["parameters"]["clock_offset"]["value"])

    @property
    def misstated(self) -> "pd.DataFrame":
        """What files may state wrongly, the most probable first.

        effect, title, value and sigma (relative), shows (the size from which on it would be named), probability (NaN
        where it is fitted), fitted, words.
        """
        import pandas as pd

        columns = ["effect", "title", "value", "sigma", "shows", "probability", "fitted", "words"]
        return pd.DataFrame(self.facts["misstated"], columns=columns).astype({"probability": float})

    def told(self) -> list[str]:
        """The same in lines, and what to do."""
        lines = [f"{one['title']}, {how_probable(one)}: {one['words']}" for one in self.facts["misstated"]]
        gate = next(one for one in self.facts["trust"]["gates"] if one["name"] == "stated")
        return lines + [f"next: {one}" for one in gate["mend"] if gate["verdict"] == "failed"]

    @cached_property
    def placed(self) -> Placed:
        """The route and its covariance."""
        arrays: dict[str, Any] = {name: self.arrays[name] for name in PLACED}
        return Placed(**arrays, **self._judged)

    @property
    def route(self) -> "pd.DataFrame":
        """The route [channel].

        channel, distance, x, y, z, their sigmas (m), latitude, longitude, constrained, as of every run; `loop`, whether
        the channel is of slack in a manhole; `along` the map and `sigma_along`, m; `heard`, whether it heard the car.
        """
        table = route_table(self.placed, self.frame)
        more = {name: self.arrays[name] for name in ("loop", "along", "sigma_along", "heard")}
        return table.assign(**more)

    @property
    def loops(self) -> "pd.DataFrame":
        """Loops of slack: first and last channel, length and its sigma (m), place along the map (m), x, y, lat, lon."""
        import pandas as pd

        return pd.DataFrame(self.facts["loops"], columns=LOOP)

    def plot(self, width: int = WIDTH) -> "Figure":
        """Draw the channel map: slack along the path, with its band and loops; width in CSS pixels."""
        from solver.drive.drive_figures import channel_figure

        return channel_figure(self, width)

    def to_geojson(self, path: Path | str) -> None:
        """Write the route, its 95 % corridor, loops and anchors, WGS 84; InputError where it cannot be written."""
        require_writable(Path(path))
        with writing(Path(path)) as temporary:
            temporary.write_text(json.dumps(self.features(), allow_nan=False), encoding="utf-8")

    @cached_property
    def straight(self) -> Placed:
        """The route without channels in loops: those of one manhole are one point, and have no direction."""
        kept = ~np.asarray(self.arrays["loop"], bool)
        return Placed(**{name: self.arrays[name][kept] for name in PLACED}, **self._judged)

    @property
    def _judged(self) -> dict[str, Any]:
        """What the checks say, as `Placed` takes it."""
        return {"grade": self.facts["trust"]["grade"], "trust": self.facts["trust"]["sentence"]}

    def features(self) -> dict[str, Any]:
        """The content of route.geojson."""
        found = route_features(self.straight, self.frame, self.anchors, self.name)
        for one in self.facts["loops"]:
            point = positions(self.frame, np.array([[one["x"], one["y"]]]))[0]
            found["features"].append(feature("Point", point, what="loop of slack", **one))
        return found

    def to_gis(self, *paths: Path | str, crs: str | int = "EPSG:4326", ground_height: float | None = None) -> None:
        """Write the route for a GIS or CAD, with accuracy classes; as `Run.to_gis`."""
        from solver.run.gis.export import export
        from solver.run.gis.layers import Subject

        subject = Subject(self.straight, self.frame, self.anchors, self.name, str(self.facts["start"])[:10])
        export(subject, paths, crs, ground_height)

    def to_patch(self, patch: Any) -> Any:
        """A DASCore patch of the record with the route as coordinates along its distance; as `Run.to_patch`."""
        from solver.run.gis.patch_coords import with_route

        return with_route(patch, self.route)

    def save(self, folder: Path | str) -> None:
        """Write the run folder, whole or not at all; InputError where `folder` holds something else than a run."""
        from solver.drive.drive_folder import write_drive_run

        write_drive_run(Path(folder), self)

    def __repr__(self) -> str:
        return f"<DriveRun {self.name}: {self.headline} {self.trust}>"

    def _repr_html_(self) -> str:
        from solver.drive.drive_page import drive_page
        from vision.contract.notebook import framed

        return framed(drive_page(self))


def how_probable(one: Mapping[str, Any]) -> str:
    """How probable it is that something is stated wrongly, as a clause; one of `misstated` of fit.json.

    >>> how_probable({"probability": 0.9999, "fitted": False}), how_probable({"probability": None, "fitted": True})
    ('above 99.9 % probable to be wrong', 'fitted')
    """
    if one["fitted"]:
        return "fitted"
    return f"{probability_words(one['probability'])} probable to be wrong"


PLACED = ("channel", "distance", "route", "covariance", "constrained")
LOOP = ("first_channel", "last_channel", "length", "sigma", "along", "x", "y", "latitude", "longitude", "probability")
