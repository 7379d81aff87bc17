"""State of the calibration page without its widgets: marks that may still lack a place, undo, the fit, and saving."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.control_points import PIXEL_SIGMA, PLACE_SIGMA, ControlPoints, write_control_points
from calib.ground import THRESHOLD, GroundFit, Model, fit_ground
from calib.lens_prior import LensPrior
from vision.contract import InputError, LocalFrame

Array = NDArray[np.float64]
HISTORY = 200  # steps that can be undone


@dataclass(frozen=True)
class Mark:
    """One mark: its pixel, and its place on the road, m, NaN until it is typed."""

    name: str
    px: float
    py: float
    x: float = float("nan")
    y: float = float("nan")
    sigma: float = PIXEL_SIGMA
    sigma_xy: float = PLACE_SIGMA

    @property
    def placed(self) -> bool:
        """Whether its place on the road is known."""
        return bool(np.isfinite([self.x, self.y]).all())


Marks = tuple[Mark, ...]


@dataclass
class Session:
    """The state of the page.

    Attributes
    ----------
    image_size : width, height, px
    marks : as they stand
    model, frame, lens, height : as in `fit_ground`
    """

    image_size: tuple[int, int]
    marks: Marks = ()
    model: Model = "auto"
    frame: LocalFrame | None = None
    lens: LensPrior | None = None
    height: tuple[float, float] | None = None
    past: list[Marks] = field(default_factory=list)
    future: list[Marks] = field(default_factory=list)

    def change(self, marks: Marks) -> bool:
        """Replace the marks; return whether they changed. New ones without a name get one."""
        marks = named(marks)
        if same(marks, self.marks):
            return False
        self.past = [*self.past, self.marks][-HISTORY:]
        self.future = []
        self.marks = marks
        return True

    def undo(self) -> bool:
        """Go one step back; False if there is none."""
        if not self.past:
            return False
        self.future.append(self.marks)
        self.marks = self.past.pop()
        return True

    def redo(self) -> bool:
        """Go one step forward again; False if there is none."""
        if not self.future:
            return False
        self.past.append(self.marks)
        self.marks = self.future.pop()
        return True

    def points(self) -> ControlPoints:
        """The marks whose place is known."""
        placed = [mark for mark in self.marks if mark.placed]
        return ControlPoints(
            tuple(mark.name for mark in placed),
            np.array([(mark.px, mark.py) for mark in placed], float).reshape(-1, 2),
            np.array([(mark.x, mark.y) for mark in placed], float).reshape(-1, 2),
            np.array([mark.sigma for mark in placed], float),
            np.array([mark.sigma_xy for mark in placed], float),
        )

    def fit(self) -> GroundFit:
        """Fit the marks whose place is known; InputError where they determine nothing."""
        for mark in self.marks:
            if not (mark.sigma > 0 and mark.sigma_xy >= 0):
                raise InputError(f"{mark.name}: sigma must be above 0 px and sigma_xy 0 m or more")
        names = [mark.name for mark in self.marks]
        if twice := {name for name in names if names.count(name) > 1}:
            raise InputError(f"{', '.join(sorted(twice))}: the name is there twice; change one")
        return fit_ground(
            self.points(), self.image_size, model=self.model, threshold=THRESHOLD, frame=self.frame, lens=self.lens,
            height=self.height,
        )  # fmt: skip

    def save(self, out: Path) -> list[Path]:
        """Write the calibration, as the command line does, and beside it the points; InputError writes nothing."""
        fit = self.fit()
        beside = out.with_name(f"{out.stem}_points.csv")
        write_control_points(self.points(), beside)
        fit.calibration.write(out)
        return [out, beside]


def marks_of(points: ControlPoints) -> Marks:
    """Marks of control points."""
    return tuple(
        Mark(name, px, py, x, y, sigma, sigma_xy)
        for name, (px, py), (x, y), sigma, sigma_xy in zip(
            points.names,
            points.pixels.tolist(),
            points.ground.tolist(),
            points.sigma.tolist(),
            points.sigma_xy.tolist(),
            strict=True,
        )
    )


def named(marks: Marks) -> Marks:
    """Give marks without a name the next free one of p1, p2, ...

    >>> [mark.name for mark in named((Mark("p1", 0, 0), Mark("", 5, 5)))]
    ['p1', 'p2']
    """
    taken = {mark.name for mark in marks}
    free = (name for name in (f"p{number}" for number in range(1, 10_000)) if name not in taken)
    return tuple(mark if mark.name else replace(mark, name=next(free)) for mark in marks)


def same(first: Marks, second: Marks) -> bool:
    """Whether marks are equal, places that are missing in both included."""
    return len(first) == len(second) and all(
        a.name == b.name and np.array_equal(_numbers(a), _numbers(b), equal_nan=True)
        for a, b in zip(first, second, strict=True)
    )


def _numbers(mark: Mark) -> Array:
    return np.array([mark.px, mark.py, mark.x, mark.y, mark.sigma, mark.sigma_xy])
