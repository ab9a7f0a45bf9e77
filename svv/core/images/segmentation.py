"""Segmentation of a picture: into regions of similar appearance, or into the part that a few points select.

Superpixels (SLIC) are described by their CIELAB colour and by the variation of its lightness, which distinguishes
strokes of different size or contrast. Letters: h and w height and width in pixels, K superpixels, E pairs of
neighbours.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.sparse import coo_array, diags_array
from scipy.sparse.linalg import spsolve

from svv.core.colour.colour import rgb_to_lab

Points = Sequence[tuple[float, float]]
"""Points (x, y) in pixels: x to the right, y down, (0, 0) the corner of the first pixel."""
Labels = NDArray[np.int64]
Mask = NDArray[np.bool_]

SUPERPIXELS = 900
"""Approximate number of superpixels of a picture: 30 along each side of a square one."""

APART_FACTOR = 1.5
"""Factor on the price of joining regions that do not touch, in squared distances."""

TEXTURE_WEIGHT = 1.4
"""Weight of texture relative to colour: a lightness deviation of 1 counts as this colour difference."""

LINKS, LIKENESS = 12, 0.35
"""Number of similar superpixels to which each one is linked in a selection, and their weight relative to touching
ones."""

NEITHER_WEIGHT = 0.17
"""Prior against selection: superpixels that resemble neither kind of point are not selected."""


def superpixels(picture: NDArray[np.floating], count: int = SUPERPIXELS) -> Labels:
    """Cut a picture (h, w, 3), sRGB in [0, 1], into about ``count`` connected pieces, numbered from 0. (h, w)"""
    from skimage.segmentation import slic

    # Blur by a fifth of a superpixel's side, so that strokes and dots lie inside superpixels and do not outline them.
    side = (picture.shape[0] * picture.shape[1] / count) ** 0.5
    labels = slic(picture, count, compactness=12.0, sigma=0.2 * side, start_label=0, channel_axis=-1)
    return np.unique(labels, return_inverse=True)[1].reshape(labels.shape).astype(np.int64)


def looks(picture: NDArray[np.floating], labels: Labels) -> NDArray[np.float64]:
    """Describe superpixels by mean CIELAB and the deviation of lightness at two sizes of detail. (K, 5)"""
    lab = rgb_to_lab(np.clip(picture, 0, 1))
    side = (labels.size / (labels.max() + 1)) ** 0.5
    light = lab[..., 0]
    fine, coarse = gaussian_filter(light, 0.08 * side), gaussian_filter(light, 0.35 * side)
    details = [gaussian_filter(d**2, 0.5 * side) ** 0.5 for d in (light - fine, fine - coarse)]
    planes = [gaussian_filter(lab[..., c], 0.35 * side) for c in range(3)] + [TEXTURE_WEIGHT * d for d in details]
    size = np.bincount(labels.ravel())
    return np.stack([np.bincount(labels.ravel(), plane.ravel()) / size for plane in planes], 1)


def neighbours(labels: Labels) -> NDArray[np.int64]:
    """Return the pairs of superpixels that touch, the smaller number first. (E, 2)"""
    beside = np.concatenate([
        np.stack([labels[:, 1:].ravel(), labels[:, :-1].ravel()], 1),
        np.stack([labels[1:].ravel(), labels[:-1].ravel()], 1),
    ])  # fmt: skip
    beside = beside[beside[:, 0] != beside[:, 1]]
    return np.unique(np.sort(beside, 1), axis=0)


def regions(picture: NDArray[np.floating], count: int) -> Labels:
    """Cut a picture (h, w, 3) into ``count`` >= 1 regions by colour and texture; see :func:`partitions`. (h, w)"""
    return partitions(picture, [count])[0]


def partitions(picture: NDArray[np.floating], counts: Sequence[int], pieces: int = SUPERPIXELS) -> list[Labels]:
    """Cut a picture into several numbers of regions by colour and texture, each a finer cut of the one below it.

    Superpixels are joined pair by pair, always the pair with the lowest price (Ward 1963): n_a n_b / (n_a + n_b) |f_a -
    f_b|^2. Superpixels that do not touch can be joined, too; their price is multiplied by :data:`APART_FACTOR`.

    ``picture``: sRGB in [0, 1] (h, w, 3); ``counts``: numbers of regions >= 1, of which there are fewer if the picture
    has fewer superpixels; ``pieces``: approximate number of those. For each count, returns the region of each pixel,
    numbered by size from the largest, 0. (h, w)
    """
    labels = superpixels(picture, pieces)
    mean, size = looks(picture, labels), np.bincount(labels.ravel()).astype(np.float64)
    total = len(size)
    touch = np.zeros((total, total), bool)
    touch[tuple(neighbours(labels).T)] = True
    touch |= touch.T
    owner = np.arange(total)
    owners = {total: owner.copy()}
    cost = _prices(mean, size, mean, size) * np.where(touch, 1.0, APART_FACTOR)
    np.fill_diagonal(cost, np.inf)
    for left in range(total - 1, min(counts) - 1, -1):
        a, b = np.unravel_index(int(cost.argmin()), cost.shape)
        mean[a] = (size[a] * mean[a] + size[b] * mean[b]) / (size[a] + size[b])
        size[a] += size[b]
        touch[a] |= touch[b]
        touch[:, a] = touch[a]
        owner[owner == b] = a
        alive = np.isfinite(cost[a])
        alive[b] = False
        row = np.full(total, np.inf)
        row[alive] = _prices(mean[a : a + 1], size[a : a + 1], mean[alive], size[alive])[0]
        row[alive] *= np.where(touch[a, alive], 1.0, APART_FACTOR)
        cost[a], cost[:, a] = row, row
        cost[b], cost[:, b] = np.inf, np.inf
        if left in counts:
            owners[left] = owner.copy()
    return [by_size(owners[min(count, total)][labels], total) for count in counts]


def by_size(owned: Labels, total: int) -> Labels:
    """Return labels below ``total`` numbered by size, the largest 0."""
    areas = np.bincount(owned.ravel(), minlength=total)
    place = np.empty(total, np.int64)
    place[np.argsort(-areas, kind="stable")] = np.arange(total)
    return np.asarray(place[owned], np.int64)


def _prices(
    mean: NDArray[np.float64], size: NDArray[np.float64], others: NDArray[np.float64], sizes: NDArray[np.float64]
) -> NDArray[np.float64]:
    square = ((mean[:, None] - others) ** 2).sum(-1)
    return np.asarray(size[:, None] * sizes / (size[:, None] + sizes) * square)


def selection(
    picture: NDArray[np.floating], positive: Points, negative: Points = (), start: Mask | None = None
) -> Mask:
    """Return the part of a picture that points (x, y) select: true at every positive and at no negative one. (h, w)

    A random walker on the graph of superpixels with a prior (Grady 2005): x solves (L + g (p + q)) x = g p, with x = 1
    at positive and 0 at negative points. L is the Laplacian of a graph that links superpixels to those that they touch
    and to those most similar to them. p and q are the similarity of a superpixel to positive and negative points or,
    with ``start``, a mask (h, w) to refine, the fractions of it inside and outside the mask; without, one positive
    point is needed. Superpixels with x > 1/2 are selected. ``picture``: sRGB in [0, 1]. (h, w, 3)
    """
    labels = superpixels(picture)
    inside, outside = _places(positive, labels.shape), _places(negative, labels.shape)
    labels = _split(labels, inside, outside)
    features = looks(picture, labels)
    total = len(features)
    seeds = {int(labels[y, x]): 1.0 for y, x in inside} | {int(labels[y, x]): 0.0 for y, x in outside}
    pairs = neighbours(labels)
    step = ((features[pairs[:, 0]] - features[pairs[:, 1]]) ** 2).sum(1)
    scale = max(float(np.median(step)), 1.0)
    laplacian = _laplacian(features, pairs, step, scale, total)
    chosen = features[[k for k, value in seeds.items() if value == 1.0]]
    refused = features[[k for k, value in seeds.items() if value == 0.0]]
    if start is not None:
        towards = np.bincount(labels.ravel(), start.ravel()) / np.bincount(labels.ravel())
        away, weight = 1 - towards, 0.05
    else:
        spread = _spread(features, scale)
        towards = np.exp(-_nearest(features, chosen) / spread)
        # Superpixels unlike the chosen ones are not selected; this prior is weaker if negative points are given.
        unlike = NEITHER_WEIGHT if len(refused) else 2 * NEITHER_WEIGHT
        away = np.maximum(np.exp(-_nearest(features, refused) / spread), unlike)
        weight = 0.25
    system = laplacian + weight * diags_array(towards + away + 1e-9)
    free = np.array([k for k in range(total) if k not in seeds], dtype=np.int64)
    fixed = np.fromiter(seeds, dtype=np.int64, count=len(seeds))
    x = np.zeros(total)
    x[fixed] = [seeds[k] for k in fixed.tolist()]
    if len(free):
        system = system.tocsr()
        known = weight * towards[free] - system[free][:, fixed] @ x[fixed]
        x[free] = spsolve(system[free][:, free].tocsc(), known)
    return np.asarray(x > 0.5)[labels]


def _places(points: Points, shape: tuple[int, ...]) -> list[tuple[int, int]]:
    """Return row and column of the pixel under each point."""
    return [(min(int(y), shape[0] - 1), min(int(x), shape[1] - 1)) for x, y in points]


def _split(labels: Labels, inside: list[tuple[int, int]], outside: list[tuple[int, int]]) -> Labels:
    """Cut superpixels that contain points of both kinds: each pixel goes with the nearest of its points."""
    labels = labels.copy()
    both = {int(labels[p]) for p in inside} & {int(labels[p]) for p in outside}
    for number in sorted(both):
        y, x = np.nonzero(labels == number)
        kinds = [
            (p, kind) for points, kind in ((inside, True), (outside, False)) for p in points if labels[p] == number
        ]
        far = np.stack([(y - p[0]) ** 2 + (x - p[1]) ** 2 for p, _ in kinds])
        belongs = np.array([kind for _, kind in kinds])[far.argmin(0)]
        labels[y[~belongs], x[~belongs]] = labels.max() + 1
    return labels


def _laplacian(
    features: NDArray[np.float64], pairs: NDArray[np.int64], step: NDArray[np.float64], scale: float, total: int
) -> coo_array:
    from scipy.spatial import cKDTree

    distance, like = cKDTree(features).query(features, k=min(LINKS + 1, total))
    like, distance = like.reshape(total, -1)[:, 1:], distance.reshape(total, -1)[:, 1:]
    a = np.concatenate([pairs[:, 0], np.repeat(np.arange(total), like.shape[1])])
    b = np.concatenate([pairs[:, 1], like.ravel()])
    w = np.concatenate([np.exp(-step / scale), LIKENESS * np.exp(-(distance.ravel() ** 2) / scale)]) + 1e-6
    graph = coo_array((np.concatenate([w, w]), (np.concatenate([a, b]), np.concatenate([b, a]))), shape=(total, total))
    return diags_array(np.asarray(graph.sum(1))) - graph


def _spread(features: NDArray[np.float64], scale: float) -> float:
    """Return the squared distance at which appearances count as different, relative to the picture's variety."""
    return max(4.0 * scale, 0.12 * float(features.var(0).sum()), 25.0)


def _nearest(features: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the squared distance of each vector to the nearest of the others. (K,)"""
    if not len(others):
        return np.full(len(features), np.inf)
    return np.asarray(((features[:, None] - others) ** 2).sum(-1).min(1))
