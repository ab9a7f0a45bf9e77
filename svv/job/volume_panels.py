"""The volume rendering as a panel of a figure, beside the paintings of the scene that was trained on it.

A scene says what its volume's file is called and holds, not where it is: it is looked for where the scene is and where
the command runs. If it is not there, the panel shows the scene's palette network and says so.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from svv.core.colour.light import Lamp
from svv.core.geometry.cameras import Camera
from svv.core.geometry.given_cameras import GivenCamera
from svv.core.json_values import list_in, text_in, vector_in, whole_in
from svv.errors import BadInput
from svv.fields.following.followed_scene import FOLLOWED
from svv.fields.scene.history import edits_of, named_alone, with_edits
from svv.fields.scene.scene import Scene
from svv.io.views.view_meta import ViewMeta
from svv.job.source import VolumeSource, content_of

if TYPE_CHECKING:
    from svv.dvr.draw.given import GivenVolume
    from svv.dvr.draw.views import Caster
    from svv.job.source import Volume
    from svv.render.figures.figure import Panel

Draw = Callable[[Camera], NDArray[np.float32]]
"""What draws a volume: straight RGBA (h, w, 4) in [0, 1]."""

SHOWS = "volume rendering"
OTHER = "{} is not the volume that the scene was trained on, or has changed"
BY_PICTURE = "known by its grid and how it looks"

LIKENESS_VIEW = 64
"""Side in pixels of the two pictures by which a volume is known that has no hash."""

LEAST_LIKENESS = 20.0
"""PSNR in dB of what the scene learned against each, where either shows something: the scene's own volumes have
28 to 39 dB, others of the same grid and range 12 to 14."""

READ: dict[str, Callable[[Any, str], object]] = {
    "dims": lambda value, name: tuple(whole_in(count, name) for count in list_in(value, 3, name)),
    "dtype": text_in,
    "spacing": vector_in,
    "array": text_in,
    "channel": text_in,
    "time": whole_in,
    "resample_to": whole_in,
}
"""How a volume's file is read (:data:`svv.job.source.READ`) -> what checks it."""


@dataclass(frozen=True)
class Remembered:
    """The volume of a scene."""

    draw: Draw | None
    """What draws it; None if it is not there."""
    said: str
    """The file, or why the volume cannot be drawn, without a full stop."""


def volume_panel(
    scene: Scene, volume: GivenVolume | None = None, camera: GivenCamera | None = None, title: str = ""
) -> Panel:
    """Return a panel with the rendering of a scene's volume, for :func:`svv.figure`.

    It is drawn by VTK as the views of the training were. What edits and paint changed is not in it, hidden regions are.
    Where the volume is not there or has changed, the panel shows the palette network, with the scene's edits; its
    ``shows`` and ``note`` say which of the two it is.

    Args:
        scene: A scene.
        volume: The volume's file, or the array, grid, actor or plotter that :func:`svv.make_views` was given; by
            default a file of its name in the current folder or beside that.
        camera: As for a panel.
        title: As for a panel; by default ``volume rendering``, or ``palette network``.

    >>> panel = svv.volume_panel(scene, title="before")
    >>> panel.shows  # without the volume
    'palette network'
    """
    named = [] if volume is None else [Path(volume) if isinstance(volume, str) else volume]
    return panel_of(scene, remembered(scene, named, [Path()]), camera, title)


def panel_of(scene: Scene, found: Remembered, camera: GivenCamera | None = None, title: str = "") -> Panel:
    """Return a panel of a scene with its volume as it was found; see :func:`volume_panel`."""
    from svv.render.figures.figure import SHOWN, Panel  # matplotlib's, which ParaView's Python may not have

    network = "pcn" if "pcn" in scene.networks else "base"
    if found.draw is None:
        note = f"shows the {SHOWN[network]}, not the volume rendering, because {found.said}."
        return Panel(scene, camera, title, network=network, shows=SHOWN[network], note=note)
    plain = replace(scene, regions=tuple(with_edits(r, named_alone(r)) for r in scene.regions), lamp=Lamp(), cuts=())
    edited = (scene.lamp, scene.cuts) != (plain.lamp, ()) or any(edits_of(r) != named_alone(r) for r in scene.regions)
    note = f"is drawn from {found.said}" + ", without the edits of the scene" * edited + "."
    look = ("volume", id(found.draw))
    return Panel(plain, camera, title, look, network, found.draw, SHOWS, note)


def remembered(
    scene: Scene, named: Sequence[GivenVolume], folders: Iterable[Path], within: Path | None = None
) -> Remembered:
    """Find the volume of a scene.

    ``named`` are files or images that may be it, whatever they are called. A file of its name is looked for in the
    ``folders``, and in those that hold them, but not beyond the folder ``within``. Raises BadInput if a file that was
    named does not exist.
    """
    for path in named:
        if isinstance(path, Path) and not path.exists():
            raise BadInput(f"There is no volume {path}; check the path.")
    if scene.layers:
        return Remembered(None, "the scene is joined from several")
    if scene.made.get(FOLLOWED):
        return Remembered(None, "the scene shows another time step than the one that it was trained on")
    meta = ViewMeta.from_json(scene.made.get("source"), "source")
    if meta.volume is None or meta.grid is None or meta.tf is None or meta.shading is None:
        return Remembered(None, "the scene does not say which volume it was trained on")
    every = [*named, *_beside(meta.volume, folders, within)]
    if not every:
        return Remembered(None, f"the volume {meta.volume} is not beside the scene; name its file with --volume")
    said = ""
    for path in every:
        try:
            return _known_again(scene, meta, path)
        except BadInput as error:
            said = said or str(error).removesuffix(".")
    return Remembered(None, said)


def _beside(name: str, folders: Iterable[Path], within: Path | None) -> list[Path]:
    """Return the files of a name in some folders, and in those that hold them; no scene names one elsewhere."""
    if not name or Path(name).name != name:
        return []
    places = [place for folder in folders for place in (folder.resolve(), folder.resolve().parent)]
    found = [path for path in dict.fromkeys(place / name for place in places) if path.exists()]
    return [path for path in found if within is None or path.resolve().is_relative_to(within)]


def _known_again(scene: Scene, meta: ViewMeta, path: GivenVolume) -> Remembered:
    """Return a file as the volume of a scene; raises BadInput if it is another one, or cannot be read."""
    if not isinstance(path, Path):
        from svv.dvr.draw.given import given_volume

        grid = meta.grid if isinstance(path, np.ndarray) else None
        spacing, origin = (None, None) if grid is None else (grid.spacing, grid.origin)
        given = given_volume(path, bool(meta.nearest), spacing=spacing, origin=origin)
        draw = _drawing(meta, given, "What was given")
        _check_likeness(scene, draw, "What was given")
        return Remembered(draw, f"the volume that was given, {BY_PICTURE}")
    told = dict(meta.file or {})
    known = told.pop("content", None)
    if known is not None and content_of(path) != known:
        raise BadInput(OTHER.format(path.name))
    how: dict[str, Any] = {key: read(told[key], f"source.file.{key}") for key, read in READ.items() if key in told}
    draw = _drawing(meta, _read(meta, path, how), path.name)
    if known is not None:
        return Remembered(draw, path.name)
    _check_likeness(scene, draw, path.name)
    return Remembered(draw, f"{path.name}, {BY_PICTURE}")


def _check_likeness(scene: Scene, draw: Draw, name: str) -> None:
    """Raise BadInput if a volume looks otherwise than what a scene learned, without its edits."""
    for camera in scene.rig.orbit(181, LIKENESS_VIEW, frames=[20, 90]):
        own, other = draw(camera), scene.render(camera, "base").rgba
        seen = (own[..., 3] > 0.0) | (other[..., 3] > 0.0)
        one, two = (np.concatenate([p[..., :3] * p[..., 3:], p[..., 3:]], axis=2)[seen] for p in (own, other))
        if not seen.any() or float(np.square(one - two).mean()) > 10.0 ** (-0.1 * LEAST_LIKENESS):
            raise BadInput(OTHER.format(name))


def _read(meta: ViewMeta, path: Path, how: dict[str, Any]) -> Volume:
    """Read a file as a scene's volume; where views do not say how, their volume may be an array of the file."""
    nearest = bool(meta.nearest)
    if meta.file is None and path.name != meta.volume:
        with suppress(BadInput):
            return VolumeSource(path, array=meta.volume, nearest=nearest).image()
    return VolumeSource(path, nearest=nearest, **how).image()


def _drawing(meta: ViewMeta, volume: Volume, name: str) -> Draw:
    """Return what draws a volume as the views were drawn; raises BadInput if it has another grid than theirs."""
    from svv.dvr.draw.fitting import fitted_to
    from svv.dvr.draw.frame import set_stage
    from svv.dvr.draw.record import grid_of
    from svv.dvr.draw.views import open_caster
    from svv.dvr.functions.transfer_functions import TransferFunction

    assert meta.tf is not None and meta.shading is not None
    shading = meta.shading
    fit = fitted_to(volume, TransferFunction.from_dict(meta.tf), "auto", rescale=False)
    if grid_of(fit.opened.whole, fit.opened.type, fit.opened.range) != meta.grid:
        raise BadInput(OTHER.format(name))

    @cache
    def caster() -> Caster:
        stage = set_stage(fit.opened.image, fit.tf)
        return open_caster(stage, fit.mapper, shading, None, fit.opened.caster(fit.tf))[0]

    return lambda camera: np.asarray(caster().render(camera), np.float32) / np.float32(255.0)
