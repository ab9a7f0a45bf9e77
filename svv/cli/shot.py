"""The command ``svv shot``: what the file of a shot may say, and whether one is right; see :mod:`svv.cli.app`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal

import typer

from svv.errors import BadInput
from svv.options.shots import Shot
from svv.progress import shown

SHOT = (
    "svv shot --move turntable --out turn.json",
    "svv shot shot.json --scene scene.svv",
    "svv shot --schema --out shot.schema.json",
)

MoveName = Literal["turntable", "swing", "zoom", "peel", "cut", "paint"]
BEGUN: dict[str, dict[str, object]] = {"zoom": {"region": 0}, "peel": {"regions": [0]}, "cut": {"cut": "x>50%"}}
"""What a shot to begin with says of its move."""


def shot(
    file: Annotated[Path | None, typer.Argument(metavar="SHOT.json", help="A shot, which is checked.")] = None,
    scene: Annotated[
        Path | None, typer.Option("--scene", metavar="SCENE.svv", help="Check that it fits this scene.")
    ] = None,
    move: Annotated[MoveName | None, typer.Option("--move", help="Print a shot with this move.")] = None,
    schema: Annotated[bool, typer.Option("--schema", help="Print the JSON Schema of shots.")] = False,
    out: Annotated[Path | None, typer.Option("--out", "-o", metavar="FILE.json", help="Write it here instead.")] = None,
) -> None:
    """Check a shot, which svv render films, or print one to begin with, or what one may say."""
    from svv.io.files.atomic import write_json
    from svv.io.shot_file import read_shot, shot_schema

    if [file is not None, move is not None, schema].count(True) != 1:
        raise BadInput("Give one of a shot's file, --move and --schema.")
    if scene is not None and file is None:
        raise BadInput("--scene needs a shot's file to check.")
    if out is not None and file is not None:
        raise BadInput("--out needs --move or --schema: a shot's file is only checked.")
    if file is None:
        begun = {"duration": 6, "moves": [{"move": move, **BEGUN.get(str(move), {})}]}
        told = shot_schema() if schema else begun
        if out is None:
            print(json.dumps(told, indent=2))
        else:
            write_json(out, told)
            print(out)
    else:
        read = read_shot(file)
        if scene is not None:
            _check_fits(read, scene)
        said = [f"{len(read.keys)} key frame{'s' * (len(read.keys) != 1)}"] + [f"move {one.name}" for one in read.moves]
        print(f"{file}: {read.seconds:g} s, {', '.join(said)}")


def _check_fits(shot: Shot, path: Path) -> None:
    """Raise BadInput if a shot does not fit a scene."""
    from svv.fields.scene.scene import Scene
    from svv.render.shots.film import Film

    with shown("Checking") as progress:
        Film(Scene.load(path), shot, progress=progress)
