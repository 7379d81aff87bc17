"""Fit the position of a vehicle so that its silhouette fills its boxes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.edges import sizes
from vision.pinhole import Pinhole
from vision.vehicles import VehicleShape

Array = NDArray[np.float64]

ROUNDS = 4  # of a fit, which starts where the last one of the same vehicle ended
LONGEST_STEP = 4.0  # m, per round
HUBER = 2.0  # sd beyond which an edge is trusted less (an occluded side)
# Sizes of the box: sd of how far the edges of a vehicle's boxes lie outside it, all alike. Three detectors: 0.03 on
# two public clips with labels, 0.03 to 0.04 about a mean of 0.06 on rendered streets.
GROWTH = 0.04
EVIDENCE = 3.0  # a track counts as this many fixes for the size: a detector errs alike on all images of one vehicle
SETTLED = 3e-3  # m
OUT = np.array([-1.0, -1.0, 1.0, 1.0])  # of the box, and
EDGES, AXES = np.arange(4), np.array([0, 1, 0, 1])  # left, top, right, bottom, and the image's axis each is along


@dataclass(frozen=True)
class BodyFit:
    """One vehicle fitted to all its boxes.

    Parameters
    ----------
    position : [fix, 2], ground under the middle of the wheelbase, m
    covariance : [fix, 2, 2], m^2, of pixel noise and of the uncertain size
    size : length, width, height, m
    size_covariance : [3, 3], m^2
    misfit : [fix], root mean square of the edges' residuals, sd
    evidence : logarithm of the probability of the boxes where vehicles are of this class, up to a constant
    """

    position: Array
    covariance: Array
    size: Array
    size_covariance: Array
    misfit: Array
    evidence: float


def project_bodies(camera: Pinhole, corners: Array, position: Array, heading: Array) -> Array:
    """Pixels [n, k, 2] of bodies `corners` [k, 3] standing at positions [n, 2] with headings [n]."""
    return seen_from(camera, corners[None], position, turns(heading))[0]


def turns(heading: Array) -> Array:
    """Matrices [n, 3, 3] that turn a body (x ahead, y right, z down) to headings [n], rad."""
    cos, sin, zero, one = np.cos(heading), np.sin(heading), np.zeros_like(heading), np.ones_like(heading)
    return np.array([[cos, -sin, zero], [sin, cos, zero], [zero, zero, one]]).transpose(2, 0, 1)


def seen_from(camera: Pinhole, corners: Array, position: Array, turn: Array) -> tuple[Array, Array, Array]:
    """See corners [n or 1, k, 3], m, of bodies at positions [n, 2], turned by `turn` [n, 3, 3].

    Returns
    -------
    pixels [n, k, 2], ideal pixels [n, k, 2] (those of a lens without distortion), and depths [n, k, 1], NaN behind the
    camera
    """
    to_image = camera.matrix[:, :3] @ turn
    shift = position @ camera.matrix[:, :2].T + camera.matrix[:, 3]
    image = corners @ np.swapaxes(to_image, 1, 2) + shift[:, None]
    depth = np.where(image[..., 2:] > 0, image[..., 2:], np.nan)
    ideal = image[..., :2] / depth
    pixels = ideal if camera.lens is None else camera.lens.distort(ideal).reshape(ideal.shape)
    return pixels, ideal, depth


def silhouette_boxes(camera: Pinhole, corners: Array, position: Array, heading: Array) -> Array:
    """Boxes [n, 4] around bodies, px; as `project_bodies`."""
    pixels = project_bodies(camera, corners, position, heading)
    return np.concatenate([pixels.min(axis=1), pixels.max(axis=1)], axis=1)


def fit_body(
    camera: Pinhole,
    image_size: tuple[int, int],
    shape: VehicleShape,
    boxes: Array,
    sigma: Array,
    position: Array,
    heading: Array,
    guess: Array | None = None,
) -> BodyFit:
    """Fit ground positions, and the size all fixes share, to the edges of boxes.

    Parameters
    ----------
    camera, image_size : of the view; (width, height), px
    shape : class of the vehicle; its size and deviation are the prior
    boxes : [n, 4], px
    sigma : [n, 4], sd of every edge, px; infinite for an edge that is not seen
    position : [n, 2], first guess, m
    heading : [n], rad from +x toward +y
    guess : (3,), first guess of the size, m; the class's where None

    Notes
    -----
    All fixes share the vehicle's size and the share of its own size by which a box is drawn too wide. Gauss-Newton on
    the maximum a posteriori, edges weighted by Huber's rule. The positions are eliminated from the normal equations
    (Schur complement; Triggs et al. 2000, Bundle adjustment, section 6.1), so a round costs as much as its projections.
    However many fixes there are, they count as three for what is shared, because edges err alike in all boxes of a
    track.
    """
    prior, alike = np.array([*shape.size, 0.0]), max(1.0, len(boxes) / EVIDENCE)
    precision = np.diag(np.array([*shape.deviation, GROWTH]) ** -2.0)
    position, turn = position.copy(), turns(heading)
    size, outward = np.array([*(shape.size if guess is None else guess), 0.0]), sizes(boxes)[:, None] * OUT
    for _ in range(ROUNDS):
        tight = boxes - size[3] * outward
        residual, by_position, by_size, seen = _linearize(camera, image_size, shape, tight, position, turn, size[:3])
        by_size = np.concatenate([by_size, outward[..., None]], axis=2)
        weight = seen * sigma**-2.0 * np.minimum(1.0, HUBER / np.maximum(np.abs(residual / sigma), 1e-9))
        # A weak prior (10 m) keeps a fix with one visible edge solvable.
        pulled, stretched = weight[..., None] * by_position, weight[..., None] * by_size
        near = _transposed(pulled) @ by_position + 0.01 * np.eye(2)
        cross = _transposed(pulled) @ by_size
        pull = (_transposed(pulled) @ residual[..., None])[..., 0]
        inverse = np.linalg.inv(near)
        spread = inverse @ cross
        far = (stretched[..., :, None] * by_size[..., None, :]).sum(axis=(0, 1))
        reduced = precision + (far - (_transposed(cross) @ spread).sum(axis=0)) / alike
        size_pull = (stretched * residual[..., None]).sum(axis=(0, 1))
        size_pull = (size_pull - (_transposed(spread) @ pull[..., None])[..., 0].sum(axis=0)) / alike
        size_step = np.linalg.solve(reduced, size_pull + precision @ (prior - size))
        step = (inverse @ (pull - cross @ size_step)[..., None])[..., 0]
        size = size + size_step
        length = np.linalg.norm(step, axis=1, keepdims=True)
        position = position + step * np.minimum(1.0, LONGEST_STEP / np.maximum(length, 1e-9))
        if length.max() < SETTLED:
            break
    size_covariance = np.linalg.inv(reduced)
    covariance = inverse + spread @ size_covariance @ _transposed(spread)
    seen &= np.isfinite(sigma)
    off = seen * np.abs(residual / sigma)
    misfit = np.sqrt((off**2).sum(axis=1) / np.maximum(seen.sum(axis=1), 1))
    # Laplace's approximation (MacKay 2003, chapter 27).
    cost = (np.minimum(off, HUBER) * (2 * off - np.minimum(off, HUBER))).sum() / alike
    cost += (
        (size - prior) @ precision @ (size - prior) + np.linalg.slogdet(reduced)[1] - np.linalg.slogdet(precision)[1]
    )
    return BodyFit(position, covariance, size[:3], size_covariance[:3, :3], misfit, -float(cost) / 2)


def _transposed(matrices: Array) -> Array:
    return np.swapaxes(matrices, -1, -2)


def _linearize(
    camera: Pinhole,
    image_size: tuple[int, int],
    shape: VehicleShape,
    boxes: Array,
    position: Array,
    turn: Array,
    size: Array,
) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Residuals [n, 4], their slopes over position [n, 4, 2] and over size [n, 4, 3], px and px/m; which edges count.

    An edge moves with the corner that defines it. An edge defined by a corner outside the image does not count: a
    detector bounds the part of the body inside. All are zero if a guess reaches behind the camera: such a fix stays in
    place, with the prior's sigma.
    """
    pixels, ideal, depth = seen_from(camera, shape.corners(size)[None], position, turn)
    which = np.concatenate([pixels.argmin(axis=1), pixels.argmax(axis=1)], axis=1)
    row = np.arange(len(boxes))[:, None]
    extreme = pixels[row, which]
    seen = ((extreme >= 0) & (extreme <= np.array(image_size))).all(axis=2)
    residual = boxes - extreme[:, EDGES, AXES]
    by_place = camera.slope(ideal[row, which], depth[row, which])[:, EDGES, AXES]
    by_size = (by_place @ turn) * shape.corners(np.ones(3))[which]
    slopes = np.concatenate([by_place[..., :2], by_size], axis=2)
    behind = ~(np.isfinite(slopes).all(axis=(1, 2)) & np.isfinite(residual).all(axis=1))
    residual[behind], slopes[behind] = 0.0, 0.0
    return residual, slopes[..., :2], slopes[..., 2:], np.asarray(seen)
