"""What a row of each table is: columns, units, and which may be absent. What is empty in a csv file is absent here."""

from typing import Annotated

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(gt=0)]
Latitude = Annotated[float, Field(ge=-90, le=90)]
Longitude = Annotated[float, Field(ge=-180, le=180)]


class Row(BaseModel):
    """A row that roadfiber writes; other columns are errors."""

    model_config = ConfigDict(extra="forbid")


class OpenRow(BaseModel):
    """A row that people write too; further columns are kept and not used."""

    model_config = ConfigDict(extra="allow")


class TrajectoryRow(OpenRow):
    """One fix of one vehicle; with `latitude`, `longitude`, `sigma` in place of the last four columns, a GPS fix.

    Attributes
    ----------
    time : ISO 8601 with a zone; or a number of s, ms, us or ns since 1970, UTC
    track_id : of the vehicle, one per pass
    vehicle_class : car, van, truck, bus, motorcycle, bicycle ... (column `class`); it gives the wheels
    x, y : place of the vehicle's middle in the local frame, m
    sigma_x, sigma_y : their standard deviations, m
    latitude, longitude : in place of x, y: WGS 84, degrees
    sigma : in place of sigma_x, sigma_y: of each horizontal coordinate, m
    wheelbase, sigma_wheelbase : of the vehicle, m, where they are known better than by its class
    speed : along the smoothed track, m/s; written by `track`, not read
    """

    time: AwareDatetime | float
    track_id: str
    vehicle_class: str = Field(alias="class")
    x: float | None = None
    y: float | None = None
    sigma_x: Positive | None = None
    sigma_y: Positive | None = None
    latitude: Latitude | None = None
    longitude: Longitude | None = None
    sigma: Positive | None = None
    wheelbase: Positive | None = None
    sigma_wheelbase: Positive | None = None
    speed: float | None = None


class AnchorRow(OpenRow):
    """A point of the fiber whose channel and place are known, from a manhole or a tap test.

    Attributes
    ----------
    name : of the manhole or tap
    channel : as the DAS file counts; a fraction is a place between two channels
    x, y : in the local frame, m
    latitude, longitude : in place of x, y: WGS 84, degrees
    z : depth of the fiber below the road, m
    sigma_xy : standard deviation of each horizontal coordinate, m
    sigma_z : of the depth, m
    """

    name: str
    channel: float
    x: float | None = None
    y: float | None = None
    latitude: Latitude | None = None
    longitude: Longitude | None = None
    z: float
    sigma_xy: Positive
    sigma_z: Positive


class PointRow(OpenRow):
    """A control point: a mark on the road whose pixel and place are known.

    Attributes
    ----------
    name : of the mark
    px, py : from the top left of the picture, right and down, px
    x, y : in the local frame, m
    latitude, longitude : in place of x, y: WGS 84, degrees
    easting, northing : in place of x, y: m
    zone : of easting and northing in UTM, as 36N
    sigma : accuracy of the pixel, px; 1 where absent
    sigma_xy : accuracy of the place, m; where absent 0.05 for x, y, else 0.3
    z : depth of the mark below the road, m: -0.15 for the top of a curb; 0 where absent
    """

    name: str
    px: float
    py: float
    x: float | None = None
    y: float | None = None
    latitude: Latitude | None = None
    longitude: Longitude | None = None
    easting: float | None = None
    northing: float | None = None
    zone: str | None = None
    sigma: Positive | None = None
    sigma_xy: Annotated[float, Field(ge=0)] | None = None
    z: float | None = None


class RouteRow(Row):
    """A channel of the route.

    Attributes
    ----------
    channel : as the DAS file counts
    distance : along the fiber, m
    x, y, z : in the local frame, m; z is the depth below the road
    sigma_x, sigma_y, sigma_z : standard deviations, m, with what the model may lack; empty where the method gives none
    sigma_x_fit, sigma_y_fit, sigma_z_fit : of the fit alone, m, which takes its model for granted; no such columns for
        a drive
    latitude, longitude : WGS 84, degrees
    constrained : whether data and anchors decide the place, and not the prior alone
    trust : grade of the run's checks: good, fair, weak or poor
    reason : why the place is not to be relied on; empty where it may be
    corner : where the fiber turns there, or goes deeper or less deep, in words; empty elsewhere
    """

    channel: int
    distance: float
    x: float
    y: float
    z: float
    sigma_x: Positive | None = None
    sigma_y: Positive | None = None
    sigma_z: Positive | None = None
    sigma_x_fit: Positive | None = None
    sigma_y_fit: Positive | None = None
    sigma_z_fit: Positive | None = None
    latitude: Latitude
    longitude: Longitude
    constrained: bool
    trust: str
    reason: str | None = None
    corner: str | None = None


class ChannelRow(Row):
    """Health of a channel in a store.

    Attributes
    ----------
    channel : as the DAS file counts
    distance : along the fiber, m
    noise : standard deviation of its noise, 1/s; empty where it has no signal
    step : that its values were rounded to, 1/s; 0 where they were not
    dead : 1 where it holds no signal
    bad : samples that are no numbers
    clipped : samples at the ends of the instrument's range
    """

    channel: int
    distance: float
    noise: float | None = None
    step: float | None = None
    dead: Annotated[int, Field(ge=0, le=1)]
    bad: Annotated[int, Field(ge=0)]
    clipped: Annotated[int, Field(ge=0)]


class FileRow(Row):
    """A file that a store was made from.

    Attributes
    ----------
    file : its name
    start, end : of what was used of it, UTC; empty where nothing was
    seconds_used : of it
    left_out : what was left out and why
    """

    file: str
    start: AwareDatetime | None = None
    end: AwareDatetime | None = None
    seconds_used: Annotated[float, Field(ge=0)]
    left_out: str | None = None
