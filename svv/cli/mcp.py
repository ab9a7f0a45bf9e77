"""The command ``svv mcp``; see :mod:`svv.cli.app`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

MCP = ("svv mcp --root data",)


def mcp(
    root: Annotated[
        Path, typer.Option("--root", metavar="DIR", help="Folder below which all files are read and written.")
    ] = Path("."),
) -> None:
    """Serve svv to assistants by the Model Context Protocol, over standard input and output.

    An assistant starts this command itself. Its tools list files, train, name, edit in words, paint, render and make
    figures; they report progress, can be cancelled, and work in the background if asked. They read and write files
    below the folder only. Needs the extra `agents`.
    """
    from svv.job.agents import serve
    from svv.progress import collect_again

    collect_again()
    serve(root)
