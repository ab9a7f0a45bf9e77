"""The command that renders a scene; see :mod:`svv.cli.app`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from svv.cli.files import load
from svv.cli.options import Device, DeviceOption, Network, SceneFile, What, parse_colour, parse_size
from svv.errors import BadInput
from svv.progress import shown

RENDER = (
    "svv render scene.svv --orbit 181 --out orbit.mp4",
    "svv render scene.svv --orbit 60 --size 400 --background white --out frames",
    "svv render scene.svv --camera camera.json --size 1280x720 --out view.png",
    "svv render scene.svv --camera views/transforms_test.json --frame 3 --out view.vti",
)
"""Examples of the help."""


def render(
    scene: SceneFile,
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR|FILE", help="A folder for frames, or a .png, .vti or .mp4 file.")
    ],
    orbit: Annotated[int | None, typer.Option(min=2, help="Number of frames on the path around the scene.")] = None,
    camera: Annotated[
        Path | None,
        typer.Option(
            metavar="CAMERA.json",
            help="Render one view: a file with camera_to_world (4 x 4) and fov, or a transforms file.",
        ),
    ] = None,
    frame: Annotated[int, typer.Option(min=0, help="Number of the view in a transforms file.")] = 0,
    size: Annotated[str | None, typer.Option(metavar="N|WxH", help="Size in pixels; 800 by default.")] = None,
    network: Annotated[
        Network | None, typer.Option(help="Which network's colours; by default those of the last stage.")
    ] = None,
    variant: Annotated[str | None, typer.Option(metavar="NAME", help="Name of the painting to render.")] = None,
    background: Annotated[
        str | None,
        typer.Option(
            metavar="COLOUR",
            help="white, black or '#rrggbb'; by default movies are over white, images are transparent.",
        ),
    ] = None,
    what: Annotated[What, typer.Option(help="What to write; a .vti always holds all three.")] = What.rgba,
    fps: Annotated[float, typer.Option(min=1, help="Frames per second of a movie.")] = 30.0,
    device: DeviceOption = Device.cpu,
) -> None:
    """Render a scene: an orbit as a movie or frames, or a single view."""
    from svv.io.camera_file import read_camera
    from svv.render import frames as views

    if orbit is not None and camera is not None:
        raise BadInput("Give --orbit or --camera, not both.")
    pixels = None if size is None else parse_size(size)
    behind = None if background is None else parse_colour(background)
    one_view = out.suffix.lower() in (".png", ".vti")
    if one_view and orbit is not None:
        raise BadInput("An orbit has many views: give --out as a folder or an .mp4 file.")
    if out.suffix.lower() not in ("", ".png", ".vti", ".mp4") and out.suffix[1:].isalpha() and not out.is_dir():
        raise BadInput(f"Cannot tell what to write into {out}: name it .png or .vti (one view), .mp4, or a folder.")
    loaded = load(scene, device)
    if variant is not None:
        if network not in (None, Network.styled):
            raise BadInput(f"A variant is a painting: leave --network {network.value} away.")
        loaded = loaded.with_variant(variant)
    width, height = pixels or (800, 800)
    if camera is not None:
        cameras = [read_camera(camera, pixels, frame)]
    elif one_view:
        cameras = [views.orbit(loaded, 181, width, height)[90]]  # the middle of the way: from the front
    else:
        cameras = views.orbit(loaded, orbit or 181, width, height)
    name = None if network is None else network.value
    with shown("Rendering") as progress:
        if one_view:
            views.write_view(out, loaded, cameras[0], name, behind, what.value, progress)
        elif out.suffix.lower() == ".mp4":
            views.write_movie(out, loaded, cameras, name, behind, what.value, fps, progress)
        else:
            views.write_frames(out, loaded, cameras, name, behind, what.value, progress)
    print(out)
