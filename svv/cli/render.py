"""The command that renders a scene; see :mod:`svv.cli.app`."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from svv.cli.files import load
from svv.cli.option_group import spread
from svv.cli.options import SceneFile, parse_angles
from svv.errors import BadInput
from svv.options.described import Setting
from svv.options.making import RenderOptions
from svv.progress import shown

if TYPE_CHECKING:
    from svv.core.geometry.cameras import Camera
    from svv.fields.scene.scene import Scene
    from svv.options.shots import Shot
    from svv.render.frames import RenderSettings

RENDER = (
    "svv render scene.svv --orbit 181 --out orbit.mp4",
    "svv render scene.svv --orbit 60 --size 400 --background white --out frames",
    "svv render scene.svv --camera camera.json --size 1280x720 --out view.png",
    "svv render scene.svv --camera views/transforms_test.json --frame 3 --out view.vti",
    "svv render scene.svv --view 30,20 --out side.png",
    "svv render scene.svv --what doubt --out doubt.png",
    "svv render scene.svv --view 0,0 --view 90,30 --view 150,0 --path 240 --out path.mp4",
    "svv render scene.svv --camera keys.json --path 240 --out path.mp4",
    "svv render painted.svv --orbit 181 --supersample 2 --out smooth.mp4",
    "svv render scene.svv --shot shot.json --preview --out draft.mp4",
    "svv render scene.svv --shot shot.json --size 1920x1080 --out film.mp4",
    "svv render series.svv --play --out series.mp4",
    "svv render series.svv --play --orbit 240 --out frames",
    "torchrun --nproc-per-node 4 -m svv render scene.svv --orbit 181 --out frames",
)

ONE_VIEW = (".png", ".vti")
"""Extensions of files of one view."""
PREVIEW_FPS = 10.0
"""Most frames per second of the preview of a shot."""
STEP = "leave out --time and --play, and give key frames a step."
"""How a shot plays time steps."""


@dataclass(frozen=True)
class Shown:
    """Which views are rendered: cameras, and times of a scene that has time steps."""

    orbit: Annotated[int | None, Setting(least=2)] = None
    """Number of frames on the path around the scene."""
    view: Annotated[tuple[str, ...], Setting(metavar="AZ,EL")] = ()
    """Render the view from this many degrees to the right of the front and above it."""
    camera: Annotated[Path | None, Setting(metavar="CAMERA.json")] = None
    """Render the views of a file: a camera_to_world (4 x 4) and fov, a list of them as frames, or a transforms file."""
    frame: Annotated[int | None, Setting(least=0)] = None
    """Render only this one of several views in the file of --camera."""
    path: Annotated[int | None, Setting(metavar="FRAMES", least=2)] = None
    """Number of frames on a smooth path through the views of --view, or in the file of --camera."""
    shot: Annotated[Path | None, Setting(metavar="SHOT.json")] = None
    """Render a film by key frames of the camera, edits, cuts, light and time, and by ready-made moves; see svv shot."""
    preview: bool = False
    """Render the shot at a quarter of the size, and 10 frames per second."""
    time: Annotated[float | None, Setting(metavar="TIME")] = None
    """Render this time of a scene that has time steps."""
    play: bool = False
    """Play all time steps: one view each, or along the path of --orbit or --path."""


@spread
def render(
    scene: SceneFile,
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR|FILE", help="Folder for frames, or a .png, .vti or .mp4 file.")
    ],
    which: Shown = Shown(),
    options: RenderOptions = RenderOptions(),
) -> None:
    """Render a scene: an orbit, a path or a shot as a movie or frames, a single view, or its time steps.

    After Ctrl-C, the same command goes on with the frames of a folder or a shot. Processes that torchrun starts share
    those of a folder; anything else is rendered by the first one.
    """
    from svv.render import frames as views
    from svv.render.emptiness import HIDDEN, SHOW, hides_all
    from svv.train.run import ranks

    _check(out, which)
    told = None
    if which.shot is not None:
        from svv.io.shot_file import read_shot

        told = read_shot(which.shot)
    keys = _keys(out, which, options.size)
    pictures = views.RenderSettings(options.network, options.background, options.what, options.supersample)
    one_view = out.suffix.lower() in ONE_VIEW
    here, one_file = ranks.place(), out.suffix.lower() in (".png", ".vti", ".mp4")
    if here.rank and one_file:
        return
    if here.count > 1:
        ranks.take_share(here, options.device)
    loaded = load(scene, options.device)
    if options.variant is not None:
        if options.network not in (None, "styled"):
            raise BadInput(f"A variant is a painting: leave out --network {options.network}.")
        loaded = loaded.with_variant(options.variant)
    if told is not None:
        told = told if options.variant is None else replace(told, painting=None)
        _render_shot(out, loaded, told, pictures, options, which.preview)
        return
    cameras = _cameras(loaded, which, keys, options.size or (800, 800), one_view)
    loaded, steps = _at_times(loaded, which, len(cameras))
    cameras = cameras * len(steps) if steps is not None and len(cameras) == 1 else cameras
    played = loaded if steps is None else views.Played(loaded, steps)
    with shown("Rendering", quiet=here.rank > 0) as progress:
        empty = ""
        if one_view:
            empty = views.write_view(out, loaded, cameras[0], pictures, progress)
        elif out.suffix.lower() == ".mp4":
            views.write_movie(out, played, cameras, pictures, options.fps, progress)
        else:
            mine = slice(here.rank, None, here.count)
            views.write_frames(out, played, cameras, pictures, progress, mine)
    if not one_view and hides_all(loaded) and options.network != "base":
        empty = HIDDEN
    if empty and not here.rank:
        print(f"svv: {out} is empty, because {empty}{f': {SHOW}' if empty == HIDDEN else ''}.", file=sys.stderr)
    if not here.rank:
        print(out)


def _render_shot(
    out: Path, scene: Scene, shot: Shot, pictures: RenderSettings, options: RenderOptions, preview: bool
) -> None:
    """Render a shot, or this process's share of its frames, and print where it is."""
    from svv.render.shots.film import render_shot
    from svv.train.run import ranks

    here = ranks.place()
    size, fps = options.size or shot.size or (800, 800), options.fps
    if preview:
        size, fps = (max(1, size[0] // 4), max(1, size[1] // 4)), min(fps, PREVIEW_FPS)
    with shown("Rendering", quiet=here.rank > 0) as progress:
        render_shot(out, scene, shot, size, pictures, fps, progress, slice(here.rank, None, here.count))
    if not here.rank:
        print(out)


def _check(out: Path, which: Shown) -> None:
    """Raise BadInput if the arguments contradict each other, or do not tell what to write."""
    one_view, orbit, path = out.suffix.lower() in ONE_VIEW, which.orbit is not None, which.path is not None
    ways = [f"--{name}" for name in ("orbit", "view", "camera", "shot") if getattr(which, name) not in (None, ())]
    many, frame, lacking = "--out as a folder or an .mp4 file.", which.frame is not None, which.camera is None
    for wrong, said in (
        (which.play and which.time is not None, "Give --time or --play, not both."),
        (one_view and which.play, f"Time steps have many views: give {many}"),
        (len(ways) > 1, f"Give {' or '.join(ways[:2])}, not both."),
        (one_view and orbit, f"An orbit has many views: give {many}"),
        (one_view and which.shot is not None, f"A shot has many views: give {many}"),
        (which.shot is not None and (frame or path), "A shot has its own frames: leave out --frame and --path."),
        (which.shot is not None and (which.play or which.time is not None), f"A shot has its own times: {STEP}"),
        (which.preview and which.shot is None, "--preview needs --shot, a film by key frames."),
        (one_view and path, f"A path has many views: give {many}"),
        (frame and path, "Give --frame or --path, not both: a path goes through all views of the file."),
        (frame and lacking, "--frame needs --camera, a file of cameras."),
        (
            path and lacking and len(which.view) < 2,
            "--path needs views to go through: several --view AZ,EL, or --camera, a file of cameras.",
        ),
        (one_view and len(which.view) > 1, f"{out} holds one view: give one --view, or {many}"),
    ):
        if wrong:
            raise BadInput(said)
    for angles in which.view:
        parse_angles(angles, "--view")
    if out.suffix.lower() not in ("", *ONE_VIEW, ".mp4") and out.suffix[1:].isalpha() and not out.is_dir():
        raise BadInput(f"Cannot tell what to write to {out}: give a .png or .vti (one view), an .mp4 or a folder.")


def _keys(out: Path, which: Shown, size: tuple[int, int] | None) -> list[Camera]:
    """Return the cameras in the file; raises BadInput if ``out`` cannot hold their pictures."""
    from svv.io.views.camera_file import read_camera, read_cameras

    if which.camera is None:
        return []
    if which.frame is not None:
        return [read_camera(which.camera, size, which.frame)]
    keys = read_cameras(which.camera, size)
    if len(keys) > 1 and out.suffix.lower() in ONE_VIEW:
        raise BadInput(
            f"{which.camera} has {len(keys)} views: choose one with --frame, or give --out as a folder or an .mp4 file."
        )
    if out.suffix.lower() == ".mp4":
        keys = [key.resized(keys[0].width, keys[0].height) for key in keys]
    return keys


def _cameras(
    scene: Scene, which: Shown, keys: list[Camera], size: tuple[int, int], one_view: bool
) -> list[Camera]:  # fmt: skip
    """Return the cameras of the pictures: one that is to be used for all time steps, or each picture's own."""
    from svv.core.geometry.camera_path import camera_path
    from svv.render.frames import orbit, seen_from

    keys = [seen_from(scene, *parse_angles(angles, "--view"), *size) for angles in which.view] or keys
    if which.path is not None:
        return camera_path(keys, which.path, scene.rig.centre)
    if keys:
        return keys
    if one_view or (which.play and which.orbit is None):
        return [orbit(scene, 181, *size)[90]]  # the middle of the path: from the front
    return orbit(scene, which.orbit or 181, *size)


def _at_times(scene: Scene, which: Shown, frames: int) -> tuple[Scene, list[int] | None]:
    """Return the scene at a time, or the time step of each frame if they are played."""
    from svv.fields.following.followed_scene import at_time

    if which.time is None and not which.play:
        return scene, None
    count = 0 if scene.steps is None else len(scene.steps)
    if count < 2:
        raise BadInput("The scene has no time steps: add them with svv follow.")
    if which.time is not None:
        return at_time(scene, which.time), None
    frames = frames if frames > 1 else count
    return scene, [number * count // frames for number in range(frames)]
