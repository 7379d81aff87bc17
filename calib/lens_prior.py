"""Prior of a lens: a weak one, or what `roadfiber calibrate board` measured."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, ValidationError

from vision.camera import Covariance
from vision.contract import InputError, read_text, writing
from vision.lens import NAMES, Lens

Array = NDArray[np.float64]

FOCAL = 0.5  # sd of the logarithm of the focal length over the image's width
CENTER = 0.01  # sd of the principal point, widths of the image
WILD = 20.0  # sd
DOUBT = 0.01  # probability of so unusual a lens, or of so large a misfit, below which it is not believed
RADIAL = {"k1": 0.3, "k2": 0.15, "k3": 0.05}  # sd


@dataclass(frozen=True)
class LensPrior:
    """A Gaussian over `Lens.vector`: mean + factor @ z with z ~ N(0, 1).

    Attributes
    ----------
    mean : [9]
    factor : [9, k]
    known : whether the lens was measured, rather than guessed
    """

    mean: Array
    factor: Array
    known: bool

    @property
    def size(self) -> int:
        """Count of free parameters."""
        return self.factor.shape[1]

    def lens(self, z: Array) -> Lens:
        """Lens at z [k]; trials are clipped to `WILD`, so that numbers stay finite."""
        return Lens.from_vector(self.mean + self.factor @ np.clip(z, -WILD, WILD))

    def slope(self, z: Array) -> Array:
        """Derivative [9, k] of the lens's `vector` by z [k]."""
        return np.asarray(self.factor * (np.abs(z) < WILD))

    def doubt(self, lens: Lens) -> str | None:
        """Say why a lens is implausible; None where it is not.

        >>> weak_prior((1920, 1080)).doubt(Lens(focal=(1900.0, 1900.0), center=(576.0, 540.0)))
        'the camera is implausible: focal length 1900 px, principal point at 576, 540 px, 20 standard deviations from \
what is usual'
        """
        from scipy.stats import chi2

        z = np.linalg.lstsq(self.factor, lens.vector - self.mean, rcond=None)[0]
        if not self.size or chi2.sf(z @ z, self.size) >= DOUBT:
            return None
        return (
            f"the camera is implausible: focal length {lens.focal[0]:.0f} px, principal point at {lens.center[0]:.0f}, "
            f"{lens.center[1]:.0f} px, {np.sqrt(z @ z):.0f} standard deviations from what "
            f"{'was measured' if self.known else 'is usual'}"
        )


def weak_prior(image_size: tuple[int, int]) -> LensPrior:
    """Square pixels, principal point near the middle, a field of view of 20 to 105 degrees, some radial distortion.

    >>> round(weak_prior((1280, 720)).lens(np.zeros(6)).focal[0], 6)
    1280.0
    """
    width, height = image_size
    mean = Lens(focal=(width, width), center=(width / 2, height / 2)).vector
    factor = np.zeros((9, 6))
    factor[:2, 0] = FOCAL
    factor[2, 1] = factor[3, 2] = CENTER * width
    for column, (name, deviation) in enumerate(RADIAL.items(), start=3):
        factor[NAMES.index(name), column] = deviation
    return LensPrior(mean, factor, known=False)


class Intrinsics(BaseModel):
    """What `roadfiber calibrate board` writes.

    Parameters
    ----------
    image_size : width, height, px
    lens : its lens
    covariance : [9, 9] of `Lens.vector`
    rms_px : reprojection error over all views
    views : file or frame, count of corners and rms, px, of every view
    """

    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True)

    image_size: tuple[int, int]
    lens: Lens
    covariance: Covariance
    rms_px: float
    views: tuple[tuple[str, int, float], ...] = ()

    def write(self, path: str | Path) -> None:
        """Write as JSON, whole or not at all."""
        with writing(path) as temporary:
            temporary.write_text(self.model_dump_json(indent=2) + "\n", encoding="utf-8")

    def prior(self, image_size: tuple[int, int], path: str | Path) -> LensPrior:
        """Prior for pictures of a size; InputError unless it is that of the board's pictures."""
        if image_size != self.image_size:
            raise InputError(
                f"{path}: is of {self.image_size[0]}x{self.image_size[1]} pictures but the video is "
                f"{image_size[0]}x{image_size[1]}; film the board with the setting that films the road"
            )
        if self.covariance.shape != (9, 9):
            raise InputError(f"{path}: covariance must have 9 rows and columns; run roadfiber calibrate board again")
        deviation = np.sqrt(np.diagonal(self.covariance))
        scale = np.where(deviation > 0, deviation, 1.0)
        values, vectors = np.linalg.eigh(self.covariance / np.outer(scale, scale))
        kept = values > 1e-9
        return LensPrior(self.lens.vector, scale[:, None] * vectors[:, kept] * np.sqrt(values[kept]), known=True)


def read_intrinsics(path: str | Path) -> Intrinsics:
    """Read what `roadfiber calibrate board` wrote; InputError if it is not one."""
    try:
        return Intrinsics.model_validate_json(read_text(Path(path), "what roadfiber calibrate board wrote"))
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise InputError(
            f"{path}: {place} {first['msg'].lower()}; give what roadfiber calibrate board wrote"
        ) from error
