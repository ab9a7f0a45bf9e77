"""The command ``svv bench blind``; see :mod:`svv.cli.app`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from svv.cli.options import Json, Seed
from svv.errors import BadInput
from svv.progress import shown

BLIND = (
    "svv bench blind ours theirs --out trial",
    "svv bench blind ours theirs frames --styles styles.json --crops 3 --seed 7 --out trial",
    "svv bench blind --choices trial/choices.json --json agreement.json",
)
"""Examples in the help."""


def blind(
    ways: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="FOLDER ...", help="Folders of PNG files with the same names, one folder per way of painting."
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", metavar="DIR", help="Folder for the sheets.")] = None,
    styles: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.json|DIR",
            help="Style of each picture; by default the gallery picture of the same name.",
        ),
    ] = None,
    key: Annotated[
        Path | None, typer.Option(metavar="KEY.json", help="Where to write the key; by default DIR-key.json.")
    ] = None,
    crops: Annotated[int, typer.Option(min=0, max=6, help="Number of rows with enlarged crops.")] = 2,
    choices: Annotated[
        Path | None,
        typer.Option(metavar="FILE.json", help="Best column of every sheet; with it, the key is opened."),
    ] = None,
    seed: Seed = 0,
    json: Json = None,
) -> None:
    """Compare ways of painting without knowing which is which, and check metrics against the choices.

    First make the sheets: the style, then the ways in shuffled columns. Write the number of the best column of each
    into choices.json in the same folder, and pass it to --choices. The result: how often each way was chosen, and how
    often each metric agrees.
    """
    from svv.io.files.atomic import check_writable, write_json
    from svv_bench.styles.blind import CHOICES, open_key, report, write_sheets

    if choices is not None:
        if ways or out is not None:
            raise BadInput("Give folders and --out to write sheets, or --choices to open the key, not both.")
        if json is not None:
            check_writable(json)
        folder = choices.resolve().parent
        with shown("Judging") as progress:
            found = open_key(choices, key or folder.with_name(f"{folder.name}-key.json"), progress)
        if json is not None:
            write_json(json, found)
        print(report(found))
        return
    if out is None:
        raise BadInput("Give --out to write sheets, or --choices to open the key of existing ones.")
    if json is not None:
        raise BadInput("There are no figures before the key is opened: give --json together with --choices.")
    kept = key or out.resolve().with_name(f"{out.resolve().name}-key.json")
    with shown("Sheets") as progress:
        count = write_sheets(ways or (), styles, out, kept, seed, crops, progress)
    print(f"{out}: {count} sheets; write your choices into {out / CHOICES}. Do not open {kept} before then.")
