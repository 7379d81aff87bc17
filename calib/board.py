"""Intrinsics and distortion of a camera from pictures of a flat board of known squares."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.lens_prior import Intrinsics
from calib.options import read_picture
from vision.contract import InputError, progress
from vision.lens import Lens
from vision.stills import PICTURES

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
FEWEST_CORNERS = 8  # corners of a view that is used
FEWEST_VIEWS = 4
WORST = 3.0  # times the median error of the views, beyond which one is left out
VIDEO_FRAMES = 60  # looked at in a video
CELLS = (8, 6)  # of the picture, for coverage
COVERED, TILTED, MANY = 0.6, 15.0, 8  # share of the cells, deg, views: below them a warning


@dataclass(frozen=True)
class Board:
    """A board of squares.

    Attributes
    ----------
    columns, rows : count of squares (not of inner corners)
    markers : dictionary of the ArUco markers in its white squares, as 4X4_50; None for a plain checkerboard
    marker_share : side of a marker over side of a square
    legacy : a ChArUco board with an even count of rows drawn by OpenCV before 4.6
    """

    columns: int
    rows: int
    markers: str | None = "4X4_50"
    marker_share: float = 0.75
    legacy: bool = False

    def corners(self) -> int:
        """Count of inner corners."""
        return (self.columns - 1) * (self.rows - 1)


@dataclass(frozen=True)
class BoardView:
    """The corners found in one picture: places on the board [n, 3], squares, and pixels [n, 2]."""

    name: str
    places: Array
    pixels: Array


@dataclass(frozen=True)
class BoardFit:
    """Result of `fit_board`.

    Attributes
    ----------
    intrinsics : lens and its covariance
    views : the views that were used
    residuals : of each view [n, 2], px
    tilts : angle of each view's board to the picture, deg
    coverage : share of the picture's cells with a corner in them
    warnings : one line each
    """

    intrinsics: Intrinsics
    views: tuple[BoardView, ...]
    residuals: tuple[Array, ...]
    tilts: Array
    coverage: float
    warnings: tuple[str, ...]


def charuco(board: Board) -> Any:
    """OpenCV's ChArUco board with squares of side 1."""
    import cv2

    name = f"DICT_{board.markers}"
    if board.markers is None or not hasattr(cv2.aruco, name):
        known = sorted(entry[5:] for entry in dir(cv2.aruco) if entry.startswith("DICT_"))
        raise InputError(f"--markers {board.markers}: no such dictionary; give one of {', '.join(known)}")
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
    drawn = cv2.aruco.CharucoBoard((board.columns, board.rows), 1.0, board.marker_share, dictionary)
    drawn.setLegacyPattern(board.legacy)
    return drawn


def draw_board(board: Board, pixels_per_square: int = 120) -> Image:
    """Picture [height, width] of a board to print, with a white margin of half a square."""
    size = (board.columns * pixels_per_square, board.rows * pixels_per_square)
    if board.markers is not None:
        face = charuco(board).generateImage(size, marginSize=0)
    else:
        squares = np.add.outer(np.arange(board.rows), np.arange(board.columns)) % 2
        face = np.kron(255 * squares, np.ones((pixels_per_square, pixels_per_square))).astype(np.uint8)
    return np.asarray(np.pad(face, pixels_per_square // 2, constant_values=255), np.uint8)


def find_board(image: Image, board: Board, name: str = "") -> BoardView | None:
    """Find a board's corners in a picture [height, width, 3]; None where there are fewer than `FEWEST_CORNERS`.

    Pixels are counted from the upper left corner of the picture, as throughout roadfiber: OpenCV's plus 0.5.
    """
    import cv2

    gray = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image, np.uint8)
    found = _find_charuco(gray, board) if board.markers is not None else _find_checkerboard(gray, board)
    if found is None or len(found[1]) < FEWEST_CORNERS:
        return None
    return BoardView(name, found[0], found[1] + 0.5)


def _find_charuco(gray: Image, board: Board) -> tuple[Array, Array] | None:
    import cv2

    drawn = charuco(board)
    corners, ids, _, _ = cv2.aruco.CharucoDetector(drawn).detectBoard(gray)
    if ids is None or len(ids) < FEWEST_CORNERS or drawn.checkCharucoCornersCollinear(ids):
        return None
    places, pixels = drawn.matchImagePoints(corners, ids)
    return places.reshape(-1, 3).astype(float), pixels.reshape(-1, 2).astype(float)


def _find_checkerboard(gray: Image, board: Board) -> tuple[Array, Array] | None:
    import cv2

    inner = (board.columns - 1, board.rows - 1)
    found, corners = cv2.findChessboardCornersSB(gray, inner, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    if not found:
        return None
    x, y = np.meshgrid(np.arange(inner[0]), np.arange(inner[1]))
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]).astype(float), corners.reshape(-1, 2).astype(float)


def read_views(sources: Sequence[Path], board: Board) -> tuple[list[BoardView], tuple[int, int]]:
    """Find the board in pictures, folders of pictures and videos; the views and the size of the pictures.

    Raises
    ------
    InputError
        If there is no picture, they differ in size, or too few show the board.
    """
    views: list[BoardView] = []
    size, seen = None, 0
    with progress("looking for the board") as advance:
        for name, image in _images(sources):
            here = (image.shape[1], image.shape[0])
            if size is not None and here != size:
                raise InputError(f"{name}: is {here[0]}x{here[1]}, the first was {size[0]}x{size[1]}; give one size")
            size, seen = here, seen + 1
            view = find_board(image, board, name)
            views += [view] if view else []
            advance(1)
    if size is None:
        raise InputError("no pictures given; give pictures, a folder of them, or a video of the board")
    if len(views) < FEWEST_VIEWS:
        raise InputError(
            f"the board was found in {len(views)} of {seen} pictures, at least {FEWEST_VIEWS} are needed; check "
            f"--squares ({board.columns}x{board.rows}, squares, not corners) and "
            f"{'--markers (' + board.markers + ')' if board.markers else '--kind'}"
        )
    return views, size


def _images(sources: Sequence[Path]) -> Iterator[tuple[str, Image]]:
    from vision.video import open_video

    for source in _expanded(sources):
        if source.suffix.lower() in PICTURES:
            yield source.name, read_picture(source)
            continue
        for frame in open_video(source).sample(VIDEO_FRAMES):
            yield f"{source.name} {frame.time:.2f} s", frame.image


def _expanded(sources: Iterable[Path]) -> Iterator[Path]:
    for source in sources:
        if source.is_dir():
            yield from sorted(path for path in source.iterdir() if path.suffix.lower() in PICTURES)
        else:
            yield source


def fit_board(views: Sequence[BoardView], size: tuple[int, int]) -> BoardFit:
    """Fit focal lengths, principal point and five distortion terms to views of a board (Zhang 2000).

    Views whose error is over three times the median are left out once. The covariance of the lens is that of the joint
    least squares with every view's pose as a nuisance parameter, scaled by the scatter of the corners.

    Parameters
    ----------
    views : at least four, in different poses
    size : width, height, px

    Raises
    ------
    InputError
        If the views do not determine a camera.
    """
    fit = _calibrate(views, size)
    errors = np.array([_rms(residual) for residual in fit.residuals])
    good = errors <= WORST * np.median(errors)
    if not good.all() and good.sum() >= FEWEST_VIEWS:
        dropped = [view.name for view, keep in zip(views, good, strict=True) if not keep]
        fit = _calibrate([view for view, keep in zip(views, good, strict=True) if keep], size)
        warning = f"left out, badly fitting: {', '.join(dropped)}"
        fit = BoardFit(fit.intrinsics, fit.views, fit.residuals, fit.tilts, fit.coverage, (warning, *fit.warnings))
    return fit


def _calibrate(views: Sequence[BoardView], size: tuple[int, int]) -> BoardFit:
    import cv2

    places = [view.places.astype(np.float32) for view in views]
    pixels = [view.pixels.astype(np.float32) for view in views]
    try:
        _, matrix, distortion, turns, shifts = cv2.calibrateCamera(places, pixels, size, None, None)
    except cv2.error as error:
        raise InputError("the views do not determine a camera; take more, tilted in different ways") from error
    distortion = np.asarray(distortion, float).ravel()[:5]
    residuals, reduced = [], np.zeros((9, 9))
    for view, turn, shift in zip(views, turns, shifts, strict=True):
        seen, jacobian = cv2.projectPoints(view.places, turn, shift, matrix, distortion)
        residuals.append(view.pixels - seen.reshape(-1, 2))
        jacobian = np.asarray(jacobian, float)[:, :15]
        jacobian[:, 6:8] *= (matrix[0, 0], matrix[1, 1])  # of the logarithm of the focal lengths
        pose, lens = jacobian[:, :6], jacobian[:, 6:]
        cross = pose.T @ lens
        reduced += lens.T @ lens - cross.T @ np.linalg.solve(pose.T @ pose, cross)
    every = np.concatenate(residuals)
    freedom = every.size - 9 - 6 * len(views)
    covariance = np.linalg.inv(reduced) * float((every**2).sum()) / max(freedom, 1)
    lens_found = Lens(
        focal=(matrix[0, 0], matrix[1, 1]), center=(matrix[0, 2], matrix[1, 2]), distortion=tuple(distortion.tolist())
    )
    tilts = np.array([_tilt(np.asarray(turn, float)) for turn in turns])
    coverage = cover(views, size)
    rows = tuple((view.name, len(view.pixels), _rms(off)) for view, off in zip(views, residuals, strict=True))
    intrinsics = Intrinsics(
        image_size=size, lens=lens_found, covariance=(covariance + covariance.T) / 2, rms_px=_rms(every), views=rows
    )
    warnings = tuple(_warnings(len(views), coverage, tilts, intrinsics))
    return BoardFit(intrinsics, tuple(views), tuple(residuals), tilts, coverage, warnings)


def cover(views: Sequence[BoardView], size: tuple[int, int]) -> float:
    """Share of the picture's `CELLS` with a corner in them."""
    pixels = np.concatenate([view.pixels for view in views])
    cells = np.clip((pixels / size * CELLS).astype(int), 0, np.array(CELLS) - 1)
    return len(np.unique(cells, axis=0)) / (CELLS[0] * CELLS[1])


def _tilt(turn: Array) -> float:
    """Angle, deg, between a board's normal and the direction of view."""
    import cv2

    normal = cv2.Rodrigues(turn)[0][:, 2]
    return float(np.rad2deg(np.arccos(np.clip(abs(normal[2]), 0, 1))))


def _warnings(count: int, coverage: float, tilts: Array, intrinsics: Intrinsics) -> Iterator[str]:
    if count < MANY:
        yield f"only {count} views; {MANY} or more are better"
    if coverage < COVERED:
        yield f"corners cover {coverage:.0%} of the picture; bring the board to its edges and corners"
    if tilts.max() < TILTED:
        yield f"no board is tilted over {TILTED:g} degrees, so that focal length and distance are alike; tilt it"
    if intrinsics.rms_px > 1.0:
        yield f"the corners fit to {intrinsics.rms_px:.2f} px only: a bent board, blur, or a lens beyond this model"
    radius = np.linalg.norm(np.array(intrinsics.image_size) / 2) / min(intrinsics.lens.focal)
    if np.isnan(intrinsics.lens.undistort([[0.0, 0.0]])).any() or intrinsics.lens.reach < radius:
        yield "the distortion found does not reach the picture's corners; bring the board there"


def _rms(off: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))
