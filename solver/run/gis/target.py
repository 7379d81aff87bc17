"""The coordinates that a route is written in: any CRS that pyproj knows, with or without heights."""

from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vision.contract import InputError, LocalFrame

Array = NDArray[np.float64]

#: Longitude and latitude, WGS 84.
DEGREES = "EPSG:4326"
DEPTHS = "minus the depth below the road"
#: Abbreviations of the units that pyproj names.
UNITS = {"metre": "m", "foot": "ft", "US survey foot": "ftUS"}


@dataclass(frozen=True)
class Target:
    """A CRS, and what a height is in it.

    Parameters
    ----------
    crs : `pyproj.CRS`
    ground_height : of the road in the vertical CRS, m, whatever its unit; None: the third number is minus the depth
        below the road
    """

    crs: Any
    ground_height: float | None = None

    @classmethod
    def of(cls, crs: str | int = DEGREES, ground_height: float | None = None) -> "Target":
        """The target that a user names.

        Parameters
        ----------
        crs : as pyproj reads it: "EPSG:2039", 2039, "EPSG:2039+5773" with a vertical CRS, or WKT
        ground_height : of the road, in that vertical CRS

        Raises
        ------
        InputError
            If pyproj does not know it, or a vertical CRS comes without the height of the road: a route has depths.

        >>> Target.of("EPSG:32636").horizontal.to_epsg()
        32636
        """
        from pyproj import CRS
        from pyproj.exceptions import CRSError

        try:
            known = CRS.from_user_input(crs)
        except CRSError as error:
            raise InputError(f"--crs {crs}: not known to pyproj; give one as EPSG:2039 or EPSG:2039+5773") from error
        if not (known.is_geographic or known.is_projected):
            raise InputError(f"--crs {crs}: no coordinates on a map; give one as EPSG:32636")
        high = len(known.axis_info) == 3
        if high and known.axis_info[-1].direction != "up":
            raise InputError(f"--crs {crs}: its third axis points down; give a vertical CRS of heights, as EPSG:5703")
        if high and ground_height is None:
            raise InputError(
                f"--crs {crs}: has heights, and a route has depths below the road; give the road's height in it with "
                "--ground-height, m"
            )
        if ground_height is not None and not high:
            raise InputError(f"--ground-height: --crs {crs} has no heights; add a vertical CRS, as EPSG:2039+5773")
        if ground_height is not None and not np.isfinite(ground_height):
            raise InputError("--ground-height: give a number of meters")
        return cls(known, ground_height)

    @property
    def horizontal(self) -> Any:
        """Its horizontal part."""
        return self.crs.to_2d() if not self.crs.is_compound else self.crs.sub_crs_list[0]

    @property
    def degrees(self) -> bool:
        """Whether it counts in degrees."""
        return bool(self.crs.is_geographic)

    @property
    def is_wgs84(self) -> bool:
        """Whether it is longitude and latitude in WGS 84 without heights."""
        return self.ground_height is None and self.horizontal.to_epsg() == 4326

    @property
    def names(self) -> tuple[str, str]:
        """What its horizontal coordinates are called, with the unit of lengths."""
        return ("longitude", "latitude") if self.degrees else (f"easting_{self.unit}", f"northing_{self.unit}")

    @property
    def unit(self) -> str:
        """Unit of the horizontal coordinates."""
        return unit_of(self.horizontal.axis_info[0])

    @property
    def third_unit(self) -> str:
        """Unit of the third number: that of its axis, else of the others, else meters.

        >>> Target.of("EPSG:2263+6360", 20.0).third_unit, Target.of("EPSG:2263").third_unit, Target.of().third_unit
        ('ftUS', 'ftUS', 'm')
        """
        return unit_of(self._third_axis) if self._third_axis else "m"

    @property
    def _third_axis(self) -> Any:
        return None if self.degrees and self.ground_height is None else self.crs.axis_info[-1]

    @property
    def third(self) -> str:
        """What the third number is, in words."""
        if self.ground_height is None:
            return f"{DEPTHS}, {self.third_unit}"
        return f"height, {self.third_unit}, with the road at {self.ground_height:g} m"

    def cautions(self, frame: LocalFrame) -> list[str]:
        """What the EPSG registry states against coordinates in it at a survey's place.

        >>> Target.of("EPSG:32736").cautions(LocalFrame((32.0, 34.8), 90.0))
        ['--crs WGS 84 / UTM zone 36S is for longitudes 30 to 36, latitudes -80 to 0, and the survey is at longitude \
34.8, latitude 32: is it the one that was meant?']
        """
        from pyproj import Transformer
        from pyproj.exceptions import ProjError

        latitude, longitude = frame.origin
        lines = []
        area = self.horizontal.area_of_use
        if area and not (
            area.south <= latitude <= area.north
            and (longitude - area.west) % 360 <= ((area.east - area.west) % 360 or 360)
        ):
            lines.append(
                f"--crs {self.crs.name} is for longitudes {area.west:g} to {area.east:g}, latitudes {area.south:g} to "
                f"{area.north:g}, and the survey is at longitude {longitude:g}, latitude {latitude:g}: is it the one "
                "that was meant?"
            )
        move = Transformer.from_crs(4326, self.horizontal, always_xy=True)
        move.transform(longitude, latitude)
        accuracy = move.accuracy
        if accuracy < 0:  # of several ways, the one that this place takes; where there is one, it is not asked for
            with suppress(ProjError):
                accuracy = move.get_last_used_operation().accuracy
        if accuracy:
            size = f"good to {accuracy:g} m" if accuracy > 0 else "of unknown accuracy"
            lines.append(f"--crs {self.crs.name}: the step from WGS 84 to its datum is {size}; no sigma includes that")
        return lines

    def datum(self, frame: LocalFrame) -> str:
        """What the files say of the datum: how exactly its coordinates can be known, whatever the sigmas.

        >>> Target.of("EPSG:2039").datum(LocalFrame((32.0, 34.8), 90.0)).partition(". ")[2]
        'Israel 1993 / Israeli TM Grid: the step from WGS 84 to its datum is good to 0.5 m; no sigma includes that.'
        """
        from pyproj import CRS

        source = CRS.from_user_input(DEGREES).to_json_dict()["datum_ensemble"]
        first = (
            "Places were given in WGS 84 without a realization or an epoch; its realizations agree to "
            f"{float(source['accuracy']):g} m, and no sigma includes that"
        )
        return "".join(f"{line.removeprefix('--crs ')}. " for line in (first, *self.cautions(frame))).rstrip()

    def points(self, frame: LocalFrame, places: Array) -> Array:
        """Local places [point, 3] (x, y, depth z, m) -> east or longitude, north or latitude, third [point, 3].

        Each is in the unit of its axis.

        >>> there = Target.of("EPSG:32636").points(LocalFrame((32.0, 34.8), 90.0), np.array([[0.0, 0.0, 0.9]]))
        >>> there.round(1).tolist()
        [[670032.0, 3541851.3, -0.9]]
        """
        from pyproj import Transformer

        latitude, longitude = frame.to_geographic(places[:, 0], places[:, 1])
        move = Transformer.from_crs(4326, self.horizontal, always_xy=True)
        first, second = move.transform(longitude, latitude)
        third = (self.ground_height or 0.0) - places[:, 2]
        if self._third_axis:
            third = third / self._third_axis.unit_conversion_factor
        found = np.column_stack([first, second, third])
        if not np.isfinite(found[:, :2][np.isfinite(places[:, :2]).all(1)]).all():
            raise InputError(f"--crs {self.crs.name}: does not reach the survey; give one of its region")
        return found


def unit_of(axis: Any) -> str:
    """Unit of an axis, as a column's name can hold it."""
    return UNITS.get(axis.unit_name, axis.unit_name.replace(" ", "_"))
