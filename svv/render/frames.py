"""Views of a scene as files: single pictures, folders of frames, movies."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from svv.core.colour.colour import WHITE, over
from svv.core.colour.light import direction_of
from svv.core.geometry.cameras import Camera, look_at
from svv.errors import BadInput, Progress, part, silent
from svv.io.files.atomic import check_writable, make_folder
from svv.io.files.keyed_results import digest, key_of
from svv.io.pictures.output import (
    depth_picture,
    doubt_picture,
    made_of,
    region_picture,
    remove_other_frames,
    to_bytes,
    write_depth_png,
    write_doubt_png,
    write_mp4,
    write_png,
    write_region_png,
    write_vti,
)
from svv.render.emptiness import why_empty
from svv.render.supersampled import supersampled

if TYPE_CHECKING:
    from torch import nn

    from svv.fields.scene.scene import Rendering, Scene

T = TypeVar("T")

SHOWN_SIZE = 320
"""Side in pixels of the pictures that show a painting in progress."""
PREVIEW_SIZE = 96
"""Side in pixels of the few views from which the range of depths is measured before a movie of depths begins."""


@dataclass(frozen=True)
class RenderSettings:
    """What pictures of a scene show."""

    network: str | None = None
    """``base``, ``pcn`` or ``styled``; by default the last one that the scene has."""
    background: Sequence[float] | None = None
    """RGB in [0, 1] behind colours; by default a PNG is transparent and a movie is over white."""
    what: str = "rgba"
    """Content: ``rgba``, ``depth`` (16 bits in a PNG), ``region`` (indexed colours) or ``doubt`` (16 bits)."""
    samples: int | None = None
    """Rays along a pixel's side; by default one in movies and folders of frames, and in one view as many as
    :func:`svv.render.supersampled.samples_for` says."""
    temporary: bool = False
    """Whether files of colours are removed soon: they are larger, and written in less time."""


Writes = Callable[[], "NDArray[np.uint8] | None"]
"""Writes a view into a file, and returns what :func:`_write` does."""

COLOURS = RenderSettings()
"""The colours of the last network."""


class Played:
    """A scene with time steps of which each view shows one."""

    def __init__(self, scene: Scene, steps: Sequence[int]) -> None:
        """Show the scene at the time step ``steps[k]`` in view ``k``."""
        self.scene, self.steps = scene, steps
        self._last: dict[int, Scene] = {}

    def at(self, number: int) -> Scene:
        """Return the scene of a view; neighbours of the same time step share it."""
        return self.at_step(self.steps[number])

    def told(self, number: int) -> dict[str, object]:
        """Return what a view depends on besides its camera and the scene, as plain values."""
        return {"step": self.steps[number]}

    def at_step(self, step: int) -> Scene:
        """Return the scene at a time step; the last one is remembered."""
        from svv.fields.following.followed_scene import at_step

        if step not in self._last:
            self._last = {step: at_step(self.scene, step)}
        return self._last[step]


def orbit(scene: Scene, n: int, width: int, height: int) -> list[Camera]:
    """Return ``n`` cameras of the 181-view path around a scene, at the distance of its training views.

    >>> cameras = svv.orbit(scene, 8, 64, 48)
    >>> len(cameras), cameras[0].width, cameras[0].height
    (8, 64, 48)
    """
    return [camera.resized(width, height) for camera in scene.rig.orbit(n, width)]


def seen_from(scene: Scene, azimuth: float, elevation: float, width: int, height: int) -> Camera:
    """Return a camera beside the front of a scene, at the distance of its training views.

    ``azimuth`` is in degrees to the right of the front, ``elevation`` in degrees above it, in [-90, 90].
    """
    (front,) = scene.rig.orbit(181, width, frames=[90])
    centre, axes = np.asarray(scene.rig.centre), front.camera_to_world[:3, :3]
    away = axes @ direction_of(azimuth, elevation)
    up = axes[:, 1] if abs(elevation) < 89.9 else -np.sign(elevation) * (axes @ direction_of(azimuth, 0.0))
    pose = look_at(away, np.zeros(3), up)
    pose[:3, 3] = centre + np.linalg.norm(front.position - centre) * away
    return replace(front, camera_to_world=pose).resized(width, height)


def write_view(
    path: Path,
    scene: Scene,
    camera: Camera,
    shown: RenderSettings = COLOURS,
    progress: Progress = silent,
) -> str:
    """Render one view into a file; return why it shows nothing (:func:`why_empty`), '' if it shows something.

    A .vti always contains colour, depth and regions, the volume's values if the scene keeps them, and doubt if
    ``shown`` says so; of a PNG, that says what it shows. Raises BadInput if the scene does not have that network or
    does not know its errors, or the file cannot be written.
    """
    view, write = _rendered(path, scene, camera, shown, progress, "")
    write()
    return why_empty(scene, view.depth)


def _rendered(
    path: Path, scene: Scene, camera: Camera, shown: RenderSettings, progress: Progress, made: str
) -> tuple[Rendering, Writes]:
    """Render one view, and return it with what writes it into a file; see :func:`write_view`."""
    check_writable(path)
    samples = shown.samples
    if samples is None and path.suffix.lower() != ".vti" and shown.what != "rgba":
        samples = 1  # edges of regions and depths have nothing to smooth
    doubt = scene.doubt(camera, progress) if shown.what == "doubt" else None
    view = supersampled(scene, camera, shown.network, None, progress, samples)
    value = scene.value_image(camera, shown.network) if path.suffix.lower() == ".vti" else None
    return view, partial(_write, path, view, scene, shown, made, value, doubt)


def _write(
    path: Path, view: Rendering, scene: Scene, shown: RenderSettings, made: str, value: NDArray[np.float32] | None,
    doubt: NDArray[np.float32] | None,
) -> NDArray[np.uint8] | None:  # fmt: skip
    """Write a view; returns its levels (h, w, 3) if it is one of colours without transparency."""
    if path.suffix.lower() == ".vti":
        write_vti(path, view.rgba, view.depth, view.region, value, doubt)
    elif doubt is not None:
        write_doubt_png(path, doubt, made)
    elif shown.what == "depth":
        write_depth_png(path, view.depth, made)
    elif shown.what == "region":
        write_region_png(path, view.region, region_colours(scene), made)
    elif shown.background is None:
        write_png(path, view.rgba, made)
    else:
        levels = to_bytes(over(view.rgba, shown.background))
        write_png(path, levels, made, 1 if shown.temporary else 4)
        return levels
    return None


def previews_in(path: Path) -> Callable[[Scene], None]:
    """Return a ``preview`` for :func:`svv.train.pipeline.stylize_scene` that overwrites a PNG, over white.

    The file is complete at any time, so a viewer that reloads it shows the painting in progress. Raises BadInput if it
    is not a .png, or cannot be written.
    """
    if path.suffix.lower() != ".png":
        raise BadInput(f"The preview {path} is not a PNG: name it .png.")
    check_writable(path)

    def show(scene: Scene) -> None:
        write_view(path, scene, orbit(scene, 181, SHOWN_SIZE, SHOWN_SIZE)[90], RenderSettings(background=WHITE))

    return show


def write_frames(
    folder: Path,
    scene: Scene | Played,
    cameras: Sequence[Camera],
    shown: RenderSettings = COLOURS,
    progress: Progress = silent,
    those: slice = slice(None),
) -> list[Path]:
    """Render views into ``folder/0000.png`` and so on (:func:`write_view`); return the files in the cameras' order.

    Files that are there already and were made from the same scene, camera and settings are left as they are, so an
    interrupted call can be repeated. Other frames that this function wrote are removed first, so a folder never holds
    the frames of two runs. With ``those``, only these of the views are rendered, and others may render the rest. Raises
    BadInput if the folder has numbered pictures that this function did not write, or cannot be written.
    """
    for _ in draw_frames(folder, scene, cameras, shown, progress, those):
        pass
    return [_frame_in(folder, number) for number in range(len(cameras))]


def draw_frames(
    folder: Path,
    scene: Scene | Played,
    cameras: Sequence[Camera],
    shown: RenderSettings = COLOURS,
    progress: Progress = silent,
    those: slice = slice(None),
) -> Iterator[tuple[Path, NDArray[np.uint8] | None]]:
    """Do what :func:`write_frames` does, and yield each file, when it is complete, and its levels (h, w, 3).

    These are None if the file was there, or has no colours without transparency.
    """
    frames = _Frames(folder, scene, shown)
    chosen = range(len(cameras))[those]
    frames.make_room(chosen, cameras)

    def drawn() -> Iterator[Writes]:
        for index, number in enumerate(chosen):
            each = part(progress, index / len(chosen), (index + 1) / len(chosen))
            yield frames.drawn(number, cameras[number], each)
            progress((index + 1) / len(chosen), f"view {index + 1} of {len(chosen)}")

    for number, levels in zip(chosen, _do_beside(drawn()), strict=True):
        yield frames.path(number), levels


def write_frames_of(scenes: Mapping[Path, Scene], cameras: Sequence[Camera], progress: Progress = silent) -> None:
    """Render the same views of several scenes, each into its folder; see :func:`write_frames`.

    Scenes with the same networks, such as edits and a painting of one scene, share what these say of a view: it is
    found once for all of them. The files are the same as from one call for each.
    """
    from svv.fields.scene.view_cache import cache_every_view

    frames = [_Frames(folder, scene, COLOURS) for folder, scene in zip(scenes, _sharing(list(scenes.values())))]
    count = len(cameras) * len(frames)
    for each in frames:
        each.make_room(range(len(cameras)), cameras)

    def drawn() -> Iterator[Writes]:
        for number, camera in enumerate(cameras):
            with cache_every_view():
                for k, each in enumerate(frames):
                    done = number * len(frames) + k
                    yield each.drawn(number, camera, part(progress, done / count, (done + 1) / count))
            progress((number + 1) / len(cameras), f"view {number + 1} of {len(cameras)}")

    for _ in _do_beside(drawn()):
        pass


def _do_beside(work: Iterable[Callable[[], T]]) -> Iterator[T]:
    """Do each piece of work in a thread while the next one is prepared: files are compressed beside the next image.

    Yields the results, each when the next piece has been prepared.
    """
    with ThreadPoolExecutor(1) as pool:
        last: Future[T] | None = None
        for each in work:
            done, last = last, pool.submit(each)
            if done is not None:
                yield done.result()
        if last is not None:
            yield last.result()


def _frame_in(folder: Path, number: int) -> Path:
    """Return the file of a frame in a folder."""
    return folder / f"{number:04d}.png"


class _Frames:
    """Frames of a scene in a folder; one that was made from the same scene, camera and settings is left as it is."""

    def __init__(self, folder: Path, scene: Scene | Played, shown: RenderSettings) -> None:
        self._folder, self._shown = make_folder(folder), replace(shown, samples=shown.samples or 1)
        whole, self._at, self._told = _at_each(scene)
        self._look = digest(whole.to_bytes(whole=False), *vars(self._shown).values())

    def path(self, number: int) -> Path:
        """Return the file of a frame."""
        return _frame_in(self._folder, number)

    def make_room(self, views: Sequence[int], cameras: Sequence[Camera]) -> None:
        """Remove the frames of other runs: those of these views, and those beyond the number of all views."""
        made = {number: self._made(number, cameras[number]) for number in views if self.path(number).exists()}
        remove_other_frames(self._folder, len(cameras), made)

    def drawn(self, number: int, camera: Camera, progress: Progress) -> Writes:
        """Render a frame and return what writes it, or nothing if it is there."""
        made = self._made(number, camera)
        if made_of(self.path(number)) == made:
            return lambda: None
        return _rendered(self.path(number), self._at(number), camera, self._shown, progress, made)[1]

    def _made(self, number: int, camera: Camera) -> str:
        """Return what a frame says that it was made from."""
        told = {field.name: getattr(camera, field.name) for field in fields(camera)}
        return key_of(self._look, {**told, **self._told(number)})


def _sharing(scenes: Sequence[Scene]) -> list[Scene]:
    """Return the scenes with those networks of the first one that are equal to their own, number by number."""
    first, out = scenes[0], list(scenes[:1])
    for scene in scenes[1:]:
        parts = {name: getattr(first, name) for name in ("base", "palette_network")}
        same = scene.settings == first.settings and np.array_equal(first.occupancy.occupied, scene.occupancy.occupied)
        same = same and all(_equal(network, getattr(scene, name)) for name, network in parts.items())
        out.append(replace(scene, **parts, occupancy=first.occupancy) if same else scene)
    return out


def _equal(network: nn.Module | None, other: nn.Module | None) -> bool:
    """Return whether two networks have the same parameters."""
    if network is None or other is None:
        return network is other
    one, two = network.state_dict(), other.state_dict()
    return one.keys() == two.keys() and all(
        one[k].shape == two[k].shape and bool((one[k] == two[k]).all()) for k in one
    )


def write_movie(
    path: Path,
    scene: Scene | Played,
    cameras: Sequence[Camera],
    shown: RenderSettings = COLOURS,
    fps: float = 30.0,
    progress: Progress = silent,
) -> None:
    """Render views into a movie, over white unless a background is given; see :func:`write_view`.

    Args:
        path: The .mp4 to write.
        scene: The scene.
        cameras: The cameras of the frames, in world units, all of one size.
        shown: What the frames show.
        fps: Frames per second.
        progress: Called often.

    Raises:
        BadInput: The scene does not have that network, or the file cannot be written.

    >>> keys = svv.orbit(scene, 5, 32, 32)[1:4]
    >>> svv.write_movie("path.mp4", scene, svv.camera_path(keys, 5))
    """
    whole, at, _ = _at_each(scene)
    near_far = _range_of(whole, cameras, shown) if shown.what in ("depth", "doubt") else (0.0, 1.0)

    def frames() -> Iterator[NDArray[np.uint8]]:
        for index, camera in enumerate(cameras):
            each = part(progress, index / len(cameras), (index + 1) / len(cameras))
            if shown.what == "doubt":
                picture = doubt_picture(at(index).doubt(camera, each), near_far[1])
            else:
                view = supersampled(at(index), camera, shown.network, None, each, shown.samples or 1)
                picture = _shown(view, whole, shown.what, near_far)
            yield to_bytes(over(picture, shown.background or WHITE))
            progress((index + 1) / len(cameras), f"view {index + 1} of {len(cameras)}")

    write_mp4(path, frames(), fps)


def _at_each(
    scene: Scene | Played,
) -> tuple[Scene, Callable[[int], Scene], Callable[[int], Mapping[str, object]]]:
    """Return a scene, and what gives the scene of each view by its number, and what that depends on."""
    if isinstance(scene, Played):
        return scene.scene, scene.at, scene.told
    return scene, lambda number: scene, lambda number: {}


def region_colours(scene: Scene) -> NDArray[np.float32]:
    """Return the colour in which each region is shown, the edited one if it has one. (regions, 3)"""
    colours = [r.colour if r.edited_colour is None else r.edited_colour for r in scene.regions]
    return np.asarray(colours, dtype=np.float32).reshape(-1, 3)


def _shown(view: Rendering, scene: Scene, what: str, near_far: tuple[float, float]) -> NDArray[np.float32]:
    if what == "depth":
        return depth_picture(view.depth, *near_far)
    if what == "region":
        return region_picture(view.region, region_colours(scene))
    return np.asarray(view.rgba, dtype=np.float32)


def _range_of(scene: Scene, cameras: Sequence[Camera], shown: RenderSettings) -> tuple[float, float]:
    """Measure the range of depths or doubts in a few small views: a colour then means the same in all of a movie."""
    from svv.fields.scene.doubt import darkest_error

    some = [camera.resized(PREVIEW_SIZE, PREVIEW_SIZE) for camera in cameras[:: max(1, len(cameras) // 5)]]
    if shown.what == "doubt":
        return 0.0, darkest_error(scene, some)
    depths = [scene.render(camera, shown.network).depth for camera in some]
    seen = np.concatenate([depth[np.isfinite(depth)] for depth in depths])
    return (float(seen.min()), float(seen.max())) if seen.size else (0.0, 1.0)
