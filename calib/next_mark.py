"""What to add next: where among the marks another would help most, and what it would do."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.maps import PIXEL_SIGMA, area
from vision.camera import Calibration

Array = NDArray[np.float64]
#: Places across and along the surveyed area that are looked at.
ACROSS, ALONG = 25, 41
#: m, 1 sigma; a mark that lowers the error by less helps little.
ENOUGH = 0.05
#: Words for a place in the picture: far to near, left to right.
PLACES = (
    ("at the far left", "at the far end", "at the far right"),
    ("at the left edge", "in the middle", "at the right edge"),
    ("at the near left", "at the near end", "at the near right"),
)


@dataclass(frozen=True)
class NextMark:
    """The mark that would help most.

    Parameters
    ----------
    pixel : [2], where in the picture, px
    where : in words
    before, after : largest standard deviation of the place of that pixel without and with the mark, m
    """

    pixel: Array
    where: str
    before: float
    after: float

    @property
    def sentence(self) -> str:
        """What the mark would do.

        >>> NextMark(np.array([40.0, 210.0]), "at the far left", 0.42, 0.2).sentence
        'A mark at the far left (pixel 40, 210) would halve the error there: from 0.42 m to about 0.20 m, 1 sigma.'
        """
        if self.before - self.after < ENOUGH:
            return f"The marks suffice: no other would lower the error by {ENOUGH:g} m anywhere among them, 1 sigma."
        share = self.after / self.before
        doing = "halve" if 0.4 <= share <= 0.6 else "lower"
        return (
            f"A mark {self.where} (pixel {self.pixel[0]:.0f}, {self.pixel[1]:.0f}) would {doing} the error there: "
            f"from {self.before:.2f} m to about {self.after:.2f} m, 1 sigma."
        )


def next_mark(calibration: Calibration) -> NextMark | None:
    """The mark to add next, whose place on the road is known exactly; None where no covariance is known.

    Within the surveyed area, a margin around the marks included, it is where the error falls most. With C, the
    covariance of the place of a pixel that is due to the calibration, and J J' for the noise of its pixel, a mark there
    leaves C - C (C + J J')^-1 C; less where it shows, too, that the marks scatter less than was feared.
    """
    if calibration.covariance is None:
        return None
    low, high = area(calibration)
    x, y = np.linspace(low[0], high[0], ALONG), np.linspace(low[1], high[1], ACROSS)
    pixels = calibration.to_image(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))
    pixels = pixels[((pixels >= 0) & (pixels <= calibration.image_size)).all(axis=1)]
    before = calibration.position_covariance(pixels)
    seen = np.isfinite(before).all(axis=(1, 2))
    if not seen.any():
        return None
    pixels, before = pixels[seen], before[seen]
    jacobian = PIXEL_SIGMA * calibration.jacobian(pixels)
    after = before - before @ np.linalg.solve(before + jacobian @ jacobian.transpose(0, 2, 1), before)
    sigmas = np.sqrt(np.linalg.norm(np.stack([before, after]), ord=2, axis=(2, 3)))
    best = int((sigmas[0] - sigmas[1]).argmax())
    # Left and right as the picture has them, near and far as the marked road has them.
    low, high = np.array([0.0, pixels[:, 1].min()]), np.array([calibration.image_size[0], pixels[:, 1].max()])
    column, row = np.minimum((3 * (pixels[best] - low) / np.maximum(high - low, 1e-9)).astype(int), 2)
    return NextMark(pixels[best], PLACES[row][column], *sigmas[:, best].tolist())
