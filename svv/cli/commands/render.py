"""The command that renders a scene; see :mod:`svv.cli.app`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from svv.cli.files import load
from svv.cli.option_group import spread
from svv.cli.options import SceneFile
from svv.errors import BadInput
from svv.options.making import RenderOptions
from svv.progress import shown

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene

RENDER = (
    "svv render scene.svv --orbit 181 --out orbit.mp4",
    "svv render scene.svv --orbit 60 --size 400 --background white --out frames",
    "svv render scene.svv --camera camera.json --size 1280x720 --out view.png",
    "svv render scene.svv --camera views/transforms_test.json --frame 3 --out view.vti",
    "svv render painted.svv --orbit 181 --supersample 2 --out smooth.mp4",
    "svv render series.svv --play --out series.mp4",
    "svv render series.svv --play --orbit 240 --out frames",
    "torchrun --nproc-per-node 4 -m svv render scene.svv --orbit 181 --out frames",
)
"""Examples in the help."""

ONE_VIEW = (".png", ".vti")
"""Extensions of files of one view."""


@spread
def render(  # long: its options
    scene: SceneFile,
    out: Annotated[
        Path,
        typer.Option("--out", "-o", metavar="DIR|FILE", help="Folder for frames, or a .png, .vti or .mp4 file."),
    ],
    orbit: Annotated[int | None, typer.Option(min=2, help="Number of frames on the path around the scene.")] = None,
    camera: Annotated[
        Path | None,
        typer.Option(
            metavar="CAMERA.json",
            help="Render one view, from a file with camera_to_world (4 x 4) and fov, or from a transforms file.",
        ),
    ] = None,
    frame: Annotated[int, typer.Option(min=0, help="Number of the view in a transforms file.")] = 0,
    time: Annotated[
        float | None, typer.Option("--time", metavar="TIME", help="Render this time of a scene that has time steps.")
    ] = None,
    play: Annotated[
        bool, typer.Option("--play", help="Play all time steps: one view each, or along the path of --orbit.")
    ] = False,
    options: RenderOptions = RenderOptions(),
) -> None:
    """Render a scene: an orbit as a movie or frames, a single view, or its time steps.

    After Ctrl-C, the same command goes on with the frames of a folder. Processes that torchrun starts share them;
    anything else is rendered by the first one.
    """
    from svv.io.views.camera_file import read_camera
    from svv.render import frames as views
    from svv.render.emptiness import HIDDEN, SHOW, hides_all
    from svv.train.run import ranks

    _check(out, orbit, camera, time, play)
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
    loaded, steps = _at_times(loaded, time, play, orbit)
    width, height = options.size or (800, 800)
    if camera is not None:
        cameras = [read_camera(camera, options.size, frame)]
    elif one_view or (play and orbit is None):
        cameras = [views.orbit(loaded, 181, width, height)[90]]  # the middle of the path: from the front
    else:
        cameras = views.orbit(loaded, orbit or 181, width, height)
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


def _check(out: Path, orbit: int | None, camera: Path | None, time: float | None, play: bool) -> None:
    """Raise BadInput if the arguments contradict each other, or do not tell what to write."""
    one_view = out.suffix.lower() in ONE_VIEW
    if play and time is not None:
        raise BadInput("Give --time or --play, not both.")
    if one_view and play:
        raise BadInput("Time steps have many views: give --out as a folder or an .mp4 file.")
    if orbit is not None and camera is not None:
        raise BadInput("Give --orbit or --camera, not both.")
    if one_view and orbit is not None:
        raise BadInput("An orbit has many views: give --out as a folder or an .mp4 file.")
    if out.suffix.lower() not in ("", *ONE_VIEW, ".mp4") and out.suffix[1:].isalpha() and not out.is_dir():
        raise BadInput(f"Cannot tell what to write to {out}: give a .png or .vti (one view), an .mp4 or a folder.")


def _at_times(scene: Scene, time: float | None, play: bool, orbit: int | None) -> tuple[Scene, list[int] | None]:
    """Return the scene at a time, or the time step of each frame if they are played."""
    from svv.fields.values.followed_scene import at_time

    if time is None and not play:
        return scene, None
    count = 0 if scene.steps is None else len(scene.steps)
    if count < 2:
        raise BadInput("The scene has no time steps: add them with svv follow.")
    if not play:
        assert time is not None
        return at_time(scene, time), None
    frames = orbit or count
    return scene, [number * count // frames for number in range(frames)]
