"""The commands ``svv edit`` and ``svv palette``; see :mod:`svv.cli`."""

from __future__ import annotations

from typing import Annotated

import typer

from svv.errors import BadInput
from svv.options import Out, SceneFile, parse_colour, parse_whole

EDIT = (
    "svv edit scene.svv --region 0 --colour '#d02020' --out red.svv",
    "svv edit scene.svv --region 1 --opacity 0.3 --lighting 1.5 --out thin.svv",
    "svv edit scene.svv --isolate 0 --out alone.svv",
    "svv edit alone.svv --show all --out all.svv",
    "svv edit red.svv --undo --out scene.svv",
    "svv edit painted.svv --show-variant ink --strength 0.5 --out faint.svv",
)


def edit(
    scene: SceneFile,
    out: Out,
    region: Annotated[int | None, typer.Option(min=0, help="Which region; `svv info` lists them.")] = None,
    colour: Annotated[str | None, typer.Option(metavar="'#rrggbb'", help="The region's new colour.")] = None,
    opacity: Annotated[float | None, typer.Option(min=0, help="Factor on its opacity.")] = None,
    lighting: Annotated[
        float | None, typer.Option(min=0, help="Factor on its light; 0 is flat. Unshaded views have none.")
    ] = None,
    strength: Annotated[
        float | None, typer.Option(min=0, max=1, help="How much of the styles is seen, of the region or of all.")
    ] = None,
    isolate: Annotated[str | None, typer.Option(metavar="K,...", help="See these regions alone.")] = None,
    hide: Annotated[str | None, typer.Option(metavar="K,...", help="Hide regions; their opacity is kept.")] = None,
    show: Annotated[str | None, typer.Option(metavar="K,...|all", help="See hidden regions again.")] = None,
    reset: Annotated[str | None, typer.Option(metavar="K,...|all", help="Take back all edits of regions.")] = None,
    undo: Annotated[int, typer.Option("--undo", count=True, help="Take back the last edit; twice: the last two.")] = 0,
    redo: Annotated[int, typer.Option("--redo", count=True, help="Do again what was undone last.")] = 0,
    show_variant: Annotated[str | None, typer.Option(metavar="NAME", help="Which painting is shown.")] = None,
    drop_variant: Annotated[str | None, typer.Option(metavar="NAME", help="Remove a painting from the file.")] = None,
) -> None:
    """Change what is seen of a scene's regions. Nothing is trained, it takes a moment.

    What one command changes is one step of the history in the scene's file, which --undo takes back. Of several options
    --reset works first, then those that hide and show.
    """
    from svv.fields.scene import Scene
    from svv.io.atomic import check_writable

    changes = (colour, opacity, lighting, strength, isolate, hide, show, reset)
    edits = any(change is not None for change in changes)
    if (undo or redo) and (edits or (undo and redo)):
        raise BadInput("Undo or redo alone: --undo, or --redo, or edits.")
    if region is None and any(change is not None for change in changes[:3]):
        raise BadInput("Say which region with --region K; `svv info` lists them.")
    if region is not None and all(change is None for change in changes[:4]):
        raise BadInput("Nothing to change: give --colour, --opacity, --lighting or --strength for the region.")
    if not (edits or undo or redo or show_variant or drop_variant):
        raise BadInput("Nothing to change: give an edit, for example --region 0 --opacity 0.5, or --undo.")
    rgb = None if colour is None else parse_colour(colour)
    named = {name: regions_in(text, name) for name, text in
             (("--isolate", isolate), ("--hide", hide), ("--show", show), ("--reset", reset)) if text}  # fmt: skip
    check_writable(out)
    result = before = Scene.load(scene)
    if reset:
        result = result.reset(*named["--reset"])
    if isolate:
        result = result.isolated(*named["--isolate"])
    if hide:
        result = result.hidden(*named["--hide"])
    if show:
        result = result.shown(*named["--show"])
    if region is not None and any(change is not None for change in changes[:3]):
        result = result.edited(region, rgb, opacity, lighting)
    if strength is not None:
        result = result.with_strength(strength, *(() if region is None else (region,)))
    result = result.as_one_step(before)
    for _ in range(undo):
        result = result.undone()
    for _ in range(redo):
        result = result.redone()
    if drop_variant is not None:
        result = result.without_variant(drop_variant)
    if show_variant is not None:
        result = result.with_variant(show_variant)
    result.save(out)
    print(out)


def regions_in(text: str, option: str) -> tuple[int, ...]:
    """'0,2' as regions; 'all', which only --show and --reset take, as none.

    Raises:
        BadInput: anything else.
    """
    if text == "all" and option in ("--show", "--reset"):
        return ()
    return parse_whole(text, option)
