"""The command ``svv bench judge``; see :mod:`svv.cli.bench`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from svv.progress import shown

JUDGE = (
    "svv bench judge view.png --out judged",
    "svv bench judge view.png gallery:woodcut brush.jpg --only cosine --steps 30 --size 256 --out judged",
)
"""Examples in the help."""


def judge(
    view: Annotated[Path, typer.Argument(metavar="VIEW.png", help="A view with alpha.")],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for table.csv and contact sheets.")],
    style: Annotated[
        list[str] | None,
        typer.Argument(metavar="STYLE ...", help="Style pictures besides the two built-in ones."),
    ] = None,
    size: Annotated[int, typer.Option(min=64, help="Width of the view in pixels.")] = 400,
    steps: Annotated[int, typer.Option(min=1, help="Steps of each stylization.")] = 60,
    only: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Only candidates whose name contains this; may be repeated."),
    ] = None,
) -> None:
    """Compare feature networks: one view is stylized with every candidate and scored against the style.

    The scores use none of the features that are compared. They are not enough to decide: look at the contact sheets.
    """
    from svv.bench.styles.judge_features import judge as judged

    with shown("Judging") as progress:
        table = judged(view, style or [], out, size, steps, only or [], progress)
    print(table)
