"""The camera calibration: pixels to meters on the road plane, in a file that people can read and write by hand."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    PlainSerializer,
    ValidationError,
    WithJsonSchema,
    model_validator,
)

from vision.contract.errors import InputError
from vision.contract.files import writing
from vision.contract.frame import LocalFrame
from vision.contract.text import read_text
from vision.lens import NAMES, Lens
from vision.pinhole import Pinhole, pinhole_from_columns

Array = NDArray[np.float64]
ROUNDED = 0.1  # m or degrees; digits to which `calibrate` proposes a frame


def _matrix(value: ArrayLike) -> Array:
    try:
        matrix = np.asarray(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise ValueError("must be three rows of three numbers") from error
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
        raise ValueError("must be three rows of three finite numbers")
    if np.linalg.cond(matrix / np.abs(matrix).max(axis=0)) > 1e12:
        raise ValueError("is singular: the control points it came from were collinear")
    return matrix


def _covariance(value: ArrayLike) -> Array:
    try:
        matrix = np.asarray(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise ValueError("must be rows of numbers") from error
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or not np.isfinite(matrix).all():
        raise ValueError("must be a square of finite numbers")
    deviation = np.sqrt(np.maximum(np.diagonal(matrix), 0))
    if (np.abs(matrix) > np.outer(deviation, deviation) * (1 + 1e-6) + 1e-300).any() or not np.allclose(
        matrix, matrix.T, rtol=1e-6
    ):
        raise ValueError("is not a covariance: it must be symmetric, with no correlation above 1")
    return matrix


#: Of a matrix in the file's schema: rows of numbers.
ROWS = WithJsonSchema({"type": "array", "items": {"type": "array", "items": {"type": "number"}}})
Matrix = Annotated[Array, BeforeValidator(_matrix), PlainSerializer(lambda matrix: matrix.tolist()), ROWS]
Covariance = Annotated[Array, BeforeValidator(_covariance), PlainSerializer(lambda matrix: matrix.tolist()), ROWS]


class ControlPoint(BaseModel):
    """A mark on the road: (u, v), px from the top left of the image, is at (x, y), m in the local frame.

    `sigma`, px, and `sigma_xy`, m, are its accuracies in the image and on the road.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    u: float
    v: float
    x: float
    y: float
    name: str = ""
    sigma: float = 1.0
    sigma_xy: float = 0.0


class Parameter(BaseModel):
    """A number of the camera, for people: its value, standard deviation and unit."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    value: float
    sigma: float
    unit: str


class Calibration(BaseModel):
    """The view of the road plane from a fixed camera.

    Parameters
    ----------
    image_size : (width, height) of the video it belongs to, px
    homography : [3, 3], maps (u, v, 1) in pixels to (x, y, 1) in meters, up to scale; with a lens, in its ideal pixels
    lens : intrinsics and distortion, or None for a picture without distortion
    model : how it was fitted, `homography` or `camera`
    covariance : [9, 9] of the homography's entries, row by row, or [18, 18] of them and `Lens.vector`
    parameters : of the camera, with their standard deviations
    control_points : the marks it was fitted to
    residuals_px, residuals_m : distance of every control point from its fitted place, in image and on road
    leave_one_out_m : distance on the road of every control point predicted by the others; None beyond their horizon
    leave_one_out_sigma_m : root mean square distance expected from the covariances of these predictions
    origin : (latitude, longitude) of x = y = 0, degrees
    x_azimuth : direction of +x, degrees clockwise from north

    Raises
    ------
    ValueError (as pydantic's ValidationError; `Calibration.read` turns it into one line), for unknown fields,
    a homography that is singular, or one that shows the road from below (mirrored y).

    Notes
    -----
    With y to the right of +x seen from above, u to the right and v down, a camera above the road sees it
    with det d(x, y)/d(u, v) = det H / w^3 > 0, w the third homogeneous component. So the side of the horizon
    that is road is known from H alone; H is stored with the sign that makes w > 0 there.

    >>> steep = Calibration(image_size=(640, 480), homography=[[0, -0.1, 48], [0.1, 0, -32], [0, 0, 1]])
    >>> steep.to_ground([[320, 480], [330, 470]]).round(3).tolist()
    [[0.0, 0.0], [1.0, 1.0]]
    """

    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True)

    image_size: tuple[int, int]
    homography: Matrix
    lens: Lens | None = None
    model: str = "homography"
    covariance: Covariance | None = None
    parameters: dict[str, Parameter] = {}
    control_points: tuple[ControlPoint, ...] = ()
    residuals_px: tuple[float, ...] | None = None
    residuals_m: tuple[float, ...] | None = None
    leave_one_out_m: tuple[float | None, ...] | None = None
    leave_one_out_sigma_m: tuple[float | None, ...] | None = None
    origin: tuple[float, float] | None = None
    x_azimuth: float | None = None

    @model_validator(mode="after")
    def _see_the_road_from_above(self) -> Self:
        if min(self.image_size) <= 0:
            raise ValueError(f"image_size {self.image_size} must be two positive numbers, width and height in px")
        scale = np.sign(np.linalg.det(self.homography)) / np.abs(self.homography[2]).max()
        object.__setattr__(self, "homography", self.homography * scale)
        if self.covariance is not None:
            scales = np.concatenate([np.full(9, scale), np.ones(0 if self.lens is None else len(NAMES))])
            if len(self.covariance) != len(scales):
                raise ValueError(f"covariance must have {len(scales)} rows and columns")
            object.__setattr__(self, "covariance", self.covariance * np.outer(scales, scales))
        width, height = self.image_size
        marks = [(point.u, point.v) for point in self.control_points] or [(width / 2, height)]
        if (self._homogeneous(self._ideal(marks))[:, 2] <= 0).any():
            raise ValueError(
                "homography shows the road from below: y must be to the right of +x seen from above "
                "(exchange its sign), and no control point may lie above the horizon"
            )
        return self

    def _ideal(self, pixels: ArrayLike) -> Array:
        pixels = np.asarray(pixels, float).reshape(-1, 2)
        return pixels if self.lens is None else self.lens.undistort(pixels)

    def _homogeneous(self, pixels: Array) -> Array:
        return pixels @ self.homography[:, :2].T + self.homography[:, 2]

    def to_ground(self, pixels: ArrayLike) -> Array:
        """Pixels [n, 2] (u, v) -> [n, 2] (x, y), m; NaN on and above the horizon."""
        image = self._homogeneous(self._ideal(pixels))
        return image[:, :2] / np.where(image[:, 2:] > 0, image[:, 2:], np.nan)

    def jacobian(self, pixels: ArrayLike) -> Array:
        """Pixels [n, 2] -> d(x, y)/d(u, v) [n, 2, 2], m/px; NaN on and above the horizon.

        Of X = (H p)_12 / w: dX/dp = (H_12 - X H_3) / w (the quotient rule); p is the ideal pixel.
        """
        ideal = self._ideal(pixels)
        slope = self._ideal_jacobian(ideal)
        return slope if self.lens is None else slope @ np.linalg.inv(self.lens.jacobian(ideal))

    def _ideal_jacobian(self, ideal: Array) -> Array:
        w = self._homogeneous(ideal)[:, 2:]
        w = np.where(w > 0, w, np.nan)
        ground = self._homogeneous(ideal)[:, :2] / w
        return np.asarray((self.homography[:2, :2] - ground[:, :, None] * self.homography[2, :2]) / w[:, :, None])

    def position_covariance(self, pixels: ArrayLike) -> Array:
        """Covariance [n, 2, 2], m^2, of `to_ground` of pixels [n, 2] that is due to the calibration alone.

        To first order, d(x, y)/d parameters times their covariance. Zero where the file has no covariance; NaN on and
        above the horizon. The error of the pixel itself adds J S J' with `jacobian` J and its covariance S.
        """
        slope = self.sensitivity(pixels)
        covariance = np.zeros((slope.shape[2],) * 2) if self.covariance is None else self.covariance
        return np.asarray(slope @ covariance @ slope.transpose(0, 2, 1))

    def sensitivity(self, pixels: ArrayLike) -> Array:
        """Pixels [n, 2] -> derivative [n, 2, 9 or 18] of `to_ground` by the parameters `covariance` is of."""
        ideal = self._ideal(pixels)
        image = self._homogeneous(ideal)
        w = np.where(image[:, 2:] > 0, image[:, 2:], np.nan)
        ground, ray = image[:, :2] / w, np.column_stack([ideal, np.ones(len(ideal))]) / w
        zero = np.zeros_like(ray)
        slope = np.stack(
            [np.hstack([ray, zero, -ground[:, :1] * ray]), np.hstack([zero, ray, -ground[:, 1:] * ray])], axis=1
        )
        if self.lens is not None:
            by_lens = self._ideal_jacobian(ideal) @ self.lens.sensitivity(pixels)
            slope = np.concatenate([slope, by_lens], axis=2)
        return np.asarray(slope)

    def to_image(self, ground: ArrayLike) -> Array:
        """Ground points [n, 2] (x, y), m -> pixels [n, 2]; NaN behind the camera and beyond the lens's reach."""
        ground = np.asarray(ground, float).reshape(-1, 2)
        inverse = np.linalg.inv(self.homography)
        image = ground @ inverse[:, :2].T + inverse[:, 2]
        ideal = np.asarray(image[:, :2] / np.where(image[:, 2:] > 0, image[:, 2:], np.nan))
        return ideal if self.lens is None else self.lens.distort(ideal)

    def pinhole(self) -> Pinhole | None:
        """Recover the camera behind the homography; None where the view does not determine it.

        With a lens its intrinsics are known. Without, they are found for square pixels and a central principal point:
        H^-1 = s K [r1 r2 t] with K of square pixels and a central principal point: r1 and r2 are orthonormal
        exactly where (g1 + i g2)' w (g1 + i g2) = 0, w = diag(q, q, 1), q = 1/f^2 (Hartley & Zisserman 2004,
        section 8.8: the imaged circular points lie on the absolute conic), one linear equation for q with a
        real and an imaginary part. Straight down, both vanish whatever q is and there is no answer.
        """
        if self.lens is not None:
            columns = np.linalg.inv(self.lens.matrix) @ np.linalg.inv(self.homography)
            return pinhole_from_columns(self.lens.focal[0], self.lens.matrix, columns, self.lens)
        width, height = self.image_size
        center = np.array([[1, 0, -width / 2], [0, 1, -height / 2], [0, 0, 1]])
        columns = center @ np.linalg.inv(self.homography)
        circular = columns[:, 0] + 1j * columns[:, 1]
        planar, deep = np.sum(circular[:2] ** 2), circular[2] ** 2
        if abs(planar) < 1e-4 * np.sum(np.abs(circular[:2]) ** 2):
            return None
        inverse_square = -(planar.conjugate() * deep).real / abs(planar) ** 2
        # Outside these fields of view (about 1 to 170 degrees) the result is noise: there is no visible perspective.
        if not (1 / (60 * width) ** 2 < inverse_square < 1 / (0.04 * width) ** 2):
            return None
        focal = float(inverse_square**-0.5)
        intrinsic = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
        return pinhole_from_columns(focal, intrinsic, np.diag([1 / focal, 1 / focal, 1]) @ columns, None)

    def require_size(self, width: int, height: int, video: str | Path) -> None:
        """Raise InputError unless the video has the size the calibration was made for."""
        if (width, height) != self.image_size:
            raise InputError(
                f"{video}: is {width} x {height} px but the calibration was made for "
                f"{self.image_size[0]} x {self.image_size[1]} px; calibrate on a frame of this video"
            )

    def require_frame(self, frame: LocalFrame, path: str | Path) -> None:
        """Raise InputError where the file was made for another local frame, beyond a rounding of 0.1 m or degrees."""
        if self.origin is None or self.x_azimuth is None:
            return
        turn = (self.x_azimuth - frame.x_azimuth + 180) % 360 - 180
        if np.hypot(*frame.to_local(*self.origin)) > ROUNDED or abs(turn) > ROUNDED:
            raise InputError(
                f"{path}: was made for the frame origin = {list(self.origin)}, x_azimuth = {self.x_azimuth:g}, but the "
                f"survey's is {list(frame.origin)}, {frame.x_azimuth:g}; calibrate again with --frame site.toml, or "
                "correct [frame]"
            )

    @classmethod
    def read(cls, path: str | Path) -> "Calibration":
        """Read a calibration file; InputError if it is not one."""
        try:
            return cls.model_validate_json(read_text(Path(path), "a calibration.json (roadfiber calibrate ground)"))
        except ValidationError as error:
            raise InputError(f"{path}: {_first_complaint(error.errors())}") from error

    def write(self, path: str | Path) -> None:
        """Write the calibration as JSON, a row of a matrix on a line, whole or not at all."""
        text = self.model_dump_json(indent=2, exclude_none=True)
        text = re.sub(r"\[([^][{}\"]+)\]", lambda row: f"[{' '.join(row[1].split())}]", text)
        with writing(path) as temporary:
            temporary.write_text(text + "\n", encoding="utf-8")


def _first_complaint(errors: Sequence[Any]) -> str:
    first = errors[0]
    place = ".".join(str(part) for part in first["loc"])
    message = first["msg"].removeprefix("Value error, ")
    more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
    return f"{place + ' ' if place else ''}{message[0].lower() + message[1:]}{more}; mend the calibration file"
