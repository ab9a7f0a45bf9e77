"""The commands that start ParaView: ``svv paraview``, ``pvpython``, ``pvbatch`` and ``pvserver``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from svv.cli.options import examples
from svv.errors import BadInput

Folder = Annotated[
    Path | None,
    typer.Option(
        "--paraview", metavar="DIR", help="ParaView's folder; by default SVV_PARAVIEW, otherwise the one on the PATH."
    ),
]
Arguments = Annotated[
    list[str] | None, typer.Argument(metavar="ARGS", help="Arguments for the program, passed on unchanged.")
]

# Unknown options belong to the program, and so does everything from the first file name on: `svv pvpython script.py
# --help`. Only --help is ours: -h would also be found inside ParaView's own options (-display).
PASSED_ON: dict[str, object] = {
    "ignore_unknown_options": True,
    "allow_interspersed_args": False,
    "help_option_names": ["--help"],
}


def paraview(
    arguments: Arguments = None,
    folder: Folder = None,
    prepare: Annotated[bool, typer.Option("--prepare", help="Install what svv needs for this ParaView.")] = False,
    torch: Annotated[
        str | None,
        typer.Option(
            "--torch",
            metavar="cpu|cuda|keep",
            help="With --prepare: build of PyTorch to install; by default the environment variable TORCH decides.",
        ),
    ] = None,
) -> None:
    """Start ParaView with the StyleRF plugin; its filters are under Filters > StyleRF."""
    if prepare:
        from svv.pv.launch import prepare as preparation

        if arguments:
            raise BadInput(f"--prepare does not start a program: leave out {' '.join(arguments)}.")
        print(preparation.prepare(folder, torch))
        return
    if torch is not None:
        raise BadInput("--torch has no effect without --prepare: give both.")
    _run("paraview", arguments, folder)


def pvpython(arguments: Arguments = None, folder: Folder = None) -> None:
    """Start ParaView's Python with the plugin and svv; without a display, it renders off screen."""
    _run("pvpython", arguments, folder)


def pvbatch(arguments: Arguments = None, folder: Folder = None) -> None:
    """Start ParaView's batch Python, alone or on every rank of an MPI job."""
    _run("pvbatch", arguments, folder)


def pvserver(arguments: Arguments = None, folder: Folder = None) -> None:
    """Start ParaView's server: filters and training run there, and the client needs no PyTorch."""
    _run("pvserver", arguments, folder)


def _run(program: str, arguments: list[str] | None, folder: Path | None) -> None:
    from svv.pv.launch import programs

    programs.run(program, arguments or [], folder)


def add_to(app: typer.Typer) -> None:
    """Add the four commands to the application."""
    for command, lines in (
        (paraview, ("svv paraview", "svv paraview --paraview ~/ParaView-6.0.1 state.pvsm", "svv paraview --prepare")),
        (pvpython, ("svv pvpython script.py --help", "svv pvpython -c 'import svv, torch'")),
        (pvbatch, ("svv pvbatch script.py", "mpiexec -n 2 svv pvbatch script.py")),
        (pvserver, ("svv pvserver --server-port=11111", "mpiexec -n 2 svv pvserver --hostname=127.0.0.1")),
    ):
        app.command(epilog=examples(*lines), context_settings=PASSED_ON)(command)
