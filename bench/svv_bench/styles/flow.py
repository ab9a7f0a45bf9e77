"""Optical flow between views of a scene, forward warping, and checks of which pixels can be compared afterwards.

Flows are in pixels (x to the right, y downwards) and lead from a pixel of one image to its position in another; row 0
is at the top. Where a flow is unknown, both components are nan. Letters: h, w height and width, C channels.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from skimage.registration import optical_flow_ilk, optical_flow_tvl1

from svv.core.geometry.cameras import Camera
from svv.errors import BadInput

Array = NDArray[np.float64]

RELATIVE, ABSOLUTE = 0.01, 0.5
"""Bounds of the round-trip error: |f + b|^2 <= RELATIVE (|f|^2 + |b|^2) + ABSOLUTE px^2 (Sundaram et al. 2010)."""

BOUNDARY_RELATIVE, BOUNDARY_ABSOLUTE = 0.01, 0.002
"""Bounds of the flow's slope above which a pixel is a motion boundary; see :func:`is_motion_boundary`."""

LEAST_LOG_WEIGHT = -500.0
"""Lower bound of a splatted pixel's exponent relative to the largest one, so that no sum of weights becomes 0."""


def camera_flow(camera: Camera, other: Camera, depth: NDArray[np.floating]) -> Array:
    """Return the flow of a static scene from one camera's image to another's.

    Each pixel's point o + depth d is projected into the other image.

    Args:
        camera: Camera of the image in which the flow starts.
        other: Camera of the image to which it leads.
        depth: Distance from the camera along the pixel's ray in world units, nan where nothing is visible. (h, w)

    Returns:
        The flow, nan where the depth is nan or the point lies behind the other camera. (h, w, 2)

    Raises:
        BadInput: The depth does not have the size of the camera's image.
    """
    if np.shape(depth) != (camera.height, camera.width):
        raise BadInput(f"The depth is {np.shape(depth)}, the image {(camera.height, camera.width)}; render it again.")
    origins, directions = camera.rays()
    # Take differences first: far from the origin, or at scales of 1e-9, positions themselves lack the precision.
    points = directions * np.asarray(depth, np.float64)[..., None] + (origins - other.position)
    local = points @ other.camera_to_world[:3, :3]
    ahead = np.where(local[..., 2] < 0, -local[..., 2], np.nan)
    if other.is_orthographic:
        ahead = np.where(np.isnan(ahead), np.nan, 1.0)
    centre = other.principal_point
    column = centre[0] + other.focal * local[..., 0] / ahead - 0.5
    row = centre[1] - other.focal * local[..., 1] / ahead - 0.5
    return np.stack([column, row], axis=-1) - _pixels(camera.height, camera.width)


def estimated_flow(picture: NDArray[np.floating], other: NDArray[np.floating], estimator: str = "tvl1") -> Array:
    """Estimate the flow from two pictures alone, without cameras or depth.

    Args:
        picture: Picture in which the flow starts, grey in [0, 1]. (h, w)
        other: Picture to which it leads, grey in [0, 1]. (h, w)
        estimator: ``tvl1`` (Zach et al. 2007) or ``ilk`` (iterative Lucas-Kanade; Le Besnerais & Champagnat 2005),
            both coarse to fine (scikit-image).

    Returns:
        The flow. (h, w, 2)
    """
    estimate = {"tvl1": optical_flow_tvl1, "ilk": optical_flow_ilk}[estimator]
    down, right = estimate(np.asarray(picture, np.float32), np.asarray(other, np.float32))
    return np.stack([right, down], axis=-1).astype(np.float64)


def sampled(values: NDArray[np.floating], flow: NDArray[np.floating]) -> Array:
    """Sample another image at the positions to which the flow leads (backward warping).

    Args:
        values: The other image. (h, w, C)
        flow: Flow to the other image. (h, w, 2)

    Returns:
        Bilinear interpolations (h, w, C); nan where the flow is nan or leads out of the image, or a neighbour is nan.
    """
    height, width = flow.shape[:2]
    target = _pixels(height, width) + flow
    known = np.asarray(np.isfinite(target).all(axis=-1))
    at = np.where(known[..., None], target, -1.0)
    size = np.array([values.shape[1] - 1, values.shape[0] - 1])
    outside = ~known | (at < 0).any(-1) | (at > size).any(-1)
    channels = [
        map_coordinates(np.asarray(values[..., c], np.float64), [at[..., 1], at[..., 0]], order=1, mode="nearest")
        for c in range(values.shape[2])
    ]
    return np.asarray(np.where(outside[..., None], np.nan, np.stack(channels, axis=-1)))


def splatted(
    values: NDArray[np.floating], flow: NDArray[np.floating], importance: NDArray[np.floating]
) -> tuple[Array, Array]:
    """Move every pixel along its flow (softmax splatting); where several arrive, the more important ones win.

    I'(p) = sum_q b(p - q - F(q)) e^Z(q) I(q) / sum_q b(p - q - F(q)) e^Z(q), b the bilinear kernel
    (Niklaus & Liu 2020, eq. 8).

    Args:
        values: Image I. (h, w, C)
        flow: Flow F; pixels where it is nan are left out. (h, w, 2)
        importance: Importance Z, larger for pixels nearer to the viewer or more certain. (h, w)

    Returns:
        I' (h, w, C), nan where nothing arrived, and the amount that arrived, sum b (h, w); 1 is a whole pixel.
    """
    height, width, channels = values.shape
    there = np.isfinite(flow).all(axis=-1) & np.isfinite(values).all(axis=-1)
    target = (_pixels(height, width) + flow)[there]
    source, level = np.asarray(values, np.float64)[there], np.asarray(importance, np.float64)[there]
    total, arrived = np.zeros((channels + 1, height * width)), np.zeros(height * width)
    factor = np.exp(np.maximum(level - level.max(), LEAST_LOG_WEIGHT)) if level.size else level
    corner = np.floor(target)
    for right, below in ((0, 0), (1, 0), (0, 1), (1, 1)):
        place = corner + np.array([right, below])
        share = np.prod(1.0 - np.abs(target - place), axis=1)
        inside = ((place >= 0) & (place < (width, height))).all(axis=1)
        # Far outside, a float may not fit into an integer, so only places inside become an index.
        index = (place[inside] @ (1, width)).astype(np.int64)
        arrived += np.bincount(index, share[inside], height * width)
        weight = (share * factor)[inside]
        total[-1] += np.bincount(index, weight, height * width)
        for c in range(channels):
            total[c] += np.bincount(index, weight * source[inside, c], height * width)
    with np.errstate(invalid="ignore", divide="ignore"):
        result = np.where(total[-1] > 0, total[:-1] / total[-1], np.nan)
    return result.T.reshape(height, width, channels), arrived.reshape(height, width)


def is_consistent(forward: NDArray[np.floating], backward: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Mark the pixels to which the other image's flow leads back (the forward-backward check).

    |f(p) + b(p + f(p))|^2 <= 0.01 (|f|^2 + |b|^2) + 0.5 (Sundaram et al. 2010, eq. 5). Pixels that are hidden in
    the other image, leave it or have no flow fail.

    Args:
        forward: Flow from the image whose pixels are checked to the other. (h, w, 2)
        backward: Flow from the other image back to it. (h, w, 2)

    Returns:
        True for consistent pixels. (h, w)
    """
    back = sampled(backward, forward)
    miss = np.square(forward + back).sum(axis=-1)
    allowed = RELATIVE * (np.square(forward) + np.square(back)).sum(axis=-1) + ABSOLUTE
    return np.asarray(miss <= allowed)  # nan compares as False


def is_motion_boundary(flow: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Mark the pixels where the flow jumps, as at the edge of a surface in front of another: they mix two motions.

    |grad u|^2 + |grad v|^2 > 0.01 |w|^2 + 0.002 (Sundaram et al. 2010, eq. 6); neighbours of unknown flow count, too.

    Args:
        flow: Flow w = (u, v). (h, w, 2)

    Returns:
        True at motion boundaries. (h, w)
    """
    slopes = np.square(np.stack(np.gradient(flow, axis=(0, 1)))).sum(axis=(0, 3))
    return np.asarray(~(slopes <= BOUNDARY_RELATIVE * np.square(flow).sum(axis=-1) + BOUNDARY_ABSOLUTE))


def _pixels(height: int, width: int) -> Array:
    """Return column and row of every pixel. (h, w, 2)"""
    row, column = np.mgrid[0:height, 0:width]
    return np.stack([column, row], axis=-1).astype(np.float64)
