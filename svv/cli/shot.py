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
    "svv shot --move turntable > turn.json",
    "svv render scene.svv --shot turn.json --out turn.mp4",
    "svv shot shot.json --scene scene.svv",
    "svv shot --schema > shot.schema.json",
)

MoveName = Literal["turntable", "swing", "zoom", "peel", "cut", "paint"]
BEGUN: dict[str, dict[str, object]] = {"zoom": {"region": 0}, "peel": {"regions": [0]}, "cut": {"cut": "x>50%"}}
"""What a shot to begin with says of its move."""


def shot(
    file: Annotated[Path | None, typer.Argument(metavar="SHOT.json", help="A shot, which is checked.")] = None,
    scene: Annotated[
        Path | None, typer.Option("--scene", metavar="SCENE.svv", help="Check that the shot fits this scene.")
    ] = None,
    move: Annotated[
        MoveName | None, typer.Option("--move", help="Print a shot of 6 s with this ready-made move, to begin with.")
    ] = None,
    schema: Annotated[
        bool, typer.Option("--schema", help="Print the JSON Schema of shots, with which editors check and complete.")
    ] = False,
) -> None:
    """Check a shot, a film by key frames, or print one to begin with, or what the file of one may say.

    `svv render --shot` renders it.
    """
    from svv.io.shot_file import read_shot, shot_schema

    if [file is not None, move is not None, schema].count(True) != 1:
        raise BadInput("Give one of a shot's file, --move and --schema.")
    if scene is not None and file is None:
        raise BadInput("--scene needs a shot's file to check.")
    if schema:
        print(json.dumps(shot_schema(), indent=2))
    elif move is not None:
        print(json.dumps({"duration": 6, "moves": [{"move": move, **BEGUN.get(move, {})}]}, indent=2))
    elif file is not None:
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
