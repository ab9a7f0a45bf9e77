"""The ``svv`` command: reads arguments, calls the layers below and prints the result.

A command and what is heavy are imported when it is called, so ``svv --help`` answers at once. Exit codes: 0 done, 2 bad
use or bad input (one sentence on standard error), 130 stopped by the user.
"""

from __future__ import annotations

import functools
import importlib
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from keyword import iskeyword
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperGroup

from svv._version import __version__
from svv.cli import paraview
from svv.cli.added import added, added_command
from svv.cli.options import examples
from svv.ending import end_with, leave
from svv.errors import BadInput, Cancelled, Elsewhere
from svv.idle_imports import leave_out_idle_imports
from svv.io.files.locks import alone
from svv.io.files.memory import check_address_space
from svv.progress import collect_later
from svv.train.run.ranks import place

COMMANDS: dict[str, tuple[str, str]] = {
    "demo": (
        "job",
        "Run the whole job on generated data: volume, views, training, edits, styles, a movie and a report.",
    ),
    "run": ("job", "Run the whole job on a volume or on views: training, scores, styles, a movie and a report."),
    "views": ("job", "Render views of a volume: training views on a sphere around it, test views on the orbit."),
    "import": ("cinema", "Make a folder of views from a Cinema database: ParaView's, Ascent's or pycinema's."),
    "train": ("scene", "Train a scene on views."),
    "edit": (
        "edit",
        "Edit a scene: colour, opacity, light, strokes, outlines, visibility, cuts and parts. Nothing is trained.",
    ),
    "palette": ("edit", "Correct a scene's palette by hand and train its regions again; the base network is kept."),
    "stylize": ("stylize", "Paint a scene's regions in the style of pictures, or draw them in ink."),
    "look": (
        "look",
        "Save how a scene looks to a file, and give other scenes that look: colours, styles, light, outlines.",
    ),
    "join": ("join", "Join scenes of several transfer functions, arrays or members, to show them alone or together."),
    "follow": ("follow", "Add the other time steps of its volume to a scene, without views or training."),
    "opacities": ("follow", "Show a scene with other opacities of its transfer function, without views or training."),
    "render": (
        "render",
        "Render a scene: an orbit, a path or a shot as a movie or frames, a single view, or its time steps.",
    ),
    "shot": (
        "shot",
        "Check a shot, which svv render films, or print one to begin with, or what one may say.",
    ),
    "probe": (
        "probe",
        "Read off what pixels of a scene's picture show: the region, its place in the world and the volume's value "
        "there.",
    ),
    "figure": (
        "figure",
        "Make a figure of scenes for a paper: panels with a legend, a scale bar and orientation axes.",
    ),
    "check-colours": (
        "figure",
        "Check whether everybody can tell the regions of a scene or figure apart, as rendered.",
    ),
    "evaluate": ("scene", "Score a scene against views of the volume: PSNR, SSIM, FLIP and LPIPS."),
    "export": (
        "cinema",
        "Write a scene for other programs: a page for browsers, images, a volume, or Gaussian splats.",
    ),
    "view": (
        "cinema",
        "Show a scene in the browser: from all sides, with its palette, opacities, paintings and light to edit.",
    ),
    "info": ("scene", "Show what a scene contains: its regions, networks and size, and how it was made."),
    "styles": ("style", "List the gallery of style pictures, or write them to a folder with a contact sheet."),
    "style-mask": ("style", "Select the part of a style picture that `svv stylize --style-mask` learns from."),
    "features": ("features", "Show or fetch the networks of the preset paper (VGG-16) and of LPIPS (AlexNet)."),
    "cache": ("cache", "Show or clear all that svv writes by itself, by kind: number, size, limit and folder."),
    "mcp": ("mcp", "Serve svv to assistants by the Model Context Protocol, over standard input and output."),
}
"""Each command's name, its module in ``svv.cli`` and the first paragraph of its help, in its order."""


GROUPS = ("look",)
"""Commands that are groups of commands: ``app`` of their module."""


def command_of(name: str) -> tuple[Callable[..., None], Sequence[str]]:
    """Return the function of a command and the examples in its help."""
    module, word = importlib.import_module(f"svv.cli.{COMMANDS[name][0]}"), name.replace("-", "_")
    return getattr(module, f"{word}_" if iskeyword(word) else word), getattr(module, word.upper())


class Commands(TyperGroup):
    """The commands, each imported when it is called: help and every command would wait for all of them otherwise."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names in the order of the help: ParaView's programs after our own, then other distributions'."""
        return list(dict.fromkeys((*COMMANDS, *super().list_commands(ctx), *added())))

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return the command of a name, or None."""
        if cmd_name not in COMMANDS:
            return super().get_command(ctx, cmd_name) or added_command(cmd_name)
        if cmd_name in GROUPS:
            return typer.main.get_command(importlib.import_module(f"svv.cli.{cmd_name}").app)
        command, lines = command_of(cmd_name)
        one = typer.Typer(add_completion=False, rich_markup_mode="rich")
        one.command(cmd_name, epilog=examples(*lines))(guarded(command))
        return typer.main.get_command(one)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help as click does: what frames the help of a command takes half a second to import."""
        super(TyperGroup, self).format_help(ctx, formatter)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write what each command does, without importing it."""
        programs = {name: self.get_command(ctx, name).help for name in super().list_commands(ctx)}
        with formatter.section("Commands"):
            said = {name: told for name, (_, told) in (added() | COMMANDS).items()} | programs
            formatter.write_dl([(name, said[name]) for name in self.list_commands(ctx)])


app = typer.Typer(
    cls=Commands,
    name="svv",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)


UsageError: Any = typer.BadParameter.__base__
"""Click's error for bad use: some versions of typer bring their own copy of click, others need the package."""


@app.callback(invoke_without_command=True)
def svv(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Show the version and stop.")] = False,
) -> None:
    """Volume renderings that look like something else: recoloured, relit, thinned out or painted, region by region.

    Views of a volume become a small scene file (.svv), which renders from any side, takes edits without training
    and can be painted in the style of pictures.
    """
    if version:
        print(f"svv {__version__}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        print(context.get_help())
        raise typer.Exit
    here = place()
    if here.count > 1 and context.invoked_subcommand not in TOGETHER:
        if here.rank:
            raise typer.Exit
        print(f"svv {context.invoked_subcommand} runs in one process; the others have nothing to do.", file=sys.stderr)


TOGETHER = ("views", "train", "render", "export")
"""Commands that share their work among the processes that ``torchrun`` starts; for others, the first does all."""


def guarded(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command that begins only with enough memory, and where no other one writes its result."""

    @functools.wraps(command)
    def run(**given: Any) -> None:
        try:
            os.getcwd()
        except FileNotFoundError as error:  # PyTorch's libraries cannot be loaded from there
            raise BadInput("The current folder no longer exists: change to another one.") from error
        check_address_space()
        first = given.get("out") is not None and not place().rank
        with alone(given["out"]) if first else nullcontext():
            command(**given)

    return run


paraview.add_to(app)  # last, as in the help


def main() -> NoReturn:
    """Run the command line; an error becomes one sentence and an exit code."""
    collect_later()

    def run() -> object:
        if place().count > 1:
            os.environ.setdefault("TORCH_CPP_LOG_LEVEL", "ERROR")  # else one that dies fills the screen of the others
        try:
            return app(prog_name="svv", standalone_mode=False)
        except UsageError as error:
            if place().rank:
                raise Elsewhere(2) from None  # the first process was given the same arguments
            command = error.ctx.command_path if error.ctx else "svv"
            said = error.format_message().replace("Value error, ", "").rstrip(".")
            raise BadInput(f"{said}. Try: {command} --help") from None
        except typer.Abort:
            raise Cancelled from None

    end_with(run, "svv")


def program() -> NoReturn:
    """Run the command line in a process of its own, which ends with it."""
    leave_out_idle_imports()
    try:
        main()
    except SystemExit as ending:
        if isinstance(ending.code, int):
            leave(ending.code)
        raise
