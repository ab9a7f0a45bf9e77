"""Whether silhouettes agree with their cameras, and the angle of view with which they agree best.

A plane through two camera positions that touches an object touches both silhouettes: the epipolar tangency constraint
(Porrill and Pollard 1991; Wong and Cipolla 2001). Every pair of views therefore gives two numbers that must agree, one
on either side of the object.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from svv.core.geometry.cameras import Camera
from svv.core.view_checks.tangency_kernels import compare_tangents

Array = NDArray[np.float64]

TANGENTS = 180
"""Directions in the image in which the outermost pixel of a silhouette is noted."""

_ANGLE = 2.0 * np.pi * np.arange(TANGENTS) / TANGENTS
OUTWARDS = np.stack([np.cos(_ANGLE), np.sin(_ANGLE)])
"""These directions. (2, TANGENTS)"""

INSET = 0.25
"""Pixels by which an outline lies outside the middle of its outermost pixel, on average: measured on balls,
in images of 96 to 384 pixels. Without it, estimated angles of view are up to 0.8 degrees too large."""

MOST_PAIRS = 600
"""Pairs of views that are compared."""

PAIR_ANGLES = (20.0, 160.0)
"""Angles between the axes of two views that are compared, in degrees; planes through others touch the object badly."""

LEAST_PAIRS = 3
"""Pairs below which silhouettes say nothing."""

NARROWEST, WIDEST = np.radians(1.0), np.radians(150.0)
"""Horizontal angles of view between which the best is sought, in radians."""

ANGLES = 48
"""Angles that are tried first, evenly spaced in the logarithm of their tangent: each is 1.15 times the one before."""

NOISE = 0.05
"""Huber's loss in squared pixels below which two angles count as equally good."""

FEWER = 0.2
"""Fraction of the pairs of a narrower angle that a wider one must leave to be compared with it."""

OUTLIER = 3.0
"""Multiple of the median residual from which on a residual counts linearly."""


@dataclass(frozen=True)
class Silhouettes:
    """Outermost pixels of the silhouettes of some views."""

    points: Array
    """Column and row, in pixels from the image's upper left corner, of the outermost point in each direction.
    (n, TANGENTS, 2)"""
    usable: NDArray[np.bool_]
    """Views whose silhouette is there and wholly inside the image. (n,)"""

    def take(self, indices: NDArray[np.intp], tangents: int = 1) -> Silhouettes:
        """Return the silhouettes of some of the views, with every so many-th tangent."""
        return Silhouettes(self.points[indices, ::tangents], self.usable[indices])

    @classmethod
    def of(cls, masks: Sequence[NDArray[np.bool_]], step: int = 1) -> Silhouettes:
        """Find the outermost pixels of masks. (n) x (height, width)

        If only every ``step``-th pixel is given, from ``step // 2`` on, points are those of the whole image: outlines
        lie another (step - 1) / 2 pixels further out, on average.
        """
        points, usable = np.zeros((len(masks), TANGENTS, 2)), np.zeros(len(masks), bool)
        for view, mask in enumerate(masks):
            rows = np.flatnonzero(mask.any(axis=1))
            if not len(rows):
                continue
            first = mask[rows].argmax(axis=1)
            last = mask.shape[1] - 1 - mask[rows, ::-1].argmax(axis=1)
            ends = np.concatenate([np.stack([first, rows], 1), np.stack([last, rows], 1)])
            points[view] = outermost(ends, step)
            inside = rows[0] > 0 and rows[-1] < mask.shape[0] - 1
            usable[view] = inside and first.min() > 0 and last.max() < mask.shape[1] - 1
        return cls(points, usable)


def outermost(ends: NDArray[np.integer], step: int) -> Array:
    """Return the outermost point of a silhouette in each direction, in pixels of the whole picture. (TANGENTS, 2)

    ``ends`` (pixels, 2): column and row of its pixels, at least of all that may be outermost: first those on the left,
    then those on the right, each from the top down; ``step``: as for :meth:`Silhouettes.of`.
    """
    pixels = ends * step + step // 2 + 0.5
    return pixels[(pixels @ OUTWARDS).argmax(axis=0)] + (INSET + 0.5 * (step - 1)) * OUTWARDS.T


@dataclass(frozen=True)
class Views:
    """Cameras as arrays, which may also be mirrored, as no :class:`Camera` is."""

    matrices: Array
    """Camera-to-world matrices. (n, 4, 4)"""
    focal: Array
    """Focal lengths in pixels; pixels per world unit of orthographic cameras. (n,)"""
    centres: Array
    """Principal points. (n, 2)"""
    parallel: NDArray[np.bool_]
    """Which cameras are orthographic. (n,)"""

    @classmethod
    def of(cls, cameras: Sequence[Camera]) -> Views:
        """Return the arrays of cameras."""
        return cls(
            np.stack([camera.camera_to_world for camera in cameras]),
            np.array([camera.focal for camera in cameras]),
            np.array([camera.principal_point for camera in cameras]),
            np.array([camera.is_orthographic for camera in cameras]),
        )

    def take(self, indices: NDArray[np.intp]) -> Views:
        """Return some of the views."""
        return Views(self.matrices[indices], self.focal[indices], self.centres[indices], self.parallel[indices])


@dataclass(frozen=True)
class Fit:
    """An angle of view that silhouettes agree with."""

    fov_x: float
    """Full horizontal angle of view in radians."""
    uncertainty: float
    """Its standard deviation in radians; infinite if the silhouettes do not depend on the angle."""
    residual: float
    """Median of the differences between silhouettes, in pixels."""


LEAST_OF_A_VIEW = 6
"""Differences of a view below which it says nothing alone."""


def differences(views: Views, silhouettes: Silhouettes, most: int = MOST_PAIRS, paired: Views | None = None) -> Array:
    """Return by how many pixels the silhouettes of pairs of views disagree, two signed numbers a pair. (pairs * 2,)

    NaN where the line between two cameras runs through the object. Pairs of a pinhole and an orthographic camera are
    left out, so there may be none. At most ``most`` pairs are compared; ``paired``: cameras by which these are chosen,
    by default the same.
    """
    return _differences(views, silhouettes, _pairs(paired or views, silhouettes, most))


def differences_by_view(views: Views, silhouettes: Silhouettes, most: int) -> Array:
    """Return by how many pixels the silhouette of each view differs from the others': medians, NaN if unknown. (n,)

    Compares at most ``most`` pairs of views.
    """
    pairs = _pairs(views, silhouettes, most)
    medians = np.full(len(views.matrices), np.nan)
    if not len(pairs):
        return medians
    pairs = pairs[np.argsort(~views.parallel[pairs[:, 0]], kind="stable")]  # as _differences returns them
    found = np.abs(_differences(views, silhouettes, pairs)).reshape(len(pairs), -1)
    for view in range(len(medians)):
        own = found[(pairs == view).any(axis=1)]
        own = own[np.isfinite(own)]
        if len(own) >= LEAST_OF_A_VIEW:
            medians[view] = np.median(own)
    return medians


def best_fov(cameras: Sequence[Camera], silhouettes: Silhouettes) -> Fit | None:
    """Return the angle of view with which silhouettes agree best; None if too few pairs of views can be compared.

    The cameras are pinhole cameras of one angle of view, which is not used, at known positions. A sphere about the
    point that all of them look at agrees with any angle; :attr:`Fit.uncertainty` tells.
    """
    views = Views.of(cameras)
    pairs = _pairs(views, silhouettes)
    if len(pairs) < LEAST_PAIRS:
        return None
    half = 0.5 * cameras[0].width

    def at(strength: float) -> Array:
        return _differences(replace(views, focal=np.full(len(cameras), half / strength)), silhouettes, pairs)

    grid = np.geomspace(np.tan(NARROWEST / 2), np.tan(WIDEST / 2), ANGLES)
    found = np.stack([at(k) for k in grid])
    k = _best_of(found)
    if k is None:
        return None
    around = [max(k - 1, 0), k, min(k + 1, len(grid) - 1)]
    same = np.isfinite(found[around]).all(axis=0)  # the same pairs throughout, so that the loss has no steps
    if same.sum() < LEAST_PAIRS:
        same = np.isfinite(found[k])
    best = _golden(lambda x: _cost(at(x)[same]), grid[around[0]], grid[around[2]])
    step = 0.02 * best
    after, before, here = at(best + step), at(best - step), at(best)
    both = np.isfinite(after) & np.isfinite(before) & np.isfinite(here)
    slope = (after - before)[both] / (2.0 * np.arctan(best + step) - 2.0 * np.arctan(best - step))
    residual = float(np.median(np.abs(here[both]))) if both.any() else np.inf
    information = float(np.median(slope**2)) * silhouettes.usable.sum() if both.any() else 0.0
    # Differences within one view come from the same pixels: views, not pairs, count as independent measurements.
    uncertainty = float(max(1.4826 * residual, 0.25) / np.sqrt(information)) if information > 0 else np.inf
    return Fit(float(2.0 * np.arctan(best)), uncertainty, residual)


def _best_of(found: Array) -> int | None:
    """Return the angle with which silhouettes agree best; None if too few pairs can be compared with any.

    The wider the angle, the nearer the object seems to the cameras, and the fewer pairs are left whose planes do not
    run through it: a few may agree by chance. Two angles are therefore compared with the pairs that both leave, and of
    angles that are equally good the narrowest wins. ``found``: as from :func:`differences`. (angles, pairs * 2)
    """
    finite = np.isfinite(found)
    costs = np.array([_cost(each) if own.sum() >= LEAST_PAIRS else np.inf for each, own in zip(found, finite)])
    padded = np.concatenate([[np.inf], costs, [np.inf]])
    valleys = np.flatnonzero(np.isfinite(costs) & (costs <= padded[:-2]) & (costs <= padded[2:]))
    best = None
    for k in valleys.tolist():
        if best is None:
            best = k
            continue
        both = finite[best] & finite[k]
        if both.sum() < max(LEAST_PAIRS, FEWER * finite[best].sum()):
            continue
        if _cost(found[k][both]) + NOISE < _cost(found[best][both]):
            best = k
    return best


def disagreement_of(cameras: Sequence[Camera], silhouettes: Silhouettes, angles: Sequence[float]) -> Array:
    """Return by how many pixels silhouettes disagree for some angles of view in radians, over the same pairs of views.

    Medians; NaN if no pair can be compared with all of the angles. (angles,) The cameras' own angle is not used.
    """
    each = [Views.of([replace(camera, fov_x=fov) for camera in cameras]) for fov in angles]
    pairs = _pairs(each[0], silhouettes)
    found = np.stack([np.abs(_differences(views, silhouettes, pairs)) for views in each])
    same = np.isfinite(found).all(axis=0)
    return np.median(found[:, same], axis=1) if same.any() else np.full(len(angles), np.nan)


def _pairs(views: Views, silhouettes: Silhouettes, most: int = MOST_PAIRS) -> NDArray[np.intp]:
    """Return the pairs to compare, evenly spread if there are many. (pairs, 2)"""
    back, kind = views.matrices[:, :3, 2], views.parallel
    i, j = _each_pair(len(back))
    # The same image from a camera that is turned over, such as ParaView's second half, is compared like any other.
    angle = np.degrees(np.arccos(np.clip(np.einsum("pk,pk->p", back[i], back[j]), -1.0, 1.0)))
    good = (angle > PAIR_ANGLES[0]) & (angle < PAIR_ANGLES[1]) & silhouettes.usable[i] & silhouettes.usable[j]
    pairs = np.stack([i, j], 1)[good & (kind[i] == kind[j])]
    return pairs[np.linspace(0, len(pairs) - 1, min(len(pairs), most)).astype(int)] if len(pairs) else pairs


@lru_cache(maxsize=8)
def _each_pair(count: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the indices of every pair of ``count`` views, the first before the second."""
    return np.triu_indices(count, 1)


def _differences(views: Views, silhouettes: Silhouettes, pairs: NDArray[np.intp]) -> Array:
    if not len(pairs):
        return np.zeros(0)
    matrices, focal, parallel = views.matrices, views.focal, views.parallel
    offset = silhouettes.points - views.centres[:, None]
    offset = offset * (1.0, -1.0) / focal[:, None, None]  # (n, tangents, 2), y up
    depth = np.broadcast_to(np.where(parallel, 0.0, -1.0)[:, None, None], (*offset.shape[:2], 1))
    rays = np.einsum("nab,ntb->nta", matrices[:, :3, :3], np.concatenate([offset, depth], 2))
    parts = []
    for these, compare in ((parallel, _parallel), (~parallel, _pinhole)):
        own = pairs[these[pairs[:, 0]]]
        if len(own):
            parts.append(compare(matrices, rays, focal, own))
    return np.concatenate(parts)


def _pinhole(matrices: Array, rays: Array, focal: Array, pairs: NDArray[np.intp]) -> Array:
    """Compare the outermost planes through both positions; the angle about the line between them names a plane."""
    units = rays / np.linalg.norm(rays, axis=2, keepdims=True)
    found = np.empty((len(pairs), 2))
    compare_tangents(np.ascontiguousarray(matrices[:, :3, 3]), units, focal, pairs, found)
    return found.ravel()


def _parallel(matrices: Array, rays: Array, focal: Array, pairs: NDArray[np.intp]) -> Array:
    """Compare the extents along the normal of the planes that are parallel to the rays of both views."""
    i, j = pairs.T
    normal = np.cross(matrices[i, :3, 2], matrices[j, :3, 2])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    extents = []
    for view in (i, j):
        along = np.einsum("ptk,pk->pt", rays[view] + matrices[view, None, :3, 3], normal)
        extents.append(np.stack([along.max(1), along.min(1)]))
    return ((extents[0] - extents[1]) * np.sqrt(focal[i] * focal[j])).T.ravel()


def _cost(differences: Array) -> float:
    """Return a mean that outliers change little: Huber's loss in pixels."""
    size = np.abs(differences[np.isfinite(differences)])
    if not len(size):
        return np.inf
    limit = max(OUTLIER * float(np.median(size)), 0.5)
    return float(np.mean(np.where(size <= limit, 0.5 * size**2, limit * (size - 0.5 * limit))))


def _golden(cost: Callable[[float], float], low: float, high: float) -> float:
    """Return the minimum of a function of one variable by golden section."""
    ratio = 0.5 * (np.sqrt(5.0) - 1.0)
    a, b = high - ratio * (high - low), low + ratio * (high - low)
    at_a, at_b = cost(a), cost(b)
    for _ in range(14):
        if at_a <= at_b:
            high, b, at_b = b, a, at_a
            a = high - ratio * (high - low)
            at_a = cost(a)
        else:
            low, a, at_a = a, b, at_b
            b = low + ratio * (high - low)
            at_b = cost(b)
    return a if at_a <= at_b else b
