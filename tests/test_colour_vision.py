"""Who can tell regions apart: the simulations, the differences, palettes, and the commands."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from svv.cli import app as cli
from svv.core.colour.colour import colour_differences
from svv.core.colour.colour_vision import (
    COLOUR_VISIONS,
    LEAST_DIFFERENCE,
    VISIONS,
    from_oklab,
    oklab,
    set_difference,
    simulated,
    smallest_differences,
)
from svv.core.colour.distinct import distinct_palette
from svv.core.colour.oklab import rgb_to_oklab, shift_in_oklab
from svv.core.colour.srgb import encoded, linear
from svv.errors import BadInput
from svv.fields.scene.scene import Scene
from svv.fields.scene.seen_colours import Seen, seen_in
from svv.io.pictures.output import write_png
from svv.options import figures
from svv.render.distinct import distinct
from svv.render.figures.colour_check import regions_to_json, report_on, seen_in_picture, simulation_sheet
from tests.cube import cube_paint
from tests.nightly import nightly

WHITE = np.ones((1, 3))
COLOURS = np.random.default_rng(0).random((50, 3))


@pytest.mark.filterwarnings("ignore:.*Machado")  # it says that tritanopia is only approximated, as we do
@pytest.mark.parametrize(
    ("vision", "name"),
    [("protanopia", "Protanomaly"), ("deuteranopia", "Deuteranomaly"), ("tritanopia", "Tritanomaly")],
)
def test_deficiencies_are_those_of_machado(vision: str, name: str) -> None:
    colour = pytest.importorskip("colour")
    light = colour.models.eotf_sRGB(COLOURS)
    seen = light @ np.asarray(colour.blindness.matrix_cvd_Machado2009(name, 1.0)).T
    np.testing.assert_allclose(simulated(COLOURS, vision), colour.models.eotf_inverse_sRGB(seen.clip(0, 1)), atol=1e-6)


def test_a_grey_print_keeps_luminance_alone() -> None:
    grey = simulated(COLOURS, "grey print")
    assert np.ptp(grey, axis=1).max() < 1e-12
    np.testing.assert_array_equal(simulated(COLOURS, "normal"), COLOURS)


def test_the_curve_of_srgb_is_that_of_colour_science() -> None:
    colour = pytest.importorskip("colour")
    levels = np.linspace(0.0, 1.0, 4097)
    np.testing.assert_allclose(linear(levels), colour.models.eotf_sRGB(levels), atol=1e-12)
    np.testing.assert_allclose(encoded(levels), colour.models.eotf_inverse_sRGB(levels), atol=1e-12)


def test_oklab_is_that_of_colour_science() -> None:
    colour = pytest.importorskip("colour")
    xyz = colour.sRGB_to_XYZ(COLOURS)
    np.testing.assert_allclose(oklab(COLOURS), colour.XYZ_to_Oklab(xyz), atol=2e-3)
    np.testing.assert_allclose(from_oklab(oklab(COLOURS)), COLOURS, atol=1e-5)


def test_recolouring_in_oklab_keeps_how_light_and_dark_differ(cube: Scene) -> None:
    blue, yellow = torch.tensor([[0.2, 0.3, 0.9]]), torch.tensor([[0.6, 0.55, 0.45]])
    shades = torch.tensor([[[0.15, 0.25, 0.7]], [[0.25, 0.35, 0.95]]])
    before, after = (rgb_to_oklab(c)[..., 0, 0] for c in (shades, shift_in_oklab(shades, blue, yellow)))
    torch.testing.assert_close(after.diff(), before.diff(), atol=1e-4, rtol=0)
    torch.testing.assert_close(shift_in_oklab(blue[None], blue, yellow), yellow[None], atol=1e-5, rtol=0)
    torch.testing.assert_close(shift_in_oklab(shades, blue, blue), shades, atol=0, rtol=0)
    camera = cube.rig.orbit(181, 24, frames=[90])[0]
    colour = (0.2, 0.9, 0.4)
    one, other = cube.edited(0, colour=colour), cube.edited(0, colour=colour, recolour_in="oklab")
    assert np.abs(one.render(camera).rgba - other.render(camera).rgba).max() > 0.01
    assert Scene.from_bytes(other.to_bytes()).regions == other.regions
    with pytest.raises(BadInput, match="choose hsb or oklab"):
        cube.edited(0, recolour_in="lab")


def test_the_difference_of_sets_compares_light_with_light() -> None:
    one, half = np.ones(1), np.full(2, 0.5)
    red, blue = np.array([[0.8, 0.1, 0.1]]), np.array([[0.1, 0.1, 0.8]])
    assert set_difference(red, blue, one, one, "normal") == pytest.approx(colour_differences(red, blue)[0, 0])
    pair = np.concatenate([red, blue])
    assert set_difference(pair, pair[::-1], half, half, "normal") == pytest.approx(0.0, abs=1e-9)
    bright, dark = np.array([[0.9] * 3, [0.2] * 3]), np.array([[0.9, 0.2, 0.2], [0.2, 0.05, 0.05]])
    matched = 0.5 * np.diag(colour_differences(bright, dark)).sum()
    assert set_difference(bright, dark, half, half, "normal") == pytest.approx(matched)
    # Weights need not be the same: three quarters of one stay as they are.
    most = np.array([0.75, 0.25])
    expected = 0.25 * colour_differences(red, blue)[0, 0]
    assert set_difference(pair, pair, half, most, "normal") == pytest.approx(expected)


def test_panels_and_commands_offer_the_ways_that_are_computed() -> None:
    assert figures.VISIONS == VISIONS


@pytest.mark.parametrize("visions", [pytest.param(COLOUR_VISIONS, marks=pytest.mark.slow), VISIONS])
@pytest.mark.parametrize(
    "palette",
    [
        pytest.param([(0.8, 0.2, 0.1), (0.2, 0.6, 0.2)], marks=pytest.mark.slow),
        [(0.8, 0.2, 0.1), (0.75, 0.25, 0.1), (0.2, 0.6, 0.2), (0.3, 0.55, 0.2)],
        pytest.param([(1.0, 1.0, 0.9), (0.98, 1.0, 0.95)], marks=pytest.mark.slow),
        [(0.5, 0.5, 0.5)] * 3,
    ],
)
def test_palettes_become_distinct_in_every_way_of_seeing(visions: tuple, palette: list) -> None:
    own = np.array(palette)
    found = distinct_palette(own, visions, WHITE)
    assert found.difference >= LEAST_DIFFERENCE
    for vision in visions:
        apart = colour_differences(simulated(found.colours, vision), simulated(found.colours, vision))
        assert apart[np.triu_indices(len(own), 1)].min() >= LEAST_DIFFERENCE
        assert colour_differences(simulated(found.colours, vision), WHITE).min() >= LEAST_DIFFERENCE
    assert ((found.colours >= 0) & (found.colours <= 1)).all()


def test_a_palette_that_is_distinct_stays_and_hues_are_kept() -> None:
    good = np.array([(0.9, 0.6, 0.1), (0.1, 0.2, 0.6)])
    np.testing.assert_array_equal(distinct_palette(good, COLOUR_VISIONS, WHITE).colours, good)
    close = np.array([(0.8, 0.25, 0.2), (0.25, 0.6, 0.25)])
    before, after = oklab(close), oklab(distinct_palette(close, COLOUR_VISIONS, WHITE).colours)
    turned = np.arctan2(after[:, 2], after[:, 1]) - np.arctan2(before[:, 2], before[:, 1])
    assert np.abs(np.angle(np.exp(1j * turned))).max() < np.radians(25)


@pytest.mark.slow
def test_of_palettes_that_cannot_be_the_best_found_is_said() -> None:
    own = np.random.default_rng(1).random((12, 3))
    found = distinct_palette(own, VISIONS, WHITE)
    before = smallest_differences(own, VISIONS)[np.triu_indices(12, 1)].min()
    assert before < found.difference < LEAST_DIFFERENCE


def test_one_colour_is_apart_from_all() -> None:
    assert distinct_palette(np.array([(0.2, 0.4, 0.6)]), VISIONS, WHITE).difference == np.inf


@pytest.fixture(scope="module")
def similar(balls: Scene) -> Scene:
    """Balls in red and green that a person without cones for middle waves takes for one another."""
    return balls.edited(0, colour=(0.75, 0.3, 0.15), name="left").edited(1, colour=(0.42, 0.47, 0.12), name="right")


@pytest.mark.parametrize(
    ("how", "visions"), nightly([("colours", COLOUR_VISIONS), ("lightness", VISIONS)], ("lightness", VISIONS))
)
def test_regions_that_merge_are_found_and_mended(similar: Scene, how: Any, visions: tuple[str, ...]) -> None:
    seen = list(seen_in(similar).values())
    report = report_on(seen)
    assert report["smallest"]["normal"]["difference"] > LEAST_DIFFERENCE
    assert {pair["vision"] for pair in report["merging"]} & {"protanopia", "deuteranopia"}
    assert {report["merging"][0]["first"], report["merging"][0]["second"]} == {"left", "right"}
    mended = distinct(similar, how)
    assert mended.nearest is not None and mended.nearest.difference >= LEAST_DIFFERENCE
    after = report_on(list(seen_in(mended.scene).values()))
    assert not [pair for pair in after["merging"] if pair["vision"] in visions]
    assert mended.scene.undone().regions == similar.regions


def test_what_is_painted_keeps_its_colours(cube: Scene) -> None:
    painted = cube.painted(cube_paint(cube, 1), {0: "oil", 1: "oil"}, {}, "oil")
    found = distinct(painted)
    assert [r.edited_colour for r in found.scene.regions[:2]] == [None, None]
    every = cube.painted(cube_paint(cube, 1), {0: "oil", 1: "oil", 2: "oil"}, {}, "oil")
    with pytest.raises(BadInput, match="No visible region has a colour that can be changed"):
        distinct(every)


def test_regions_without_palette_are_one_sentence(cube: Scene) -> None:
    with pytest.raises(BadInput, match="no palette network"):
        seen_in(replace(cube, palette_network=None, regions=()))


def test_a_figure_tells_its_regions(tmp_path: Path) -> None:
    seen = [Seen("bone \u2713", np.array([[0.1, 0.2, 0.3], [0.5, 0.5, 0.5]]), np.array([0.25, 0.75]))]
    for kind in ("png", "tif"):
        from PIL.PngImagePlugin import PngInfo

        info = PngInfo()
        info.add_text("svv:regions", regions_to_json([seen]))
        how = {"pnginfo": info} if kind == "png" else {"tiffinfo": {270: regions_to_json([seen])}}
        Image.new("RGB", (4, 4)).save(tmp_path / f"a.{kind}", **how)  # type: ignore[arg-type]
        ((back,),) = seen_in_picture(tmp_path / f"a.{kind}")
        assert back.name == seen[0].name
        np.testing.assert_allclose(back.colours, seen[0].colours)


@pytest.mark.parametrize(
    "told", ['{"panels": 3}', '{"panels": [[{"name": "a", "colours": [], "weights": []}]]}', "{", '{"other": 1}']
)
def test_damage_to_what_a_figure_tells_is_one_sentence(tmp_path: Path, told: str) -> None:
    from PIL.PngImagePlugin import PngInfo

    info = PngInfo()
    info.add_text("svv:regions", told)
    Image.new("RGB", (4, 4)).save(tmp_path / "a.png", pnginfo=info)
    with pytest.raises(BadInput, match="is damaged: make the figure again"):
        seen_in_picture(tmp_path / "a.png")


def test_any_other_picture_is_checked_by_its_main_colours(tmp_path: Path) -> None:
    picture = np.ones((60, 90, 3), np.float32)
    picture[10:50, 10:40], picture[10:50, 50:80] = (0.75, 0.3, 0.15), (0.1, 0.2, 0.7)
    write_png(tmp_path / "a.png", picture)
    ((*found,),) = seen_in_picture(tmp_path / "a.png")
    assert len(found) == 2
    for colour in ((0.75, 0.3, 0.15), (0.1, 0.2, 0.7)):
        assert min(np.abs(one.colours[0] - colour).max() for one in found) < 0.05
    (tmp_path / "b.png").write_bytes(b"no picture")
    with pytest.raises(BadInput, match="give a scene, or a PNG or TIFF"):
        seen_in_picture(tmp_path / "b.png")


def test_the_sheet_of_simulations_shows_each() -> None:
    wide, tall = (simulation_sheet(np.full(shape, 0.5)) for shape in ((20, 100, 3), (100, 100, 3)))
    assert wide.shape[0] >= 5 * 20 and wide.shape[1] == 100
    assert tall.shape[1] >= 5 * 100


def test_the_commands(
    similar: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    similar.save("a.svv")

    def run(*arguments: str) -> None:
        cli.app(list(arguments), prog_name="svv", standalone_mode=False)

    run("check-colours", "a.svv", "--json", "a.json", "--out", "a.png")
    said = capsys.readouterr().out
    assert "left and right merge:" in said and "grey print" in said and Path("a.png").exists()
    (panel,) = json.loads(Path("a.json").read_text())["panels"]
    assert set(panel["smallest"]) == set(VISIONS) and panel["regions"] == ["left", "right"]
    run("edit", "a.svv", "--distinct", "colours", "--name", "0=first", "--out", "b.svv")
    assert "are nearest" in capsys.readouterr().err
    scene = Scene.load("b.svv")
    assert scene.regions[0].name == "first" and len(scene.history.past) == len(similar.history.past) + 1
    run("check-colours", "b.svv", "--least", "11.9")
    assert all("grey" in line for line in capsys.readouterr().out.splitlines() if "merge" in line)
    run("edit", "a.svv", "--hide", "1", "--out", "one.svv")
    capsys.readouterr()
    run("check-colours", "one.svv")
    assert "Fewer than two regions" in capsys.readouterr().out


def test_every_pair_is_named_once() -> None:
    seen = [Seen(name, np.array([[x, x, x]]), np.ones(1)) for name, x in zip("abc", (0.1, 0.5, 0.9))]
    report = report_on(seen, 100.0)
    for vision in VISIONS:
        named = [{p["first"], p["second"]} for p in report["merging"] if p["vision"] == vision]
        assert len(named) == 3 and all({a, b} in named for a, b in combinations("abc", 2))
