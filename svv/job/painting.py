"""From a volume to its painting in one call of Python: views, training and paint."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from svv.errors import BadInput, Progress, part, silent, warn_caller
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet
from svv.job.request import Paint, Request, run
from svv.options.making import PaintOptions, TrainOptions, ViewOptions
from svv.render.colour_maps import colour_map
from svv.train.paint.ink import Ink, StyleInput, style_named
from svv.train.run.config import settings_of

if TYPE_CHECKING:
    from vtkmodules.vtkCommonDataModel import vtkImageData

    from svv.core.colour.shading import Shading
    from svv.dvr.draw.given import GivenFunction, GivenVolume
    from svv.dvr.draw.large import LargeVolume
    from svv.dvr.functions.transfer_functions import TransferFunction
    from svv.dvr.read.grids import Triple

READING = 0.05
"""Fraction of the work as which it is shown to read a volume before its colour map is known."""


def paint(  # noqa: PLR0913 - what shows the volume, and how it is painted
    volume: GivenVolume,
    *styles: str | Path | NDArray[Any] | Ink | StyleInput,
    tf: GivenFunction | None = None,
    cmap: Any = None,
    opacity: Any = None,
    clim: float | Sequence[float] | None = None,
    spacing: Triple | None = None,
    origin: Triple | None = None,
    shading: Shading | None = None,
    nearest: bool = False,
    progress: Progress = silent,
    tell: Callable[[str], None] = warn_caller,
    **changes: Any,
) -> Scene:
    """Paint a volume: draw views of it, train a scene on them, and paint its regions.

    Args:
        volume: What :func:`svv.make_views` takes: a plotter or the actor that its ``add_volume`` returned, an array
            indexed [z, y, x], a grid, or a file.
        styles: A style for each region, in turn: ``gallery:NAME``, ``ink:NAME``, a picture's file, or a picture
            (H, W, 3), sRGB in [0, 1] or of bytes.
        tf: Transfer function, as for :func:`svv.make_views`; by default that of the plotter or actor, otherwise two
            ranges of the histogram.
        cmap: Instead of ``tf``, a colour map as ``pyvista.Plotter.add_volume`` takes it, by default PyVista's own.
        opacity: With or instead of ``cmap``, an opacity as ``add_volume`` takes it; by default ``linear``. Opacities
            are per PyVista's unit distance, which is 1 for grids that are neither images nor rectilinear.
        clim: Values of the first and the last colour, or one number for both sides of 0; by default the smallest and
            largest value.
        spacing: Distances between the voxels of an array (x, y, z), world units, > 0; 1 by default.
        origin: Position of an array's first voxel (x, y, z), world units; 0 by default.
        shading: Shading of the volume; by default that of ``tf``, the plotter or actor; with ``cmap``, none, as in
            PyVista; otherwise a headlight with ParaView's coefficients.
        nearest: Whether to show each voxel's own value, as labels need; otherwise as an actor does, and interpolated by
            default.
        progress: Called several times a second; the work stops when it raises.
        tell: Called with a sentence on each thing that may look otherwise than expected.
        changes: Fields of :class:`svv.ViewOptions`, :class:`svv.TrainOptions` and :class:`svv.PaintOptions` by name,
            such as ``preset="draft"``, ``n=40``, ``size=400`` or ``mapping={0: 1}``.

    Returns:
        The painted scene: ``svv.show(painted, camera=plotter)`` shows it, ``painted.render("iso")`` renders a picture,
        and ``painted.save("painted.svv")`` writes it.

    Raises:
        BadInput: The reasons of :func:`svv.make_views`, :func:`svv.train_scene` and :func:`svv.stylize_scene`; there is
            no style; PyVista does not know the colour map or opacity, or both these and ``tf`` are given.

    >>> z, y, x = np.mgrid[-1:1:24j, -1:1:24j, -1:1:24j]
    >>> array = 1.0 - np.sqrt(x**2 + 2.0 * y**2 + 3.0 * (z - 0.2) ** 2) + 0.2 * x
    >>> style = np.random.default_rng(0).random((64, 64, 3), np.float32)
    >>> small = {"preset": "draft", "n": 12, "size": 48, "time_limit": 1.0, "tell": lambda said: None}
    >>> painted = svv.paint(array, style, cmap="viridis", opacity="linear", spacing=(1, 1, 1), **small)
    >>> painted.networks, painted.render("xy").rgba.shape
    (('base', 'pcn', 'styled'), (800, 800, 4))
    """
    from svv.dvr.draw.given import given_volume
    from svv.dvr.draw.views import make_views

    drawing, training, painting = _options(changes)
    given = [_style(style) for style in styles]  # errors in what is asked for are reported before the work begins
    if not given:
        raise BadInput("Give at least one style, such as 'gallery:impasto', 'ink:hatching' or a picture's file.")
    rescale = None
    if any(one is not None for one in (cmap, opacity, clim)):
        if tf is not None:
            raise BadInput("Give either a transfer function (tf), or a colour map and opacity (cmap, opacity, clim).")
        progress(0.0, "reading the volume")
        reading = part(progress, 0.0, READING)
        ready = given_volume(volume, nearest, drawing, reading, spacing, origin)
        clim = _range_of(volume) if clim is None else clim
        rescale = clim is None and not hasattr(cmap, "scalar_range")  # a table has a range of its own
        tf = _function(cmap, "linear" if opacity is None else opacity, clim, _unit(volume, ready))

    def draw(asked: ViewOptions, told: Progress) -> ViewSet:
        return make_views(
            volume, tf, asked, spacing=spacing, origin=origin, shading=shading, rescale=rescale, nearest=nearest,
            progress=told,
        )[0]  # fmt: skip

    request = Request(draw, drawing, training, paint=Paint.of(given, painting), device=training.device)
    result = run(request, progress if rescale is None else part(progress, READING, 1.0))
    for said in result.notes:
        tell(said)
    return result.scene


def _options(changes: Mapping[str, Any]) -> tuple[ViewOptions, TrainOptions, PaintOptions]:
    """Return the options of the three steps with some fields changed, each in all that have it."""
    left = set(changes)

    def changed(options: Any) -> Any:
        own = {field.name for field in fields(options)} - {"test", "go_on"}  # which have no meaning here
        left.difference_update(own)
        return replace(options, **{name: value for name, value in changes.items() if name in own})

    drawing, training, painting = map(changed, (ViewOptions(test=0), TrainOptions(), PaintOptions()))
    if left:
        raise TypeError(f"paint() got an unexpected keyword argument '{min(left)}'")
    settings_of(training)
    settings_of(painting)
    return drawing, training, painting


def _style(given: Any) -> StyleInput:
    if isinstance(given, StyleInput):
        return given
    if isinstance(given, (str, Path)):
        name, style = style_named(given)
        return StyleInput(style, name)
    return StyleInput(given)


def _function(cmap: Any, opacity: Any, clim: Any, unit: float | None) -> TransferFunction:
    """Return the transfer function of a colour map, between 0 and 1 unless its range is given."""
    from svv.dvr.draw.plotted import function_of

    try:
        span = np.array((0.0, 1.0) if clim is None else (-clim, clim) if np.ndim(clim) == 0 else clim, np.float64)
    except (TypeError, ValueError):
        span = np.empty(0)
    if span.shape != (2,) or not (np.isfinite(span).all() and span[0] < span[1]):
        raise BadInput(f"clim needs two ascending numbers, or one above 0, not {clim}.")
    function = function_of(colour_map(cmap, opacity, span.tolist()))
    assert function is not None
    return replace(function, unit_distance=unit)


def _range_of(volume: object) -> tuple[float, float] | None:
    """Return the range of a mesh's values, which the image that it is resampled to may not reach; otherwise None."""
    from vtkmodules.vtkCommonDataModel import vtkDataSet

    from svv.dvr.read.grids import pick_scalars
    from svv.dvr.read.meshes import is_mesh

    if not (isinstance(volume, vtkDataSet) and is_mesh(volume)):
        return None
    low, high = pick_scalars(volume, None, "The volume")[0].GetRange()
    return low, high


def _unit(volume: object, ready: vtkImageData | LargeVolume) -> float | None:
    """Return the opacity unit distance that PyVista gives a volume; None for ParaView's, which it lacks for blocks."""
    from vtkmodules.vtkCommonDataModel import vtkCompositeDataSet, vtkDataSet, vtkImageData, vtkRectilinearGrid

    from svv.dvr.draw.plotted import function_of
    from svv.dvr.read.grids import own_unit_distance

    own = function_of(volume)
    if own is not None:
        return own.unit_distance
    if isinstance(volume, vtkCompositeDataSet):
        return None
    if isinstance(volume, vtkDataSet):
        if not isinstance(volume, (vtkImageData, vtkRectilinearGrid)):
            return 1.0
        return float(volume.GetLength() / (np.mean(volume.GetDimensions()) - 1.0))
    if not isinstance(ready, vtkImageData):
        ready = ready.overview
    if own_unit_distance(ready) is not None:
        return None
    return float(ready.GetLength() / (np.mean(ready.GetDimensions()) - 1.0))
