"""The command ``svv join``; see :mod:`svv.cli.app`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from svv.cli.files import load
from svv.cli.options import Out

JOIN = ("svv join shell.svv core.svv --out both.svv", "svv edit both.svv --isolate 0 --isolate 1 --out shell-alone.svv")


def join(
    scenes: Annotated[list[Path], typer.Argument(metavar="SCENE.svv...", help="Scenes of one place, two to eight.")],
    out: Out,
) -> None:
    """Join scenes of several transfer functions, arrays or members, to show them alone or together.

    Their regions become regions of one scene, in the order of the files, with their edits and paintings. Together,
    extinctions add, also where functions overlap. Train, correct, split and paint scenes before joining them.
    """
    from svv.fields.scene.joined import joined, relit

    loaded = [load(path) for path in scenes]
    whole = joined(loaded)
    for number in relit(loaded):
        print(f"{scenes[number]} gets the light of the others: svv edit --light moves that of all.", file=sys.stderr)
    whole.save(out)
    counts = [sum(r.layer == k for r in whole.regions) for k in range(len(whole.layers) + 1)]
    print(f"{out}: {out.stat().st_size / 1e6:.1f} MB, {' + '.join(map(str, counts))} regions")
