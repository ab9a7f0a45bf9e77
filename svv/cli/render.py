"""The command that renders a scene; see :mod:`svv.cli.app`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from svv.cli.files import load
from svv.cli.option_group import spread
from svv.cli.options import SceneFile
from svv.errors import BadInput
from svv.options.making import RenderOptions
from svv.progress import shown

RENDER = (
    "svv render scene.svv --orbit 181 --out orbit.mp4",
    "svv render scene.svv --orbit 60 --size 400 --background white --out frames",
    "svv render scene.svv --camera camera.json --size 1280x720 --out view.png",
    "svv render scene.svv --camera views/transforms_test.json --frame 3 --out view.vti",
    "torchrun --nproc-per-node 4 -m svv render scene.svv --orbit 181 --out frames",
)
"""Examples in the help."""


@spread
def render(
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
    options: RenderOptions = RenderOptions(),
) -> None:
    """Render a scene: an orbit as a movie or frames, or a single view.

    After Ctrl-C, the same command goes on with the frames of a folder. Processes that torchrun starts share them;
    anything else is rendered by the first one.
    """
    from svv.io.camera_file import read_camera
    from svv.render import frames as views
    from svv.train import ranks

    if orbit is not None and camera is not None:
        raise BadInput("Give --orbit or --camera, not both.")
    pixels, network, behind, what = options.size, options.network, options.background, options.what
    one_view = out.suffix.lower() in (".png", ".vti")
    if one_view and orbit is not None:
        raise BadInput("An orbit has many views: give --out as a folder or an .mp4 file.")
    if out.suffix.lower() not in ("", ".png", ".vti", ".mp4") and out.suffix[1:].isalpha() and not out.is_dir():
        raise BadInput(f"Cannot tell what to write to {out}: give a .png or .vti (one view), an .mp4 or a folder.")
    here, one_file = ranks.place(), out.suffix.lower() in (".png", ".vti", ".mp4")
    if here.rank and one_file:
        return
    if here.count > 1:
        ranks.take_share(here, options.device)
    loaded = load(scene, options.device)
    if options.variant is not None:
        if network not in (None, "styled"):
            raise BadInput(f"A variant is a painting: leave out --network {network}.")
        loaded = loaded.with_variant(options.variant)
    width, height = pixels or (800, 800)
    if camera is not None:
        cameras = [read_camera(camera, pixels, frame)]
    elif one_view:
        cameras = [views.orbit(loaded, 181, width, height)[90]]  # the middle of the path: from the front
    else:
        cameras = views.orbit(loaded, orbit or 181, width, height)
    with shown("Rendering", quiet=here.rank > 0) as progress:
        if one_view:
            views.write_view(out, loaded, cameras[0], network, behind, what, progress)
        elif out.suffix.lower() == ".mp4":
            views.write_movie(out, loaded, cameras, network, behind, what, options.fps, progress)
        else:
            mine = slice(here.rank, None, here.count)
            views.write_frames(out, loaded, cameras, network, behind, what, progress, mine)
    if not here.rank:
        print(out)
