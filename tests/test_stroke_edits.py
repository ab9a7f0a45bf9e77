"""Edits of strokes: relief, its light, width and palette change what is shown, not what was laid, and can be undone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from svv.cli import app as cli
from svv.core.strokes.strokes import Brush, joined, straight_stroke
from svv.errors import BadInput
from svv.fields.scene.closed import read_closed
from svv.fields.scene.edit_request import with_edit
from svv.fields.scene.history import edits_of
from svv.fields.scene.joined import joined as together
from svv.fields.scene.region import Region
from svv.fields.scene.scene import Scene
from svv.fields.scene.stroke_edits import (
    PALETTE_SIZE,
    as_laid,
    edited_strokes,
    luminance,
    recoloured,
    validate_stroke_edits,
)
from svv.fields.scene.stroke_opacity import strokes_of
from svv.job.looks.file import to_json
from svv.job.looks.look import Look
from svv.options.baking import BakeOptions
from svv.options.editing import PaintEdit, SceneEdit
from svv.render.baking.voxels import grid_of, matter_of
from svv.render.baking.voxels import paint_at as paint_at_points
from svv.styles.gallery import gallery_picture
from svv.styles.stroke_palette import mixed, palette_named, palette_of
from svv.train.paint.ink import Ink, StyleInput
from svv.train.pipeline import stylize_scene
from tests.balls import SHORT
from tests.cube import cube_scene
from tests.loose_balls import LEFT, RIGHT, from_front, in_world, loose_balls

SIZE = 3.0
"""Scale of strokes: large ones need a coarse lattice, which is made in a moment."""

RED, BLUE = ((0.8, 0.1, 0.1),), ((0.1, 0.1, 0.8),)
Change = Callable[[Scene], Scene]
CHANGES: dict[str, Change] = {
    "relief": lambda s: s.with_strokes(relief=0.0),
    "width": lambda s: s.with_strokes(width=0.6),
    "light": lambda s: s.with_strokes(light=(1.0, -0.2, 0.1), relief=3.0),
    "palette": lambda s: s.with_strokes(palette=mixed([(0.3, 0.0, 0.0), (1.0, 0.8, 0.6)])),
}


@pytest.fixture(scope="module")
def oil() -> Scene:
    """Two balls, one region, painted by strokes."""
    return stylize_scene(loose_balls(), [StyleInput(gallery_picture("oil", 200), "oil")], SHORT, stroke_size=SIZE)[0]


@pytest.fixture(scope="module")
def partly(balls: Scene) -> Scene:
    """A scene of which one region is painted by strokes and the other drawn."""
    strokes = StyleInput(gallery_picture("oil", 200), "oil")
    return stylize_scene(balls, [strokes, Ink("hatching")], SHORT, mapping={0: 0, 1: 1}, stroke_size=SIZE)[0]


def image(scene: Scene, size: int = 64) -> np.ndarray:
    return scene.render(from_front(size), "styled").rgba


def bare(scene: Scene) -> Scene:
    """The scene without light, and with its own opacity: paint as it is."""
    return replace(scene, regions=tuple(replace(r, lighting=0.0, stroke_opacity=0.0) for r in scene.regions))


def of_ball(picture: np.ndarray, left: bool) -> np.ndarray:
    """Colours of the pixels of one ball. (N, 3)"""
    half = slice(0, picture.shape[1] // 2) if left else slice(picture.shape[1] // 2, None)
    seen = picture[:, half]
    return seen[seen[..., 3] > 0.9][:, :3]


# --- strokes ---------------------------------------------------------------------------------------------------------


def many(count: int = 40) -> tuple:
    generator = np.random.default_rng(0)
    colours = generator.random((count, 3))
    return joined([straight_stroke((0.2, y, 0.5), (0.8, y, 0.5), 0.05, tuple(c)) for y, c in zip(
        np.linspace(0.1, 0.9, count), colours, strict=True)]), generator.random((50, 3))  # fmt: skip


def test_a_palette_keeps_the_order_of_tones_and_is_used_as_a_whole() -> None:
    strokes, colours = many()
    palette = colours[np.argsort(luminance(colours))]
    found = recoloured(strokes, palette)
    before, after = luminance(strokes.colour), luminance(found.colour)
    assert np.corrcoef(np.argsort(np.argsort(before)), np.argsort(np.argsort(after)))[0, 1] > 0.95
    assert len(np.unique(found.colour, axis=0)) > 0.5 * len(strokes)
    assert {tuple(c) for c in found.colour} <= {tuple(c) for c in palette.astype(np.float32)}
    np.testing.assert_array_equal(found.where, strokes.where)


def test_strokes_as_laid_are_the_same_and_edits_multiply() -> None:
    strokes, brush = many()[0], Brush()
    assert edited_strokes(strokes, brush, Region((0, 0, 0), 1.0)) == (strokes, brush)
    region = Region((0, 0, 0), 1.0, stroke_width=2.0, stroke_relief=0.5, stroke_light=(0.0, 0.0, 1.0))
    found, shown = edited_strokes(strokes, brush, region)
    np.testing.assert_allclose(found.radius, 2.0 * strokes.radius)
    assert shown == replace(brush, relief=0.5 * brush.relief, light=(0.0, 0.0, 1.0))
    assert edits_of(as_laid(region)) == {}


@given(st.floats(-1e3, 1e3, width=32), st.floats(-1e3, 1e3, width=32), st.floats(-1e3, 1e3, width=32))
def test_light_on_strokes_is_a_unit_vector(x: float, y: float, z: float) -> None:
    if x or y or z:
        light = validate_stroke_edits(None, None, (x, y, z), None)["stroke_light"]
        assert np.linalg.norm(light) == pytest.approx(1.0)
        assert np.dot(light, (x, y, z)) > 0.0


# --- palettes --------------------------------------------------------------------------------------------------------


def test_palettes_of_pictures_and_of_colours_go_from_dark_to_light(tmp_path: Path) -> None:
    picture = gallery_picture("impasto", 128)
    Image.fromarray((picture * 255).astype(np.uint8)).save(tmp_path / "own.png")
    for palette in (palette_of(picture), palette_named("#f0d090, #102040"), palette_named(str(tmp_path / "own.png"))):
        assert len(palette) == PALETTE_SIZE
        assert (np.diff(luminance(np.array(palette))) >= 0.0).all()
    mean = picture.reshape(-1, 3).mean(0)
    assert np.mean(palette_of(picture), axis=0) == pytest.approx(mean, abs=0.06)
    assert palette_named("#f0d090,#102040")[0] == pytest.approx((16 / 255, 32 / 255, 64 / 255), abs=2e-3)
    assert palette_named("own") == ()
    for text, said in (
        ("#12,#345678", "'#12' is not a colour"),
        ("missing.png", "missing.png"),
        ("ink:hatching", "ink"),
    ):
        with pytest.raises(BadInput, match=said):
            palette_named(text)


# --- scenes ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", CHANGES)
@pytest.mark.parametrize("still", [False, True])
def test_an_edit_shows_and_is_undone(oil: Scene, name: str, still: bool) -> None:
    """In the lattice that moving pictures show, and in the strokes themselves."""
    scene = replace(oil, still=False, resolved=0.01 if still else 0.0)
    before, edited = image(scene), CHANGES[name](scene)
    assert edited.styled is oil.styled and len(edited.history.past) == len(oil.history.past) + 1
    assert np.abs(image(edited) - before).max() > 0.02
    np.testing.assert_array_equal(image(edited.undone()), before)
    np.testing.assert_array_equal(image(edited.reset()), image(scene.reset()))


@pytest.mark.parametrize("name", CHANGES)
def test_a_saved_edit_is_shown_as_before(oil: Scene, name: str, tmp_path: Path) -> None:
    oil.save(tmp_path / "laid.svv")
    scene = Scene.load(tmp_path / "laid.svv")  # what files keep of strokes is rounded
    edited = CHANGES[name](scene)
    edited.save(tmp_path / "edited.svv")
    again = Scene.load(tmp_path / "edited.svv")
    assert again.regions == edited.regions and again.history == edited.history
    assert np.abs(image(again) - image(edited)).mean() < 0.001
    assert np.abs(image(again.undone()) - image(scene)).mean() < 0.001
    assert (tmp_path / "edited.svv").stat().st_size < (tmp_path / "laid.svv").stat().st_size + 6000


def test_strokes_are_edited_without_networks(oil: Scene, tmp_path: Path) -> None:
    oil.save(tmp_path / "a.svv")
    closed = read_closed(tmp_path / "a.svv")
    assert closed is not None and closed.regions_with_strokes == oil.regions_with_strokes != ()
    scenes: dict[str, Any] = {"b.svv": closed, "c.svv": oil}
    for name, scene in scenes.items():
        scene.with_strokes(relief=0.5, width=1.5, light=(0.0, 0.0, 2.0)).save(tmp_path / name)
    assert (tmp_path / "b.svv").read_bytes() == (tmp_path / "c.svv").read_bytes()
    assert to_json(Look.of(cast("Scene", closed))) == to_json(Look.of(oil))


def test_a_palette_gives_its_colours_and_keeps_the_form(oil: Scene) -> None:
    plain = bare(oil)
    red = image(plain.with_strokes(palette=RED, relief=0.0))
    assert of_ball(red, True) == pytest.approx(np.broadcast_to(RED, of_ball(red, True).shape), abs=0.13)
    grey = image(plain.with_strokes(palette=mixed([(0.0, 0.0, 0.0), (1.0, 1.0, 1.0)])))
    before, after = (luminance(of_ball(picture, True)) for picture in (image(plain), grey))
    assert np.corrcoef(before, after)[0, 1] > 0.6


def test_a_part_has_edits_of_its_own(oil: Scene) -> None:
    split = bare(oil).split_at(in_world(RIGHT))
    assert split.regions_with_strokes == (0, 2)
    before, edited = image(split), image(split.with_strokes(2, palette=RED))
    np.testing.assert_array_equal(of_ball(before, True), of_ball(edited, True))
    assert (of_ball(edited, False)[:, 0] > 0.4).mean() > 0.9 and of_ball(edited, False)[:, 2].mean() < 0.2
    both = image(split.with_strokes(palette=BLUE).with_strokes(2, palette=RED))
    assert of_ball(both, True)[:, 2].mean() > 0.5 and of_ball(both, False)[:, 0].mean() > 0.5
    again = bare(oil).with_strokes(palette=RED).split_at(in_world(RIGHT))
    np.testing.assert_array_equal(image(again), image(bare(oil).with_strokes(palette=RED)))
    own = image(again.with_strokes(2, palette=()))
    np.testing.assert_allclose(of_ball(own, False), of_ball(before, False), atol=1e-3)


def test_joined_scenes_keep_their_edits_and_can_be_edited(oil: Scene) -> None:
    plain, other = bare(oil), loose_balls()
    both = together([other, plain.with_strokes(palette=RED)])
    assert both.regions_with_strokes == (2,)
    shown = both.isolated(2)
    alone = replace(plain.with_strokes(palette=RED).isolated(0), still=False)
    assert np.abs(image(shown) - image(alone)).mean() < 0.002
    assert of_ball(image(shown.with_strokes(palette=BLUE)), True)[:, 2].mean() > 0.5
    with pytest.raises(BadInput, match="Region 0 has no strokes"):
        both.with_strokes(0, relief=0.0)


def test_a_painting_that_is_only_partly_of_strokes(partly: Scene) -> None:
    assert partly.regions_with_strokes == (0,)
    camera = partly.rig.orbit(9, 64, [3])[0]
    plain = bare(partly).while_moving()
    before, after = (s.render(camera, "styled") for s in (plain, plain.with_strokes(palette=RED, relief=0.0)))
    inside = (before.region == 1) & (before.rgba[..., 3] > 0.99)
    assert np.abs(before.rgba - after.rgba)[inside].mean() < 0.003  # where the balls meet, cells hold both
    mine = (before.region == 0) & (before.rgba[..., 3] > 0.99)
    assert np.abs(after.rgba[mine][:, :3] - RED).mean() < 0.12
    with pytest.raises(BadInput, match="Region 1 has no strokes to edit"):
        partly.with_strokes(1, width=1.2)


def test_painting_anew_starts_without_edits_and_variants_share_them(oil: Scene) -> None:
    edited = oil.with_strokes(palette=RED)
    thick = StyleInput(gallery_picture("impasto", 200), "impasto")
    other = stylize_scene(edited, [thick], SHORT, variant="thick", stroke_size=SIZE)[0]
    assert other.regions[0].stroke_palette == ()
    assert other.with_variant("styled").with_strokes(relief=0.5).with_variant("thick").regions[0].stroke_relief == 0.5


@pytest.mark.parametrize("layered", [False, True])
def test_undoing_an_edit_from_before_a_painting_leaves_the_painting_as_it_is(oil: Scene, layered: bool) -> None:
    scene = together([bare(oil), loose_balls()]) if layered else oil
    edited = scene.with_strokes(0, palette=RED).edited(0, opacity=0.5)
    thick = StyleInput(gallery_picture("impasto", 200), "impasto")
    other = stylize_scene(edited, [thick], SHORT, mapping={0: 0}, strength=0.5, stroke_size=SIZE)[0]
    now = other.regions[0]
    assert (now.strength, now.stroke_palette, now.opacity) == (0.5, (), 0.5)
    before = other.undone()
    assert before.regions[0] == replace(now, opacity=1.0)
    assert before.undone().regions[0] == before.regions[0]
    assert before.undone().redone().redone().regions == other.regions


def test_opacity_follows_the_strokes_that_are_shown(oil: Scene) -> None:
    dark = oil.with_stroke_opacity(0.8)
    light = dark.with_strokes(palette=((1.0, 1.0, 1.0), (0.7, 0.7, 0.7)), relief=0.0)
    before, after = strokes_of(dark), strokes_of(light)
    assert before is not None and after is not None
    assert float(after[0, 2]) > float(before[0, 2]) + 0.1


def test_all_of_a_request_is_one_step(oil: Scene) -> None:
    paint = PaintEdit(stroke_relief=0.5, stroke_width=1.5, stroke_light=(0.0, 0.0, 2.0), stroke_palette=RED)
    edited = with_edit(oil, SceneEdit(paint=paint))
    assert [step.what for step in edited.history.past][-1].startswith(
        "stroke relief 0.5, stroke width 1.5, stroke light"
    )
    assert edited.regions[0].stroke_light == (0.0, 0.0, 1.0) and edited.regions[0].stroke_palette == RED
    own = with_edit(edited, SceneEdit(paint=PaintEdit(stroke_light=(), stroke_palette=())))
    assert own.regions[0].stroke_light is None and own.regions[0].stroke_palette == ()


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        ({"relief": -0.1}, "between 0 and 4"),
        ({"relief": np.nan}, "between 0 and 4"),
        ({"width": 0.4}, "0.5 to 2 times as wide, not 0.4: .* svv stylize --stroke-size"),
        ({"width": 2.5}, "svv stylize --stroke-size"),
        ({"light": (0.0, 0.0, 0.0)}, "not all 0"),
        ({"light": (1.0, np.inf, 0.0)}, "cannot come from"),
        ({"palette": [(0.1, 0.2)]}, "red, green and blue"),
        ({"palette": [(0.1, 0.2, 1.2)]}, "between 0 and 1"),
    ],
)
def test_bad_edits_are_refused(oil: Scene, edit: dict, said: str) -> None:
    with pytest.raises(BadInput, match=said):
        oil.with_strokes(**edit)


def test_scenes_without_strokes_refuse() -> None:
    cube: Scene = cube_scene()
    with pytest.raises(BadInput, match="No region of this painting has strokes"):
        cube.with_strokes(relief=0.5)
    with pytest.raises(BadInput, match="There is no region 7"):
        cube.with_strokes(7, relief=0.5)


def test_a_file_with_impossible_edits_is_damaged(oil: Scene) -> None:
    for name, value in (("stroke_width", 9.0), ("stroke_relief", -1.0), ("stroke_palette", [[0.1]])):
        header, tensors = oil.to_arrays()
        header["regions"][0] = {**header["regions"][0], name: value}
        with pytest.raises((ValueError, BadInput)):
            Scene.from_arrays(header, tensors)


# --- when the lattice is made ----------------------------------------------------------------------------------------


def test_a_loaded_painting_is_baked_when_it_is_first_shown(oil: Scene, tmp_path: Path) -> None:
    oil.save(tmp_path / "a.svv")
    scene = Scene.load(tmp_path / "a.svv")
    assert scene.styled is not None and scene.styled.unbaked
    scene.hidden(0).shown(0).with_strokes(width=0.8).save(tmp_path / "b.svv")
    assert scene.styled.unbaked
    image(scene)
    assert scene.styled.unbaked  # still images show the strokes themselves
    image(scene.while_moving())
    assert not scene.styled.unbaked
    network = Scene.load(tmp_path / "a.svv").styled
    assert network is not None
    np.testing.assert_array_equal(network.encoding.table.numpy(), scene.styled.encoding.table.numpy())
    off = np.abs(network.encoding.table.numpy() - oil.styled.encoding.table.numpy())  # type: ignore[union-attr]
    assert off.mean() < 0.004


def test_unedited_regions_are_copied_and_results_remembered(oil: Scene, tmp_path: Path) -> None:
    split = oil.split_at(in_world(LEFT))
    edited = split.with_strokes(2, palette=RED)
    assert edited.paint_shown is edited.hidden(0).paint_shown
    assert split.paint_shown is split.styled
    assert edited.paint_shown is not None
    table = edited.paint_shown.encoding.table.numpy()
    oil.save(tmp_path / "a.svv")
    assert (table == oil.styled.encoding.table.numpy()).all(1).mean() > 0.3  # type: ignore[union-attr]


# --- commands --------------------------------------------------------------------------------------------------------


def test_the_command_edits_strokes(oil: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    oil.save("a.svv")

    def svv(*arguments: str) -> Region:
        cli.app(["edit", *arguments, "--out", "b.svv"], prog_name="svv", standalone_mode=False)
        return Scene.load("b.svv").regions[0]

    region = svv("a.svv", "--region", "0", "--stroke-width", "0.7", "--stroke-relief", "1.5")
    assert (region.stroke_width, region.stroke_relief) == (0.7, 1.5)
    region = svv("b.svv", "--stroke-light", "90,0", "--stroke-palette", "#102040,#f0d090")
    assert (
        region.stroke_light == pytest.approx((1.0, 0.0, 0.0), abs=1e-12) and len(region.stroke_palette) == PALETTE_SIZE
    )
    assert svv("b.svv", "--stroke-light", "own", "--stroke-palette", "own").stroke_light is None
    assert svv("b.svv", "--undo").stroke_light is not None
    assert svv("a.svv", "--stroke-light", "-1,2,1").stroke_light == pytest.approx(np.array([-1, 2, 1]) / 6**0.5)
    for bad in (("--stroke-light", "headlight"), ("--stroke-light", "200,0"), ("--stroke-palette", "no.png")):
        with pytest.raises(BadInput):
            svv("a.svv", *bad)
    with pytest.raises(BadInput, match="svv stylize --stroke-size"):
        svv("a.svv", "--stroke-width", "3")


def test_baked_volumes_show_edits(oil: Scene) -> None:
    matter = matter_of(oil, grid_of(oil, BakeOptions(resolution=32), "styled"))
    shown = oil.with_strokes(palette=RED, relief=0.0).paint_shown
    assert shown is not None and oil.styled is not None
    before, after = (paint_at_points(network, matter).float() for network in (oil.styled, shown))
    assert float((before - after).abs().mean()) > 0.05
