"""The ``svv`` command: reads arguments, calls the layers below and prints the result.

Heavy imports are inside the commands, so ``svv --help`` answers at once.

Exit codes: 0 done, 2 bad use or bad input (one sentence on standard error), 130 stopped by the user.
"""

from __future__ import annotations

import functools
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from typing import Annotated, Any, NoReturn

import typer

from svv._version import __version__
from svv.cli import bench, cache, cinema, edit, features, follow, job, join, paraview, render, scene, style, stylize
from svv.cli.options import examples
from svv.ending import end_with
from svv.errors import BadInput, Cancelled, Elsewhere
from svv.io.locks import alone
from svv.io.memory import check_address_space
from svv.measure import share_cores
from svv.train.ranks import place

app = typer.Typer(
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
        context.get_help()  # prints it
        raise typer.Exit
    here = place()
    if here.count > 1 and context.invoked_subcommand not in TOGETHER:
        if here.rank:
            raise typer.Exit
        print(f"svv {context.invoked_subcommand} runs in one process; the others have nothing to do.", file=sys.stderr)


COMMANDS: dict[str, tuple[Callable[..., None], Sequence[str]]] = {
    "demo": (job.demo, job.DEMO),
    "run": (job.run, job.RUN),
    "views": (job.views, job.VIEWS),
    "import": (cinema.import_, cinema.IMPORT),
    "train": (scene.train, scene.TRAIN),
    "edit": (edit.edit, edit.EDIT),
    "palette": (edit.palette, edit.PALETTE),
    "stylize": (stylize.stylize, stylize.STYLIZE),
    "join": (join.join, join.JOIN),
    "follow": (follow.follow, follow.FOLLOW),
    "render": (render.render, render.RENDER),
    "evaluate": (scene.evaluate, scene.EVALUATE),
    "export": (cinema.export, cinema.EXPORT),
    "view": (cinema.view, cinema.VIEW),
    "info": (scene.info, scene.INFO),
    "styles": (style.styles, style.STYLES),
    "style-mask": (style.style_mask, style.STYLE_MASK),
    "features": (features.features, features.FEATURES),
    "cache": (cache.cache, cache.CACHE),
}
"""Each command's name, its function and the examples in its help, in the order of the help."""

TOGETHER = ("views", "train", "render", "export")
"""Commands that share their work among the processes that ``torchrun`` starts; for others, the first does all."""


def _guarded(command: Callable[..., None]) -> Callable[..., None]:
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


for _name, (_command, _examples) in COMMANDS.items():
    app.command(_name, epilog=examples(*_examples))(_guarded(_command))
app.add_typer(bench.app, name="bench")
paraview.add_to(app)  # last, as in the help


def main() -> NoReturn:
    """Run the command line; an error becomes one sentence and an exit code."""
    share_cores(os.environ)

    def run() -> object:
        if place().count > 1:
            os.environ.setdefault("TORCH_CPP_LOG_LEVEL", "ERROR")  # else one that dies fills the screen of the others
        try:
            return app(prog_name="svv", standalone_mode=False)
        except UsageError as error:
            if place().rank:
                raise Elsewhere(2) from None  # the first process was given the same arguments
            command = error.ctx.command_path if error.ctx else "svv"
            raise BadInput(f"{error.format_message()} Try: {command} --help") from None
        except typer.Abort:
            raise Cancelled from None

    end_with(run, "svv")
