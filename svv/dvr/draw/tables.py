"""Whether the tables of VTK's ray casters, over all values of a volume, tell the steps of a transfer function apart.

One value far from the others, such as a fill value, may put all that the function shows into a single entry.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import DTypeLike, NDArray
from vtkmodules.vtkRenderingCore import vtkColorTransferFunction, vtkVolumeProperty

from svv.core.interval_text import interval_text
from svv.dvr.draw.frame import LEVELS
from svv.dvr.functions.jumps import settled
from svv.dvr.functions.transfer_functions import TransferFunction

Array = NDArray[np.float64]

ENTRIES = {"cpu": 1 << 15, "gpu": 1 << 14}
"""Most entries of the tables of VTK's ray casters: the CPU's takes the nearest one, the GPU's interpolates (see
:func:`refine_tables`)."""

LOST = 1e-4
"""Part of a value's place in that table by which VTK's interpolation in 15-bit numbers falls short. (On the
GPU, all places are half an entry off at most: the ends of the values are the outer edges of the end's texels.)"""

TRIED, INSIDE, RANGES = 4096, 64, 64
"""Voxels that are looked up; values in each visible range; most visible ranges."""

UNRESOLVED = 0.01
"""Mean error of colour and opacity, as a fraction of the opacity, above which a table has too few entries."""

SHIFTED = 0.0025
"""Shift of all values in a table, as a fraction of the width of what is told apart or of most voxels' values."""

WIDTHS = 16.0
"""Distance from what a function tells apart, in its width, to which values are limited where nothing else draws."""


def is_resolved(
    caster: str, tf: TransferFunction, span: tuple[float, float], dtype: DTypeLike, voxels: NDArray[np.number]
) -> bool:
    """Return whether the table of VTK's ``cpu`` or ``gpu`` ray caster shows values as the function does.

    The values have a type and a smallest and largest one (``span``); some or none of their voxels are given.
    """
    low, high = span
    if not high > low:
        return True
    kind = np.dtype(dtype)
    # Whole numbers are rounded between voxels, too, unless they are given as reals.
    whole = caster == "cpu" and kind.kind in "iub" and kind.itemsize <= 2 and high - low > LEVELS
    first, last = tf.varying_range(low, high)
    shown = [(max(a, first), min(b, last)) for a, b in tf.visible_ranges(first, last)[:RANGES]]
    within = np.concatenate([_middles(first, last, 1024), *(_middles(a, b, INSIDE) for a, b in shown)])
    tried = voxels.ravel()[:: max(1, voxels.size // TRIED)].astype(np.float64)
    within = np.unique(np.clip(np.rint(within), low, high)) if whole else within
    entries = min(ENTRIES[caster], int(high - low) + 1) if whole else ENTRIES[caster]
    if tried.size:
        shift = LOST * (last - low) if caster == "cpu" else 0.5 * (high - low) / entries
        if shift > SHIFTED * max(last - first, float(np.subtract(*np.percentile(tried, (99.5, 0.5))))):
            return False
    found = (_error(caster, tf, span, entries, values) for values in (within, tried) if values.size)
    return all(error <= UNRESOLVED for error in found)


def describe_fallback_caster(caster: str, tf: TransferFunction, span: tuple[float, float]) -> str:
    """Say that another ray caster draws because :func:`is_resolved` does not hold."""
    return (
        f"VTK's {caster.upper()} ray caster has {ENTRIES[caster]:,} colours for all of the volume's values, from "
        f"{interval_text(*span)}, which do not tell the steps of '{tf.name}' apart: drawn by bricks instead."
    )


def limits(tf: TransferFunction, span: tuple[float, float], dtype: DTypeLike) -> tuple[float, float]:
    """Return the values to which those of a volume may be limited so that the CPU ray caster's table resolves them.

    What is beyond looks like the limits or is invisible; they are ``WIDTHS`` away, so that interpolation changes
    little.
    """
    if is_resolved("cpu", tf, span, dtype, np.empty(0)):
        return span
    first, last = tf.varying_range(*span)
    far = WIDTHS * (last - first)
    return max(span[0], first - far), min(span[1], last + far)


def refine_tables(look: vtkVolumeProperty, low: float, high: float) -> None:
    """Let the GPU ray caster make tables of all its ``ENTRIES`` for values from low to high.

    It makes as many as the two closest points of a function ask for, so two points are added that are as close, beyond
    all values. (Two points at one value would ask for no number, see :mod:`svv.dvr.functions.jumps`.)
    """
    step = (high - low) / ENTRIES["gpu"]
    for function in (look.GetRGBTransferFunction(), look.GetScalarOpacity()):
        last = function.GetRange()[1]
        end = max(high, last)
        for value in (end + step, end + 2.0 * step):
            if value > end:
                if isinstance(function, vtkColorTransferFunction):
                    function.AddRGBPoint(value, *function.GetColor(last))
                else:
                    function.AddPoint(value, function.GetValue(last))


def light(tf: TransferFunction, at: Array) -> Array:
    """Return the colours of values times their opacities, and these. (N, 4)"""
    opacity = tf.opacity_at(at)[:, None]
    return np.concatenate([tf.colour_at(at) * opacity, opacity], axis=1)


def _middles(low: float, high: float, count: int) -> Array:
    return np.asarray(low + (high - low) * (np.arange(count) + 0.5) / count)


def _error(caster: str, tf: TransferFunction, span: tuple[float, float], entries: int, values: Array) -> float:
    """Return the mean error of the table at values, as a fraction of their mean opacity."""
    given = settled(tf, span[1] - span[0])
    low, high = span
    share, step = (values - low) / (high - low), (high - low) / (entries - 1)
    if caster == "cpu":
        found = light(given, low + np.rint(share * (entries - 1)) * step)
    else:
        place = share * (entries - 1)
        part = (place - np.floor(place))[:, None]
        found = light(given, low + np.floor(place) * step) * (1.0 - part)
        found += light(given, low + np.ceil(place) * step) * part
    aside = 1e-6 * (values.max() - values.min())  # a value at a jump may have the colour of either side
    exact = [light(tf, values + side * aside) for side in (-1.0, 0.0, 1.0)]
    error = np.min([np.abs(found - one).mean(axis=1) for one in exact], axis=0).mean()
    return float(error / max(exact[1][:, 3].mean(), 1e-12))
