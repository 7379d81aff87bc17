"""A survey's site.toml in the making: what stands in its fields, and the text that comes of it."""

import json
import tomllib
from dataclasses import dataclass, fields, replace
from datetime import datetime
from pathlib import Path
from typing import Any

from vision.contract import InputError
from vision.contract.text import moment

#: Files of a record that are looked for in a folder, and at most one level below.
DAS_KINDS = ("h5", "hdf5", "tdms", "sgy", "segy", "npy", "npz")
VIDEO_KINDS = ("mp4", "mkv", "avi", "mov")


@dataclass(frozen=True)
class Draft:
    """Fields of a site.toml as text; what is empty is left out.

    Parameters
    ----------
    name : of the survey
    origin, azimuth : "latitude, longitude" of x = y = 0, degrees, and the azimuth of +x
    das : files or patterns, by comma
    gauge_length, channel_spacing, quantity : of the record, where its files do not say them
    tracks, anchors : files
    video, calibration, start : of the camera
    kept : section and line of what else a site.toml says, which no field shows
    """

    name: str = ""
    origin: str = ""
    azimuth: str = ""
    das: str = ""
    gauge_length: str = ""
    channel_spacing: str = ""
    quantity: str = ""
    tracks: str = ""
    video: str = ""
    calibration: str = ""
    start: str = ""
    anchors: str = ""

    kept: tuple[tuple[str, str], ...] = ()

    def text(self) -> str:
        """The site.toml.

        Raises
        ------
        InputError
            If a number or a time is none.

        >>> kept = (("ground", "depth = 1"),)
        >>> draft = Draft(name="Elm", origin="32.1, 34.8", azimuth="78", das="das/*.h5", kept=kept)
        >>> print(draft.text())
        name = "Elm"
        <BLANKLINE>
        [frame]
        origin = [32.1, 34.8]
        x_azimuth = 78.0
        <BLANKLINE>
        [das]
        files = ["das/*.h5"]
        <BLANKLINE>
        [ground]
        depth = 1
        <BLANKLINE>
        """
        parts: dict[str, dict[str, Any]] = {
            "frame": {"origin": numbers(self.origin, "origin", 2), "x_azimuth": number(self.azimuth, "azimuth")},
            "das": {
                "files": listed(self.das),
                "gauge_length": number(self.gauge_length, "gauge length") if self.gauge_length else None,
                "channel_spacing": number(self.channel_spacing, "channel spacing") if self.channel_spacing else None,
                "quantity": self.quantity or None,
            },
        }
        if self.video or self.calibration:
            parts["camera"] = {
                "video": self.video,
                "calibration": self.calibration,
                "start": moment(self.start, "start of the video"),
            }
        if self.tracks:
            parts["trajectories"] = {"files": listed(self.tracks)}
        if self.anchors:
            parts["anchors"] = {"file": self.anchors}
        lines = [f"name = {toml(self.name)}"] if self.name else []
        for section in dict.fromkeys([*parts, *(name for name, _ in self.kept)]):
            told = [f"{key} = {toml(value)}" for key, value in parts.get(section, {}).items() if value is not None]
            told += [line for name, line in self.kept if name == section and (section in parts or section not in MINE)]
            lines += ["", f"[{section}]", *told] if told else []
        return "\n".join(lines).lstrip("\n") + "\n"


def toml(value: Any) -> str:
    """A value as TOML: text, number, truth, time, or a list of them."""
    if isinstance(value, datetime):
        return value.isoformat().replace("+00:00", "Z")
    return json.dumps(value, ensure_ascii=False)


def listed(text: str) -> list[str]:
    """Names by comma or line.

    >>> listed("a.h5, das/*.h5")
    ['a.h5', 'das/*.h5']
    """
    return [one.strip() for one in text.replace("\n", ",").split(",") if one.strip()]


def number(text: str, what: str) -> float:
    """A number; InputError where it is none."""
    try:
        return float(text)
    except ValueError as error:
        raise InputError(f"{what}: {text!r} is no number; give one such as 10.0") from error


def numbers(text: str, what: str, count: int) -> list[float]:
    """So many numbers by comma; InputError where they are not."""
    found = [number(one, what) for one in listed(text)]
    if len(found) != count:
        raise InputError(f"{what}: give {count} numbers, as 32.113, 34.804")
    return found


def found_in(folder: Path) -> Draft:
    """What a folder seems to hold: its site.toml where there is one, else files by their kinds.

    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> (folder / "das").mkdir()
    >>> for name in ("das/a.h5", "street.mp4", "trajectories.csv", "anchors.csv"):
    ...     (folder / name).touch()
    >>> one = found_in(folder)
    >>> one.das, one.video, one.tracks, one.anchors
    ('das/*.h5', 'street.mp4', 'trajectories.csv', 'anchors.csv')
    """
    if (folder / "site.toml").is_file():
        return read_draft(folder / "site.toml")
    draft = Draft(name=folder.resolve().name)
    places = ["", *(f"{one.name}/" for one in sorted(folder.iterdir()) if one.is_dir() and one.name[0] != ".")]
    patterns = [f"{place}*.{kind}" for place in places for kind in DAS_KINDS]
    das = next((one for one in patterns if any(folder.glob(one))), "")
    videos = sorted(one.name for one in folder.iterdir() if one.suffix[1:].lower() in VIDEO_KINDS)
    names = {"tracks": "trajectories.csv", "calibration": "calibration.json", "anchors": "anchors.csv"}
    there: dict[str, Any] = {field: name for field, name in names.items() if (folder / name).is_file()}
    return replace(draft, das=das, video=videos[0] if videos else "", **there)


def read_draft(path: Path) -> Draft:
    """The fields of a site.toml that is there; empty ones where it is damaged."""
    try:
        known = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        return Draft(name=path.resolve().parent.name)

    def of(section: str, key: str) -> str:
        table = known.get(section)
        value = table.get(key, "") if isinstance(table, dict) else ""
        return ", ".join(map(str, value)) if isinstance(value, list) else str(value)

    start = of("camera", "start").replace("+00:00", "Z").replace(" ", "T", 1)
    shown: dict[str, Any] = {field: of(*at) for field, at in PLACES.items()}
    kept = tuple(
        (section, f"{key} = {toml(value)}")
        for section, values in known.items()
        if isinstance(values, dict)
        for key, value in values.items()
        if (section, key) not in {*PLACES.values(), ("camera", "start")} and not isinstance(value, dict)
    )
    return Draft(name=str(known.get("name", "")), start=start, kept=kept, **shown)


#: Where in site.toml a field stands, but for the name and the start of the video.
PLACES = {
    "origin": ("frame", "origin"),
    "azimuth": ("frame", "x_azimuth"),
    "das": ("das", "files"),
    "gauge_length": ("das", "gauge_length"),
    "channel_spacing": ("das", "channel_spacing"),
    "quantity": ("das", "quantity"),
    "tracks": ("trajectories", "files"),
    "video": ("camera", "video"),
    "calibration": ("camera", "calibration"),
    "anchors": ("anchors", "file"),
}
#: Sections that the fields write.
MINE = {section for section, _ in PLACES.values()}
#: Names of the fields.
FIELDS = tuple(one.name for one in fields(Draft) if one.name != "kept")
