"""Options that several commands share as one dataclass behave as if each command listed them itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer
from hypothesis import example, given
from hypothesis import strategies as st
from typer.testing import CliRunner

from svv.cli.option_group import spread


@dataclass(frozen=True)
class Paint:
    """Options of which one must be given."""

    colour: Annotated[str, typer.Option("--colour", "-c", help="Which.")]
    coats: Annotated[int, typer.Option(min=1, help="How many.")] = 2


@dataclass(frozen=True)
class Brush:
    """Options that may all be left out."""

    width: Annotated[float, typer.Option(help="In pixels.")] = 3.0
    hairs: Annotated[int, typer.Option(help="How many.")] = 40


WIDE = Brush(width=9.0)


def app_of(told: list[object]) -> typer.Typer:
    """Two commands, with shared options and with a list of their own, that tell what they were given."""
    app = typer.Typer()

    @app.command()
    @spread
    def paint(wall: str, how: Paint, dry: bool = False, brush: Brush = WIDE, name: str = "") -> None:
        """Paint a wall."""
        told.append((wall, how, dry, brush, name))

    @app.command()
    def plain(
        wall: str,
        colour: Annotated[str, typer.Option("--colour", "-c", help="Which.")],
        coats: Annotated[int, typer.Option(min=1, help="How many.")] = 2,
        dry: bool = False,
        width: Annotated[float, typer.Option(help="In pixels.")] = 9.0,
        hairs: Annotated[int, typer.Option(help="How many.")] = 40,
        name: str = "",
    ) -> None:
        """Paint a wall."""
        told.append((wall, Paint(colour, coats), dry, Brush(width, hairs), name))

    return app


WORDS = st.sampled_from(
    [["--coats", "3"], ["--coats", "0"], ["-c", "red"], ["--width", "2.5"], ["--width", "x"], ["--dry"],
     ["--name", "n"], ["--hairs", "7"], ["--hairs"], ["wall"], ["--unknown"]]
)  # fmt: skip


@given(st.lists(WORDS, max_size=6))
@example([["wall"], ["-c", "red"]])
@example([["--coats", "3"], ["wall"], ["--hairs", "7"], ["-c", "red"]])
def test_shared_options_are_read_as_a_command_s_own(words: list[list[str]]) -> None:
    told: list[object] = []
    app, given_words = app_of(told), [part for word in words for part in word]
    shared, own = (CliRunner().invoke(app, [name, *given_words]) for name in ("paint", "plain"))
    assert shared.exit_code == own.exit_code
    assert shared.output.replace(" paint", " plain") == own.output
    assert told[: len(told) // 2] == told[len(told) // 2 :] and len(told) == 2 * (own.exit_code == 0)


def test_the_help_is_that_of_a_list() -> None:
    shared, own = (CliRunner().invoke(app_of([]), [name, "--help"]).output for name in ("paint", "plain"))
    assert shared.replace(" paint", " plain") == own and "--colour" in own
