"""What the record of views says about their volume: its grid, and what may look otherwise than expected."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.bricks.formats.source import Level
from svv.dvr.functions import slicer
from svv.dvr.functions.scales import doubled
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.appearance import Appearance
from svv.dvr.read.grids import index_to_world, to_array
from svv.io.views.view_meta import VolumeGrid

Array = NDArray[np.float64]

MOST_LABELS, COUNTED, LINES = 64, 1_000_000, 300_000
"""Most values of a volume of labels; and numbers of voxels that are counted, and of those whose neighbours are."""

GREYS, GRADUAL = 16, 2 / 3
"""Number of values above which they are greys of a few bits, and not labels, if more than this part of all unequal
neighbours is one step apart."""

SEEN, ALIKE = 0.02, 0.1
"""Opacities above which something is seen, and differences of colours that are not."""

INTERPOLATED = (
    "The volume has only {count} values, as labels have, and is drawn with interpolation: {value:.3g}, which is shown "
    "otherwise, appears between neighbours of {low:g} and {high:g}, too. Add --nearest to show each voxel's own value "
    "(Python: nearest=True; ParaView: Interpolation Type Nearest)."
)
LEFT_HANDED = (
    "The axes of the volume are left-handed. It is drawn in its place; ParaView and PyVista themselves show next to "
    "nothing of such a volume."
)
AT_JUMP = (
    "Voxels lie exactly at a jump of the transfer function, at {value:g}: they have the opacity of its second point "
    "and the colour of its first, while ParaView takes either, by the number; move the points between the values."
)


def grid_of(level: Level, kind: str, span: tuple[float, float]) -> VolumeGrid:
    """Return the record of a grid whose values have a type and a range."""
    (a, b, c), (d, e, f), (g, h, i) = (level.axes / level.spacing).tolist()
    z, y, x = level.shape
    sx, sy, sz = level.spacing.tolist()
    ox, oy, oz = level.origin.tolist()
    return VolumeGrid(
        dimensions=(x, y, z),
        spacing=(sx, sy, sz),
        origin=(ox, oy, oz),
        direction=((a, b, c), (d, e, f), (g, h, i)),
        type=kind,
        range=span,
    )


def describe_deviations(image: vtkImageData, tf: TransferFunction) -> tuple[str, ...]:
    """Return sentences on what may look otherwise than expected of a volume, or of its overview, on linear scales."""
    nearest, values = Appearance.of(image).nearest, to_array(image)
    own = slicer.NEAREST.format(name=tf.name)
    notes = [note for note in tf.notes if not (nearest and note == own)]
    if np.linalg.det(index_to_world(image)[:3, :3]) < 0:
        notes.append(LEFT_HANDED)
    labels = labels_of(values)
    if labels is not None:
        notes += [] if nearest else _between(values, labels, tf)
        notes += _at_jumps(labels, tf)
    return tuple(notes)


def labels_of(values: NDArray[np.number]) -> Array | None:
    """Return the values of a volume that has few, all of them whole numbers, ascending; otherwise None."""
    flat = values.ravel()
    found = np.unique(flat[:: max(1, flat.size // COUNTED)]).astype(np.float64)
    return found if len(found) <= MOST_LABELS and bool((found == np.rint(found)).all()) else None


def _between(values: NDArray[np.number], labels: Array, tf: TransferFunction) -> list[str]:
    """Return a sentence if interpolation between neighbours shows what neither of them is."""
    neighbours = _neighbours(values, labels)
    if len(labels) > GREYS and neighbours:
        numbers = np.searchsorted(labels, [*neighbours])
        steps, times = numbers[:, 1] - numbers[:, 0], np.array([*neighbours.values()])
        if times[steps == 1].sum() > GRADUAL * times.sum():
            return []
    for low, high in neighbours:
        at = tf.samples(low, high)
        opacity = tf.opacity_at(at)
        highest = int(opacity.argmax())
        if opacity[highest] > max(opacity[0], opacity[-1]) + SEEN:
            return [INTERPOLATED.format(count=len(labels), value=at[highest], low=low, high=high)]
        inner = labels[(labels > low) & (labels < high)]
        inner = inner[tf.opacity_at(inner) > SEEN]
        ends = np.array([low, high])
        ends = ends[tf.opacity_at(ends) > SEEN]
        if len(inner) and len(ends):
            away = np.abs(tf.colour_at(inner)[:, None] - tf.colour_at(ends)).max(axis=2).min(axis=1)
            if away.max() > ALIKE:
                value = inner[away.argmax()]
                return [INTERPOLATED.format(count=len(labels), value=value, low=low, high=high)]
    return []


def _neighbours(values: NDArray[np.number], labels: Array) -> dict[tuple[float, float], int]:
    """Return the pairs of values that neighbours have on some of the volume's lines, with their numbers, in order."""
    found: Counter[tuple[int, int]] = Counter()
    for axis in range(3):
        lines = np.moveaxis(values, axis, -1)
        step = max(1, int(np.sqrt(values.size / LINES)))
        numbers = np.searchsorted(labels, lines[::step, ::step]).clip(0, len(labels) - 1)
        pairs, times = np.unique(numbers[..., :-1] * len(labels) + numbers[..., 1:], return_counts=True)
        for pair, count in zip(pairs.tolist(), times.tolist(), strict=True):
            a, b = divmod(pair, len(labels))
            found[min(a, b), max(a, b)] += count
    return {(float(labels[a]), float(labels[b])): count for (a, b), count in sorted(found.items()) if a < b}


def _at_jumps(labels: Array, tf: TransferFunction) -> list[str]:
    """Return a sentence if labels that are seen, or would be, lie at a jump."""
    jumps = np.intersect1d(labels, [*doubled(tf.opacities), *doubled(tf.colours)])
    if tf.space == "Step":
        jumps = np.union1d(jumps, np.intersect1d(labels, [point[0] for point in tf.colours[1:-1]]))
    beside = np.stack([tf.opacity_at(at) for at in (np.nextafter(jumps, -np.inf), jumps, np.nextafter(jumps, np.inf))])
    seen = jumps[(beside > SEEN).any(axis=0)] if len(jumps) else jumps
    return [AT_JUMP.format(value=seen[0])] if len(seen) else []
