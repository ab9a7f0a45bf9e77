"""Optical flow between views of a scene, forward warping, and which pixels can be compared afterwards.

Flows are in pixels, (x to the right, y downwards), from a pixel of one image to where it is seen in another; row 0 is
at the top. Where a flow is not known, both of its components are nan. Letters: h, w height and width, C channels.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from skimage.registration import optical_flow_ilk, optical_flow_tvl1

from svv.core.cameras import Camera
from svv.errors import BadInput

Array = NDArray[np.float64]

RELATIVE, ABSOLUTE = 0.01, 0.5
"""How far there and back may miss: |f + b|^2 <= RELATIVE (|f|^2 + |b|^2) + ABSOLUTE px^2 (Sundaram et al. 2010)."""

BOUNDARY_RELATIVE, BOUNDARY_ABSOLUTE = 0.01, 0.002
"""The flow's slope from which on a pixel counts as a motion boundary."""

LEAST_LOG_WEIGHT = -500.0
"""Exponent below the largest at which a splatted pixel stops losing weight, so that no sum of weights becomes 0."""


def camera_flow(camera: Camera, other: Camera, depth: NDArray[np.floating]) -> Array:
    """Flow from one camera's image to another's, of a scene that does not move.

    Each pixel's point o + depth d is projected into the other image.

    Args:
        camera: Whose pixels they are.
        other: Where they are looked for.
        depth: Distance from the camera along the pixel's ray, world units, nan where nothing is seen. (h, w)

    Returns:
        (h, w, 2), nan where the depth is, or where the point lies behind the other camera.

    Raises:
        BadInput: the depth does not have the size of the camera's image.
    """
    if np.shape(depth) != (camera.height, camera.width):
        raise BadInput(f"The depth is {np.shape(depth)}, the image {(camera.height, camera.width)}; render it anew.")
    origins, directions = camera.rays()
    # Differences first: far from the origin, or at 1e-9 of a unit, positions themselves have no digits to spare.
    points = directions * np.asarray(depth, np.float64)[..., None] + (origins - other.position)
    local = points @ other.camera_to_world[:3, :3]
    ahead = np.where(local[..., 2] < 0, -local[..., 2], np.nan)
    column = 0.5 * other.width + other.focal * local[..., 0] / ahead - 0.5
    row = 0.5 * other.height - other.focal * local[..., 1] / ahead - 0.5
    return np.stack([column, row], axis=-1) - _pixels(camera.height, camera.width)


def estimated_flow(picture: NDArray[np.floating], other: NDArray[np.floating], estimator: str = "tvl1") -> Array:
    """Flow that an estimator reads from two pictures alone, knowing neither cameras nor depth.

    Args:
        picture: Whose pixels they are, grey in [0, 1]. (h, w)
        other: Where they are looked for. (h, w)
        estimator: ``tvl1`` (Zach et al. 2007) or ``ilk`` (Lucas & Kanade's, iterated; Le Besnerais & Champagnat 2005),
            both coarse to fine (scikit-image).

    Returns:
        (h, w, 2).
    """
    estimate = {"tvl1": optical_flow_tvl1, "ilk": optical_flow_ilk}[estimator]
    down, right = estimate(np.asarray(picture, np.float32), np.asarray(other, np.float32))
    return np.stack([right, down], axis=-1).astype(np.float64)


def sampled(values: NDArray[np.floating], flow: NDArray[np.floating]) -> Array:
    """Values of the other image where each pixel's flow leads: backward warping.

    Args:
        values: (h, w, C).
        flow: (h, w, 2).

    Returns:
        Bilinear mixtures, (h, w, C); nan where the flow is nan or leads out of the image, or a neighbour is nan.
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
    """Softmax splatting: every pixel is moved along its flow; where several arrive, the important ones win.

    I'(p) = sum_q b(p - q - F(q)) e^Z(q) I(q) / sum_q b(p - q - F(q)) e^Z(q), b the bilinear kernel
    (Niklaus & Liu 2020, eq. 8).

    Args:
        values: I, (h, w, C).
        flow: F, (h, w, 2); pixels of which it is nan stay away.
        importance: Z, larger is nearer to the viewer or more certain. (h, w)

    Returns:
        I' (h, w, C), nan where nothing arrived, and how much arrived: sum b, (h, w); 1 for a whole pixel.
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
        # Far outside a float may not fit into an integer, so only what is inside becomes an index.
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
    """The forward-backward check: pixels whose flow leads to where the other image's flow leads back.

    |f(p) + b(p + f(p))|^2 <= 0.01 (|f|^2 + |b|^2) + 0.5 (Sundaram et al. 2010, eq. 5). What is hidden in the other
    image, leaves it, or has no flow fails.

    Args:
        forward: Flow of the image whose pixels are asked about, (h, w, 2).
        backward: Flow of the other image to it, (h, w, 2).

    Returns:
        (h, w).
    """
    back = sampled(backward, forward)
    miss = np.square(forward + back).sum(axis=-1)
    allowed = RELATIVE * (np.square(forward) + np.square(back)).sum(axis=-1) + ABSOLUTE
    return np.asarray(miss <= allowed)  # nan compares as False


def is_motion_boundary(flow: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Pixels at which the flow jumps, so that a pixel mixes what moves apart: edges of a surface before another.

    |grad u|^2 + |grad v|^2 > 0.01 |w|^2 + 0.002 (Sundaram et al. 2010, eq. 6), and neighbours of unknown flow.

    Args:
        flow: w = (u, v), (h, w, 2).

    Returns:
        (h, w).
    """
    slopes = np.square(np.stack(np.gradient(flow, axis=(0, 1)))).sum(axis=(0, 3))
    return np.asarray(~(slopes <= BOUNDARY_RELATIVE * np.square(flow).sum(axis=-1) + BOUNDARY_ABSOLUTE))


def _pixels(height: int, width: int) -> Array:
    """Column and row of every pixel, (h, w, 2)."""
    row, column = np.mgrid[0:height, 0:width]
    return np.stack([column, row], axis=-1).astype(np.float64)
