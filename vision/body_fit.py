"""Where a vehicle must stand for its silhouette to fill the boxes it was seen in."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.camera import Pinhole
from vision.vehicles import VehicleShape

Array = NDArray[np.float64]

ROUNDS = 8
LONGEST_STEP = 4.0  # m, per round
HUBER = 2.0  # sd beyond which an edge is trusted less (an occluded side)
EVIDENCE = 4.0  # fixes' worth of what a track tells of the size: a detector errs alike on all images of one vehicle
SETTLED = 3e-3  # m
STEP = 1e-3  # m, of the difference quotients


@dataclass(frozen=True)
class BodyFit:
    """One vehicle fitted to all its boxes.

    Parameters
    ----------
    position : [fix, 2], ground under the middle of the wheelbase, m
    covariance : [fix, 2, 2], m^2, of pixel noise and of the uncertain size
    size : length, width, height, m
    misfit : [fix], root mean square of the edges' residuals, sd
    """

    position: Array
    covariance: Array
    size: Array
    misfit: Array


def project_bodies(camera: Pinhole, corners: Array, position: Array, heading: Array) -> Array:
    """Pixels [n, k, 2] of bodies `corners` [k, 3] standing at positions [n, 2] with headings [n]."""
    cos, sin = np.cos(heading)[:, None], np.sin(heading)[:, None]
    x = position[:, :1] + cos * corners[:, 0] - sin * corners[:, 1]
    y = position[:, 1:] + sin * corners[:, 0] + cos * corners[:, 1]
    return camera.project(np.stack([x, y, np.broadcast_to(corners[:, 2], x.shape)], axis=-1))


def silhouette_boxes(camera: Pinhole, corners: Array, position: Array, heading: Array) -> Array:
    """Boxes [n, 4] around bodies, px; as `project_bodies`."""
    pixels = project_bodies(camera, corners, position, heading)
    return np.concatenate([pixels.min(axis=1), pixels.max(axis=1)], axis=1)


def seen_edges(pixels: Array, image_size: tuple[int, int]) -> NDArray[np.bool_]:
    """Which edges of the boxes around bodies [n, k, 2] are made by a corner inside the image [n, 4].

    The others are not where a detector draws them: it bounds what is left of the body inside the image.
    """
    inside = ((pixels >= 0) & (pixels <= np.array(image_size))).all(axis=2)
    corner = np.concatenate([pixels.argmin(axis=1), pixels.argmax(axis=1)], axis=1)
    return np.asarray(np.take_along_axis(inside, corner, axis=1))


def fit_body(
    camera: Pinhole,
    image_size: tuple[int, int],
    shape: VehicleShape,
    boxes: Array,
    sigma: Array,
    position: Array,
    heading: Array,
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

    Notes
    -----
    Gauss-Newton on the maximum a posteriori, edges weighted by Huber's rule. The positions are eliminated from the
    normal equations (Schur complement; Triggs et al. 2000, Bundle adjustment, section 6.1), so a round costs as much
    as its projections. The size gathers the evidence of four fixes, however many there are, because edges err alike in
    all of a track's boxes.
    """
    prior, alike = np.array(shape.size), max(1.0, len(boxes) / EVIDENCE)
    precision = np.diag(np.array(shape.deviation) ** -2.0)
    position, size = position.copy(), prior.copy()
    for _ in range(ROUNDS):
        residual, by_position, by_size = _linearize(camera, shape, boxes, position, heading, size)
        seen = seen_edges(project_bodies(camera, shape.corners(size), position, heading), image_size)
        weight = seen * sigma**-2.0 * np.minimum(1.0, HUBER / np.maximum(np.abs(residual / sigma), 1e-9))
        # A whisper of prior (10 m) keeps a fix with one visible edge solvable.
        near = np.einsum("nei,ne,nej->nij", by_position, weight, by_position) + 0.01 * np.eye(2)
        cross = np.einsum("nei,ne,nej->nij", by_position, weight, by_size)
        pull = np.einsum("nei,ne,ne->ni", by_position, weight, residual)
        inverse = np.linalg.inv(near)
        far = np.einsum("nei,ne,nej->ij", by_size, weight, by_size)
        reduced = precision + (far - np.einsum("nia,nij,njb->ab", cross, inverse, cross)) / alike
        size_pull = np.einsum("nei,ne,ne->i", by_size, weight, residual)
        size_pull = (size_pull - np.einsum("nia,nij,nj->a", cross, inverse, pull)) / alike
        size_step = np.linalg.solve(reduced, size_pull + precision @ (prior - size))
        step = np.einsum("nij,nj->ni", inverse, pull - cross @ size_step)
        size = size + size_step
        length = np.linalg.norm(step, axis=1, keepdims=True)
        position = position + step * np.minimum(1.0, LONGEST_STEP / np.maximum(length, 1e-9))
        if length.max() < SETTLED:
            break
    spread = inverse @ cross
    covariance = inverse + spread @ np.linalg.inv(reduced) @ spread.transpose(0, 2, 1)
    seen &= np.isfinite(sigma)
    misfit = np.sqrt((seen * (residual / sigma) ** 2).sum(axis=1) / np.maximum(seen.sum(axis=1), 1))
    return BodyFit(position, covariance, size, misfit)


def _linearize(
    camera: Pinhole, shape: VehicleShape, boxes: Array, position: Array, heading: Array, size: Array
) -> tuple[Array, Array, Array]:
    """Residuals [n, 4], their slopes over position [n, 4, 2] and over size [n, 4, 3], px and px/m.

    All are zero where a guess reaches behind the camera: such a fix stays where it is, with the prior's sigma.
    """
    here = silhouette_boxes(camera, shape.corners(size), position, heading)
    moved = [
        silhouette_boxes(camera, shape.corners(size), position + STEP * axis, heading) - here for axis in np.eye(2)
    ]
    grown = [
        silhouette_boxes(camera, shape.corners(size + STEP * axis), position, heading) - here for axis in np.eye(3)
    ]
    slopes = np.stack(moved + grown, axis=-1) / STEP
    behind = ~np.isfinite(slopes).all(axis=(1, 2))
    residual = boxes - here
    residual[behind], slopes[behind] = 0.0, 0.0
    return residual, slopes[..., :2], slopes[..., 2:]
