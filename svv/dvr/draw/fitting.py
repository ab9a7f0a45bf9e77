"""A volume with its transfer function, and the ray caster that shows both: what is settled before anything is drawn."""

from __future__ import annotations

from dataclasses import dataclass, replace

from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.dvr.draw.casters import choose_mapper
from svv.dvr.draw.large import LargeVolume, Opened, quickest
from svv.dvr.draw.tables import describe_fallback_caster, is_resolved
from svv.dvr.functions.histogram import (
    default_transfer_function,
    describe_default_range,
    describe_stretching,
    usual_range,
)
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.grids import to_array


@dataclass(frozen=True, eq=False)
class Fitting:
    """A volume that is ready to be drawn."""

    opened: Opened
    tf: TransferFunction
    """Transfer function for the volume's values, with its unit distance."""
    rescaled: bool
    """Whether the function was stretched over the values."""
    mapper: str
    """Name of the ray caster, as that was asked for; ``bricks`` if another one would not resolve the function."""
    notes: tuple[str, ...]
    """What the user should know, in sentences."""


def fitted_to(
    volume: vtkImageData | LargeVolume,
    tf: TransferFunction | None,
    mapper: str,
    memory: float | None = None,
    rescale: bool | None = None,
) -> Fitting:
    """Fit a transfer function, by default two ranges of the histogram, to a volume, and choose the ray caster.

    ``mapper`` is ``auto``, ``bricks``, ``gpu`` or ``cpu``; see ``memory_allowed`` for memory,
    ``TransferFunction.fitted`` for ``rescale``. Raises BadInput if the function does not fit, or the ray caster is
    unknown.
    """
    small, notes = volume if isinstance(volume, vtkImageData) else volume.overview, []
    usual = usual_range(small) if tf is None or rescale is not False else None
    given = tf or default_transfer_function(small, usual)
    quick = quickest(volume, mapper, memory, tf, rescale)
    chosen, reason = _resolving(volume, quick, given, rescale)
    opened = Opened.of(volume, chosen, memory)
    fitted, rescaled = given.fitted(*opened.range, rescale), given.is_stretched(*opened.range, rescale)
    if reason is not None and mapper != "auto":
        notes.append(reason)
    if usual is not None and tf is None:
        notes.append(describe_default_range(usual))
    elif usual is not None and rescaled and (said := describe_stretching(small, usual, given)) is not None:
        notes.append(said)
    unit = fitted.unit_in(opened.whole) if fitted.slabs else fitted.unit_distance or opened.unit_distance
    fitted = replace(fitted, unit_distance=unit)
    return Fitting(opened, fitted, rescaled, chosen, tuple(notes))


def _resolving(
    volume: vtkImageData | LargeVolume, mapper: str, tf: TransferFunction, rescale: bool | None
) -> tuple[str, str | None]:
    """Return the ray caster if it tells the steps of a function apart, otherwise bricks and why."""
    if mapper == "bricks" or not isinstance(volume, vtkImageData):
        return mapper, None
    values, caster = to_array(volume), choose_mapper(mapper).name
    span = float(values.min()), float(values.max())
    fitted = tf.fitted(*span, rescale)
    if is_resolved(caster, fitted, span, values.dtype, values):
        return mapper, None
    return "bricks", describe_fallback_caster(caster, fitted, span)
