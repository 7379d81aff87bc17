"""What the JSON files hold that the check of a survey's quality writes."""

from typing import Any, Literal

from pydantic import ConfigDict

from roadfiber.written_files import Written


class VehicleFile(Written):
    """A vehicle that the fiber heard.

    Attributes
    ----------
    time : of passing the middle of the channels, UTC
    speed : along x, m/s
    snr_db : signal to noise, dB
    share : of the channels that heard it
    track_id : of its track; empty where no camera saw it
    late : after the track, s
    """

    model_config = ConfigDict(extra="allow")

    time: str
    speed: float
    snr_db: float
    share: float
    track_id: str
    late: float


class HeardFile(Written):
    """What `roadfiber vehicles --json` prints: the vehicles that the fiber heard, and the two clocks.

    Attributes
    ----------
    headline : in a line
    clock_offset, clock_sigma : time by the record less time by the trajectories, and its standard deviation, s
    unheard : tracks that go by and were not heard
    vehicles : that were heard
    """

    headline: str
    clock_offset: float
    clock_sigma: float
    unheard: tuple[str, ...]
    vehicles: tuple[VehicleFile, ...]


class QualityFile(Written):
    """quality.json: how good tables of tracks are, and whether they are good enough for the fiber.

    Attributes
    ----------
    format : of the file
    created : UTC
    version : of roadfiber
    limit_m : the rule's largest jitter, m
    use : name of the table to use
    because, rule : why it, and by which rule
    good_enough : its grade for the fiber
    verdict : in words
    notes, left_out : what else must be known; tables that could not be read
    truth : tracks of the truth by class, where there is one
    settings : a table each: its figures
    inputs : role, name and SHA-256 of each file
    """

    format: Literal["roadfiber track quality 2"]
    created: str
    version: str
    limit_m: float
    use: str
    because: str
    rule: str
    good_enough: Literal["good", "fair", "weak", "poor", "unknown"]
    verdict: str
    notes: tuple[str, ...]
    left_out: tuple[str, ...]
    truth: dict[str, Any] | None
    settings: tuple[dict[str, Any], ...]
    inputs: tuple[dict[str, str], ...]
