"""Views of a scene as files: single pictures, folders of frames, movies."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from svv.core.cameras import Camera
from svv.errors import BadInput, Progress, part, silent
from svv.io.atomic import check_writable, make_folder
from svv.io.output import (
    depth_picture,
    on_background,
    region_picture,
    to_bytes,
    write_depth_png,
    write_mp4,
    write_png,
    write_region_png,
    write_vti,
)

if TYPE_CHECKING:
    from svv.fields.scene import Rendering, Scene

WHITE = (1.0, 1.0, 1.0)
SHOWN_SIZE = 320
"""Pixels of the pictures that show a painting while it is made."""
PREVIEW_SIZE = 96
"""Pixels of the few small views that tell the range of depths before a movie of depths begins."""


def orbit(scene: Scene, n: int, width: int, height: int) -> list[Camera]:
    """The cameras of the 181-view path (or ``n`` views of it) around a scene, at the distance of its training views."""
    return [camera.resized(width, height) for camera in scene.rig.orbit(n, width)]


def write_view(
    path: Path,
    scene: Scene,
    camera: Camera,
    network: str | None = None,
    background: Sequence[float] | None = None,
    what: str = "rgba",
    progress: Progress = silent,
) -> None:
    """Render one view into a file.

    Args:
        path: A .vti, which holds colour, depth and regions always, or else a PNG.
        scene: What to render.
        camera: From where.
        network: ``base``, ``pcn`` or ``styled``; without it the best that the scene has.
        background: Colour in [0, 1] behind a PNG of colours; without it the PNG is transparent.
        what: ``rgba``, ``depth`` (16 bits) or ``region`` (indexed), for PNG.
        progress: Told while rendering.

    Raises:
        BadInput: a network that the scene does not have, or a file that cannot be written.
    """
    check_writable(path)
    view = scene.render(camera, network, None, progress)
    if path.suffix.lower() == ".vti":
        write_vti(path, view.rgba, view.depth, view.region)
    elif what == "depth":
        write_depth_png(path, view.depth)
    elif what == "region":
        write_region_png(path, view.region, region_colours(scene))
    else:
        write_png(path, view.rgba if background is None else on_background(view.rgba, background))


def previews_in(path: Path) -> Callable[[Scene], None]:
    """What to give :func:`svv.train.pipeline.stylize_scene` as ``preview``: each overwrites a PNG, over white.

    Args:
        path: The file, which is whole at any moment: a viewer that reloads it shows the painting come.

    Raises:
        BadInput: it is no .png, or cannot be written.
    """
    if path.suffix.lower() != ".png":
        raise BadInput(f"The preview {path} is a picture: name it .png.")
    check_writable(path)

    def show(scene: Scene) -> None:
        write_view(path, scene, orbit(scene, 181, SHOWN_SIZE, SHOWN_SIZE)[90], background=WHITE)

    return show


def write_frames(
    folder: Path,
    scene: Scene,
    cameras: Sequence[Camera],
    network: str | None = None,
    background: Sequence[float] | None = None,
    what: str = "rgba",
    progress: Progress = silent,
) -> list[Path]:
    """Render views into ``folder/0000.png`` and so on; see :func:`write_view`.

    Returns:
        The files.
    """
    make_folder(folder)
    paths = [folder / f"{index:04d}.png" for index in range(len(cameras))]
    for index, (path, camera) in enumerate(zip(paths, cameras, strict=True)):
        each = part(progress, index / len(cameras), (index + 1) / len(cameras))
        write_view(path, scene, camera, network, background, what, each)
        progress((index + 1) / len(cameras), f"view {index + 1} of {len(cameras)}")
    return paths


def write_movie(
    path: Path,
    scene: Scene,
    cameras: Sequence[Camera],
    network: str | None = None,
    background: Sequence[float] | None = None,
    what: str = "rgba",
    fps: float = 30.0,
    progress: Progress = silent,
) -> None:
    """Render views into a movie, over white where no background is given; see :func:`write_view`."""
    near_far = _depth_range(scene, cameras, network) if what == "depth" else (0.0, 1.0)

    def frames() -> Iterator[NDArray[np.uint8]]:
        for index, camera in enumerate(cameras):
            each = part(progress, index / len(cameras), (index + 1) / len(cameras))
            view = scene.render(camera, network, None, each)
            picture = _shown(view, scene, what, near_far)
            yield to_bytes(on_background(picture, background or WHITE))
            progress((index + 1) / len(cameras), f"view {index + 1} of {len(cameras)}")

    write_mp4(path, frames(), fps)


def region_colours(scene: Scene) -> NDArray[np.float32]:
    """The colour in which each region is shown, its edited one where it has one, (regions, 3)."""
    colours = [r.colour if r.edited_colour is None else r.edited_colour for r in scene.regions]
    return np.asarray(colours, dtype=np.float32).reshape(-1, 3)


def _shown(view: Rendering, scene: Scene, what: str, near_far: tuple[float, float]) -> NDArray[np.float32]:
    if what == "depth":
        return depth_picture(view.depth, *near_far)
    if what == "region":
        return region_picture(view.region, region_colours(scene))
    return np.asarray(view.rgba, dtype=np.float32)


def _depth_range(scene: Scene, cameras: Sequence[Camera], network: str | None) -> tuple[float, float]:
    """Nearest and farthest depth over a few small views, so that a movie's greys mean the same in all frames."""
    some = cameras[:: max(1, len(cameras) // 5)]
    depths = [scene.render(camera.resized(PREVIEW_SIZE, PREVIEW_SIZE), network).depth for camera in some]
    seen = np.concatenate([depth[np.isfinite(depth)] for depth in depths])
    return (float(seen.min()), float(seen.max())) if seen.size else (0.0, 1.0)
