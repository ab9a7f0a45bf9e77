"""Settings have one source: a field of a dataclass is an option, a property and a line of the reference."""

from __future__ import annotations

import argparse
import inspect
import re
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import pytest
import typer
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from svv.cli.option_group import SYNTAX, flag_of, spread
from svv.errors import BadInput
from svv.fields.radiance.networks import ENCODINGS, FieldSettings
from svv.options import baking, cinema, editing, figures, making, pages, shots, splats
from svv.options.arguments import add_arguments, options_of
from svv.options.described import Setting, chosen, described
from svv.pv.panel.option_panel import options_in, properties_of
from svv.train.run import config

OPTIONS = [
    kind
    for module in (making, editing)
    for kind in vars(module).values()
    if inspect.isclass(kind) and kind.__module__ == module.__name__ and hasattr(kind, "__dataclass_fields__")
]
STAGES = [FieldSettings, config.ReconstructSettings, config.RecolourSettings, config.StylizeSettings]


@dataclass(frozen=True)
class Tea:
    """A stage that has just been thought of."""

    kind: Literal["green", "black"] = "green"
    """Which leaves are taken."""
    minutes: Annotated[float | None, Setting(least=1, most=9)] = None
    """How long it draws."""
    cups: int = 2
    """How many are made."""
    milk: bool = False
    """Whether milk goes in."""
    guest: Annotated[tuple[str, ...], Setting(result=False)] = ()
    """Who drinks it."""


@dataclass(frozen=True)
class Brew(Tea):
    """The same for a panel, where a value that is not set is a number, too."""

    minutes: Annotated[float | None, Setting(most=9, unset=0.0, unset_says="0: as it should.")] = None
    """How long it draws."""


@pytest.mark.parametrize("kind", [*OPTIONS, *STAGES], ids=lambda kind: kind.__name__)
def test_a_whole_sentence_stands_under_every_field(kind: type) -> None:
    for field in described(kind):
        if kind is editing.SceneEdit and not field.sentence:
            continue  # a request is made of others, whose fields have theirs
        assert field.sentence.endswith("."), field
        assert field.sentence[0].isupper() or field.sentence.startswith(("`", "lambda", "white")), field


@pytest.mark.parametrize("kind", OPTIONS, ids=lambda kind: kind.__name__)
def test_what_cannot_be_none_says_how_it_is_unset(kind: type) -> None:
    """A property of a panel always has a value; and a syntax is one that the command can read."""
    for field in described(kind):
        if (
            field.optional
            and field.property_name
            and field.kind is not str
            and not issubclass(kind, making.VolumeOptions)
        ):
            assert field.setting.unset is not None or field.setting.switch is not None, field
        assert not field.setting.syntax or field.setting.syntax in SYNTAX


def test_presets_are_those_of_the_options() -> None:
    assert tuple(config.PRESETS) == making.PRESET_NAMES
    assert (*ENCODINGS, config.VALUES) == get_args(making.EncodingName)


def test_a_new_field_is_an_option_of_the_command() -> None:
    made: list[Tea] = []
    app = typer.Typer()

    @app.command()
    @spread
    def brew(tea: Tea = Tea(cups=3)) -> None:
        """Make tea."""
        made.append(tea)

    def run(*words: str) -> Any:
        return CliRunner().invoke(app, list(words))

    text = run("--help").output
    assert all(flag_of(field) in text for field in described(Tea)) and "How long it draws." in text
    assert run().exit_code == 0 and made[-1] == Tea(cups=3)
    assert run("--kind", "black", "--minutes", "4", "--milk", "--guest", "a", "--guest", "b").exit_code == 0
    assert made[-1] == Tea("black", 4.0, 3, True, ("a", "b"))
    assert run("--minutes", "10").exit_code != 0 and run("--kind", "red").exit_code != 0


def test_a_new_field_is_an_argument_of_scripts() -> None:
    parser = argparse.ArgumentParser()
    add_arguments(parser, Tea(cups=4), {"kind": "--kind", "cups": "--mugs"})
    assert options_of(Tea, parser.parse_args([])) == Tea(cups=4)
    assert options_of(Tea, parser.parse_args(["--mugs", "1", "--kind", "black"]), milk=True) == Tea(
        "black", None, 1, True
    )
    assert "How many are made (4)" in parser.format_help()


def test_a_new_field_is_a_property_of_panels() -> None:
    made = properties_of(Brew(cups=3), "Second")
    xml = {p.name: p.xml for p in made}
    assert [p.name for p in made] == ["SecondKind", "SecondMinutes", "SecondCups", "SecondMilk", "SecondGuest"]
    assert 'text="green"' in xml["SecondKind"] and 'default_values="3"' in xml["SecondCups"]
    assert "How long it draws. 0: as it should." in xml["SecondMinutes"] and 'max="9"' in xml["SecondMinutes"]
    values = {p.name: p.default for p in made}
    assert options_in(Brew, values, "Second") == Brew(cups=3)
    changed = {**values, "SecondKind": "black", "SecondMinutes": 4.0, "SecondGuest": "a; b"}
    assert options_in(Brew, changed, "Second") == Brew("black", 4.0, 3, False, ("a", "b"))
    assert options_in(Brew, {}, cups=5) == Brew(cups=5)


@pytest.mark.parametrize("kind", OPTIONS, ids=lambda kind: kind.__name__)
def test_an_untouched_panel_means_the_defaults(kind: Any) -> None:
    if kind in (making.VolumeOptions, making.ShownVolumeOptions, editing.SceneEdit):  # no panel has them as they are
        return
    values = {p.name: p.default for p in properties_of(kind())}
    assert options_in(kind, values) == kind()


def test_what_does_not_change_the_result_is_no_part_of_its_key() -> None:
    assert chosen(Tea(guest=("a",))) == chosen(Tea()) != chosen(Tea(cups=1))
    for kind in (making.TrainOptions, making.PaintOptions):
        assert "device" not in chosen(kind())


# --- single settings of a preset -------------------------------------------------------------------------------------


ALIKE = {
    "field.levels": "the paper's hash grid, which small scenes need no more than a few levels of",
    "field.log2_entries": "the same: its size",
    "field.lighting": "--lighting, and what the views show",
    "field.headlight": "the views: how their light stands",
    "field.facing": "the encoding values",
    "field.finer": "the paint, which may need finer levels",
    "reconstruct.hold": "HOMES, which gives an encoding its own rates",
    "reconstruct.density_rate": "scenes of a few voxels",
    "reconstruct.known_density_rate": "the encoding values",
    "reconstruct.keep": "short trainings, in which unseen samples are to be seen",
    "reconstruct.prune_every": "short trainings, which else never prune",
    "reconstruct.prune_least": "faint volumes",
    "reconstruct.cells": "thin parts in large boxes",
    "recolour.rays": "machines with little memory",
    "recolour.samples": "machines with little memory; the stability cases",
    "recolour.hold": "HOMES, which gives an encoding its own rates",
    "recolour.palette_rate": "palettes that are to stay as they were given, at 0",
    "recolour.offset_weight": "the paper's lambda_delta, which `svv bench ablate` varies",
    "stylize.style_size": "pictures whose strokes are to be finer or coarser than their scale says",
}
"""Settings that all presets have alike, and who sets them nevertheless: any other one is a constant of the code."""


def test_of_every_option_a_page_says_who_sets_it() -> None:
    page = (Path(__file__).parents[1] / "docs" / "design" / "who-sets-what.md").read_text(encoding="utf-8")
    named: dict[str, list[str]] = {}
    for line in page.splitlines():
        if heading := re.match(r"## `(\w+)`", line):
            named[heading[1]] = []
        elif row := re.match(r"\| (`\w+`(?:, `\w+`)*) \| [^|]+ \| [^|]+ \|$", line):
            named[list(named)[-1]].extend(re.findall(r"\w+", row[1]))
    modules = (making, editing, baking, cinema, figures, pages, splats)
    every = [k for m in modules for k in vars(m).values() if inspect.isclass(k) and k.__module__ == m.__name__]
    kinds = [k for k in every if is_dataclass(k)] + [shots.Shot]  # whose schema says what its key frames hold
    above = {k: {f.name for b in k.__bases__ if is_dataclass(b) for f in fields(b)} for k in kinds}
    own = {k.__name__: [f.name for f in fields(k) if f.name not in above[k]] for k in kinds}
    del own["SceneEdit"]  # what a command or a panel asks for at once
    assert named == own


def test_a_setting_is_one_that_presets_or_people_set() -> None:
    alike = set()
    for stage in config.STAGES:
        every = [getattr(one, stage) for one in config.PRESETS.values()]
        for field in set.intersection(*({f.name for f in fields(each)} for each in every)):
            if len({repr(getattr(each, field)) for each in every}) == 1:
                alike.add(f"{stage}.{field}")
    assert alike == set(ALIKE)
    for text in ("reconstruct.alpha_weight=2", "recolour.phong_rate=0.1"):
        with pytest.raises(BadInput, match="There is no setting"):
            config.changed(config.preset("fast"), [text])


def test_single_settings_are_changed() -> None:
    fast = config.preset("fast")
    found = config.changed(fast, ["reconstruct.iterations=7", "recolour.palette_rate=1e-3", "field.shading=false"])
    assert (found.reconstruct.iterations, found.recolour.palette_rate, found.field.shading) == (7, 1e-3, False)
    assert replace(found, reconstruct=fast.reconstruct, recolour=fast.recolour, field=fast.field) == fast
    assert config.changed(config.preset("paper"), ["stylize.pixels_a_cell=none"]).stylize.pixels_a_cell is None  # type: ignore[attr-defined]
    assert config.changed(fast, ["field.resolutions=16 32"]).field.resolutions == (16, 32)
    assert config.settings_of(making.TrainOptions("fast", change=("reconstruct.rays=64",))).reconstruct.rays == 64


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("reconstruct.iterations", "write STAGE.NAME=VALUE"),
        ("paint.iterations=3", "one of the stages field, reconstruct, recolour, stylize"),
        ("reconstruct.steps=3", "no setting 'reconstruct.steps'; choose one of iterations"),
        ("reconstruct.iterations=many", "reconstruct.iterations needs a whole number of at least 0, not 'many'"),
        ("reconstruct.iterations=-1", "at least 0"),
        ("recolour.decay=nan", "a number of at least 0"),
        ("field.shading=maybe", "true or false"),
        ("field.resolutions=a b", "whole numbers with spaces"),
    ],
)
def test_changes_that_cannot_be(text: str, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        config.changed(config.preset("fast"), [text])


@given(st.sampled_from(config.STAGES), st.data(), st.text(max_size=8))
def test_any_change_is_made_or_refused_in_a_sentence(stage: str, data: st.DataObject, value: str) -> None:
    """And one that says what is there already changes nothing."""
    balanced = config.preset("balanced")
    settings = getattr(balanced, stage)
    name = data.draw(st.sampled_from([field.name for field in fields(settings)]))
    now = getattr(settings, name)
    same = " ".join(map(str, now)) if isinstance(now, tuple) else "none" if now is None else str(now)
    assert config.changed(balanced, [f"{stage}.{name}={same}"]) == balanced
    try:
        config.changed(balanced, [f"{stage}.{name}={value}"])
    except BadInput as error:
        said = str(error)
    else:
        said = f"{stage}.{name} needs"
    assert f"{stage}.{name} needs" in said
