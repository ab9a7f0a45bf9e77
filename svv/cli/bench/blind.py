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


def blind(
    ways: Annotated[
        list[Path] | None, typer.Argument(metavar="FOLDER ...", help="Folders of PNG with equal names, one a way.")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", metavar="DIR", help="Folder for the sheets.")] = None,
    styles: Annotated[
        Path | None,
        typer.Option(metavar="FILE.json|DIR", help="Each picture's style; by default the gallery's, by its name."),
    ] = None,
    key: Annotated[
        Path | None, typer.Option(metavar="KEY.json", help="Which column is which way; by default DIR-key.json.")
    ] = None,
    crops: Annotated[int, typer.Option(min=0, max=6, help="Rows of enlarged crops.")] = 2,
    choices: Annotated[
        Path | None, typer.Option(metavar="FILE.json", help="Open the key: best column of every sheet.")
    ] = None,
    seed: Seed = 0,
    json: Json = None,
) -> None:
    """Compare ways of painting without knowing which is which, and figures with what the eye chose.

    First sheets: the style on the left, the ways in shuffled columns. Write the number of the best column of each sheet
    into choices.json, which lies beside them; then give it to --choices. The key says in what share of the sheets each
    way was chosen, and in what share of the pairs each figure agrees.
    """
    from svv.bench.styles.blind import CHOICES, open_key, report, write_sheets
    from svv.io.atomic import check_writable, write_json

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
        raise BadInput("Give --out for the sheets, or --choices to open the key of those that are there.")
    if json is not None:
        raise BadInput("There are no figures before the key is opened: give --json beside --choices.")
    kept = key or out.resolve().with_name(f"{out.resolve().name}-key.json")
    with shown("Sheets") as progress:
        count = write_sheets(ways or (), styles, out, kept, seed, crops, progress)
    print(f"{out}: {count} sheets; write your choices into {out / CHOICES}. Leave {kept} closed until then.")
