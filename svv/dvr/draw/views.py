"""Views of a volume: images with straight alpha from cameras all around it."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkCommonCore import vtkVersion

from svv.bricks.formats.source import Level
from svv.core.colour.shading import Shading
from svv.core.geometry.cameras import Camera, sphere_cameras
from svv.core.images.blank import blank, draw_into
from svv.core.sharing import ALONE
from svv.core.volumes.classified import ClassifiedVolume
from svv.dvr.draw.casters import CpuMapper, GpuMapper, Pixels, choose_mapper
from svv.dvr.draw.classify import classified
from svv.dvr.draw.fitting import fitted_to
from svv.dvr.draw.frame import Stage, set_stage
from svv.dvr.draw.given import GivenFunction, GivenVolume, given_function, given_volume
from svv.dvr.draw.large import BrickMapper, LargeVolume
from svv.dvr.draw.plotted import shows_voxels
from svv.dvr.draw.record import describe_deviations, grid_of
from svv.dvr.draw.rig import FOV, FRAMING, rig_of
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.grids import Triple, array_in, assumed_of
from svv.dvr.read.meshes import is_mesh
from svv.errors import BadInput, Progress, part, silent
from svv.io.files.memory import memory_there
from svv.io.views.drawn_views import DrawnViews
from svv.io.views.empty_views import empty_views
from svv.io.views.view_meta import ViewMeta, VolumeGrid
from svv.io.views.viewset import ViewSet
from svv.options.making import MapperName, ViewOptions

Caster = CpuMapper | GpuMapper | BrickMapper

Making = Callable[[Stage, Shading, float], Caster]
"""What makes a ray caster for a stage, with a sample distance in stage units."""

STEP = {"cpu": 0.5, "bricks": 0.5, "gpu": 0.25}
"""Finest default sample distance in voxels (VTK's own is half a voxel). It is finer on the GPU, where that costs
nothing and the ray caster, which does not interpolate shading between voxels, is grainier."""

COARSER = {"cpu": (1.0, 0.75, 0.625), "bricks": (1.0, 0.75, 0.625), "gpu": ()}
"""Sample distances in voxels that are tried first; the first that is good enough is used (see ``default_step``)."""

GOOD_ENOUGH = 50.0
"""PSNR in dB that a sample distance must reach against an eighth of a voxel: an error of 0.8 of 255 levels."""

FINER, THIN = (1.0, 0.5, 0.25), 35.0
"""Parts of the finest default sample distance, of which the first is used that reaches this PSNR in dB where the views
show something: rays would miss what is thinner, such as single bright voxels, or meet it by chance."""

MAX_SAMPLES = 3000
"""Maximum number of samples along a ray; it limits the effect of a tiny spacing along one axis."""

ORBIT = 181
"""Number of views on the test path, see ``orbit_cameras``."""


def render_views(
    image: GivenVolume,
    tf: TransferFunction,
    cameras: Sequence[Camera],
    mapper: str = "auto",
    shading: Shading | None = None,
    step: float | None = None,
    progress: Progress = silent,
    nearest: bool = False,
) -> NDArray[np.uint8]:
    """Render a volume, as for :func:`make_views`, from cameras of the same image size. (n, height, width, 4)

    The levels are uint8 with straight alpha. ``mapper`` is ``auto``, ``gpu``, ``cpu`` or ``bricks`` (always for a large
    volume), ``shading`` by default the function's or a headlight with ParaView's coefficients, and ``step`` the sample
    distance in voxels (``Stage.voxel``), by default :func:`default_step`. With ``nearest``, voxels are not
    interpolated.

    Raises BadInput if the volume is rejected, the function shows nothing or only a box, cameras differ in size, the
    mapper is unknown, or OpenGL is not available for ``gpu``.
    """
    volume = given_volume(image, nearest, ViewOptions(mapper=cast("MapperName", mapper)))
    fit = fitted_to(volume, tf, mapper, rescale=False)
    stage = set_stage(fit.opened.image, fit.tf)
    caster, _ = open_caster(stage, fit.mapper, shading or tf.shading or Shading(), step, fit.opened.caster(fit.tf))
    return drawn(caster, cameras, progress)


def make_views(  # noqa: PLR0913 - what a volume is shown with, and how views are drawn
    volume: GivenVolume,
    tf: GivenFunction | None = None,
    options: ViewOptions = ViewOptions(test=0),
    *,
    spacing: Triple | None = None,
    origin: Triple | None = None,
    shading: Shading | None = None,
    rescale: bool | None = None,
    nearest: bool = False,
    name: str | None = None,
    kept: DrawnViews | None = None,
    progress: Progress = silent,
    **changes: Any,
) -> tuple[ViewSet, ViewSet | None]:
    """Render the views of a volume that a scene is trained on and those that it is tested on.

    Args:
        volume: A file (see ``open_volume``); an array of numbers indexed [z, y, x], as in .npy files; a large volume;
            an image or grid of VTK or PyVista, or blocks of these, which are resampled unless they are one image; or
            what shows one: a ``pyvista.Plotter``, or the actor that its ``add_volume`` returned.
        tf: A transfer function, or its file (see ``TransferFunction.read``); a ``vtkVolumeProperty``, an actor or a
            plotter, for its function, opacity unit distance, interpolation and shading; by default those of the actor
            that shows the volume, otherwise two ranges of the histogram.
        options: Number, size and rendering of the views. Training views lie on a sphere around the volume (see
            ``geodesic_directions``), test views on the path of 181 (see ``orbit_cameras``), first and last included.
        spacing: Distances between the voxels of an array (x, y, z), world units, > 0; 1 by default.
        origin: Position of an array's first voxel (x, y, z), world units; 0 by default.
        shading: Shading of the volume; by default the function's, or a headlight with ParaView's coefficients.
        rescale: Whether to stretch the function over the data's range (see ``TransferFunction.fitted``).
        nearest: Whether to show each voxel's own value, without interpolation, as labels need; otherwise as the image
            says (:mod:`svv.dvr.read.appearance`), and interpolated by default.
        name: Name of the volume, for the record; by default its file name.
        kept: Where views are kept while they are drawn, and taken from if they are there. If several processes draw,
            only the first one returns all views; the others' lack those that they did not draw.
        progress: Called often; the work stops when it raises.
        changes: Fields of the options by name, such as ``size=400``.

    Returns:
        The training views and the test views (None if ``test`` is 0). ``meta`` records how they were made, and
        ``meta.assumed`` what may look otherwise than expected; the training views also contain the classified volume.

    Raises:
        BadInput: An option is out of range, or ``read_volume``, ``TransferFunction`` or ``render_views`` rejects an
            argument.

    >>> import pyvista
    >>> train, test = svv.make_views(pyvista.Wavelet(), n=12, test=3, size=64)
    >>> train.images.shape, test.images.shape
    ((12, 64, 64, 4), (3, 64, 64, 4))
    """
    asked = replace(options, **changes)
    _check_options(asked)
    began = time.monotonic()
    progress(0.0, "Reading the volume")
    named = Path(volume).name if isinstance(volume, (str, Path)) else "volume"
    function, of_vtk = given_function(tf, volume)
    nearest = nearest or (tf is not None and shows_voxels(tf) and not is_mesh(volume))
    ready = given_volume(volume, nearest, asked, part(progress, 0.0, 0.3), spacing, origin)
    rescale = False if of_vtk and rescale is None else rescale  # whose points lie at values, whatever they are
    said = ready.source.assumed if isinstance(ready, LargeVolume) else assumed_of(ready)
    fit = fitted_to(ready, function, asked.mapper, asked.memory, rescale)
    opened, fitted = fit.opened, fit.tf
    grid = grid_of(opened.whole, opened.type, opened.range)
    stage, title = set_stage(opened.image, fitted), name or named
    notes = (*filter(None, [said]), *fit.notes, *describe_deviations(opened.image, fitted))
    subject = Subject(
        stage, grid, opened.whole, title, fitted, fit.rescaled, notes, caster=opened.caster(fitted), kept=kept,
        array=None if isinstance(ready, LargeVolume) else array_in(ready),
    )  # fmt: skip
    return views_of(
        subject, asked, shading or fitted.shading or Shading(), began, part(progress, 0.3 if opened.large else 0.0, 1.0)
    )


@dataclass(frozen=True)
class Subject:
    """A volume on its stage, and what the record of its views says about it."""

    stage: Stage
    grid: VolumeGrid
    whole: Level
    name: str
    tf: TransferFunction
    """Transfer function for the volume's own values."""
    tf_rescaled: bool = False
    notes: tuple[str, ...] = ()
    """Sentences on what may look otherwise than expected."""
    classify: Callable[[Stage], ClassifiedVolume] = classified
    caster: Making | None = None
    """Ray caster that must draw this volume; None for the one that the options name."""
    kept: DrawnViews | None = None
    """Where views are kept while they are drawn."""
    array: str | None = None
    """Name of the array, if it has one."""


def views_of(
    subject: Subject, asked: ViewOptions, shading: Shading, began: float, progress: Progress
) -> tuple[ViewSet, ViewSet | None]:
    """Render the views of a volume that is on its stage, see :func:`make_views`; ``began`` is a monotonic time."""
    _check_options(asked)
    n, size, stage = asked.n, asked.size, subject.stage
    rig, numbers = rig_of(asked, stage, subject.whole), unseen_numbers(asked.test)
    cameras = rig.sphere(n, size) + rig.orbit(ORBIT, size, numbers)
    volume_classified = subject.classify(stage)
    caster, distance = open_caster(stage, asked.mapper, shading, asked.step, subject.caster, subject.kept)
    images = drawn(caster, cameras, part(progress, 0.02, 1.0), subject.kept)
    low, high = stage.bounds.tolist()
    meta = ViewMeta(
        volume=subject.name,
        grid=subject.grid,
        bounds=(tuple(low), tuple(high)),
        rig=rig,
        tf=subject.tf.to_dict(),
        tf_rescaled=subject.tf_rescaled,
        shading=shading,
        sample_distance=float(distance / stage.scale),
        mapper=caster.name,
        vtk=vtkVersion.GetVTKVersion(),
        seconds=round(time.monotonic() - began, 3),
        nearest=stage.appearance.nearest or None,
        array=subject.array,
    )
    names = tuple(f"r_{i:04d}" for i in range(n))
    train = ViewSet(tuple(cameras[:n]), images[:n], names, meta, volume_classified)
    meta = replace(meta, assumed=" ".join(filter(None, (*subject.notes, empty_views(train)))) or None)
    train = replace(train, meta=meta)
    if not asked.test:
        return train, None
    return train, ViewSet(tuple(cameras[n:]), images[n:], tuple(f"r_{i:04d}" for i in numbers), meta)


def unseen_numbers(test: int) -> list[int]:
    """Return the numbers of the test views on the path of 181: spread over it, first and last included."""
    return [int(i) for i in np.rint(np.linspace(0, ORBIT - 1, test))] if test > 1 else [ORBIT // 2] * test


def open_caster(
    stage: Stage,
    mapper: str,
    shading: Shading,
    step: float | None = None,
    only: Making | None = None,
    kept: DrawnViews | None = None,
) -> tuple[Caster, float]:
    """Open a ray caster that renders one view after another (close it at the end); return its sample distance, too.

    The stage may be that of an overview. ``step`` is the distance in voxels, by default :func:`default_step` or what
    views that have been drawn had; the one returned is in stage units. ``only`` makes the caster if only one is
    suitable, and ``mapper`` is then not used. Raises BadInput if the mapper is unknown or lacks OpenGL, or the step is
    not positive.
    """
    make_caster = only or choose_mapper(mapper)
    if not (step is None or (np.isfinite(step) and step > 0)):
        raise BadInput(f"The sample distance must be a positive number of voxels, not {step}.")
    caster = make_caster(stage, shading, stage.voxel)  # its own sample distance follows
    least = float(np.linalg.norm(stage.scale * stage.visible_size)) / MAX_SAMPLES
    shown = stage.appearance
    jumps = shown.nearest or shown.blank is not None
    finest = STEP[caster.name] * (0.5 if jumps else 1.0)
    if shown.crop is not None:  # rays must not miss a thin slice
        sides = np.diff(shown.crop, axis=0) * stage.image.GetSpacing() / shown.stretch
        finest = min(finest, 0.5 * float(sides.min()) / stage.voxel)

    def measure() -> float:
        return default_step(caster, stage, finest) if step is None else step

    distance = max((measure() if kept is None else kept.step(measure)) * stage.voxel, least)
    caster.set_step(distance)
    return caster, distance


def default_step(caster: Caster, stage: Stage, finest: float) -> float:
    """Return the sample distance in voxels that a volume needs with its transfer function; change that of the caster.

    It is the longest of ``COARSER`` whose three small test pictures reach ``GOOD_ENOUGH`` against those with an eighth
    of a voxel, on black as well as on white. If none does, it is ``finest``, or a part of that if what is seen is thin
    (``FINER``).
    """
    radius = FRAMING * 0.5 * float(np.linalg.norm(stage.visible_size))
    cameras = sphere_cameras(3, stage.centre, radius, FOV, 128)

    def draw(step: float) -> NDArray[np.float64]:
        caster.set_step(step * stage.voxel)
        pixels = np.stack([caster.render(camera) for camera in cameras]) / 255.0
        colours, opacities = pixels[..., :3], pixels[..., 3:]
        return np.stack([colours * opacities, (colours - 1.0) * opacities])  # on black, and on white, which is 0

    if not COARSER[caster.name]:
        return finest
    fine = draw(0.125)
    error = 10.0 ** (-0.1 * GOOD_ENOUGH)
    for step in COARSER[caster.name]:
        if np.square(draw(step) - fine).mean(axis=(1, 2, 3, 4)).max() <= error:
            return step
    seen = fine[0, ..., 0] > fine[1, ..., 0]  # their difference is the opacity
    steps = [max(part * finest, min(finest, 0.125)) for part in FINER]
    thin = 10.0 ** (-0.1 * THIN)
    if not seen.any():  # only coarser steps met it, by chance
        return steps[-1]
    return next((step for step in steps if np.square(draw(step) - fine)[:, seen].mean() <= thin), steps[-1])


def _check_options(asked: ViewOptions) -> None:
    if asked.n < 3:
        raise BadInput(f"At least 3 views are needed, not {asked.n}.")
    if asked.size < 1:
        raise BadInput(f"The views' size must be at least one pixel, not {asked.size}.")
    taken, there = 4 * asked.n * asked.size**2, memory_there()
    if taken > there:
        raise BadInput(
            f"{asked.n} views of {asked.size} x {asked.size} pixels take {taken / 1e9:.3g} GB, and the memory is "
            f"{there / 1e9:.3g} GB: choose fewer or smaller ones."
        )
    if not 0 <= asked.test <= ORBIT:
        raise BadInput(f"Give 0 to {ORBIT} test views, not {asked.test}.")
    if not 0 < asked.fov < 180:
        raise BadInput(f"The angle of view must lie between 0 and 180 degrees, not {asked.fov}.")
    if asked.projection not in ("perspective", "orthographic"):
        raise BadInput(
            f"The projection of the views must be 'perspective' or 'orthographic', not '{asked.projection}'."
        )
    if asked.frame not in ("visible", "whole"):
        raise BadInput(f"The frame of the views must be 'visible' or 'whole', not '{asked.frame}'.")


def drawn(
    caster: Caster, cameras: Sequence[Camera], progress: Progress, kept: DrawnViews | None = None
) -> NDArray[np.uint8]:
    """Return the images from the cameras, those that are kept without drawing them, and close the caster."""
    try:
        if not cameras or len({(camera.width, camera.height) for camera in cameras}) != 1:
            raise BadInput("Rendering needs at least one camera, and one image size for all cameras.")
        first = cameras[0]
        images = blank((len(cameras), first.height, first.width, 4))
        sharing = ALONE if kept is None else kept.sharing
        mine = sharing.mine(len(cameras))
        for done, i in enumerate(mine):
            draw_into(images[i], _image(caster, cameras[i], i, kept))
            progress((done + 1) / len(mine), "Rendering views")
        sharing.wait()
        if sharing.is_first:
            for i in sorted({*range(len(cameras))} - {*mine}):
                draw_into(images[i], _image(caster, cameras[i], i, kept))
    finally:
        caster.close()
    return images


def _image(caster: Caster, camera: Camera, number: int, kept: DrawnViews | None) -> Pixels:
    """Return a view that has been drawn, or draw it and keep it."""
    if kept is None:
        return caster.render(camera)
    image = kept.get(number, (camera.height, camera.width, 4))
    if image is None:
        image = caster.render(camera)
        kept.put(number, image)
    return image
