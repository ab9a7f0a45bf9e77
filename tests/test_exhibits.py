"""Sheets of paintings: every scene in every style, nothing painted twice, and figures that show what was asked for."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from svv.errors import BadInput
from svv.fields.radiance.networks import PaletteField
from svv.fields.scene.scene import Scene
from svv.io.pictures.output import write_png
from svv.train.run.config import PRESETS, StylizeSettings
from svv_bench.styles.exhibits import Exhibit, paint_figures, paint_sheet

HOW = Exhibit("draft", 48)
SHORT = StylizeSettings(style_views=6, style_size=48)


@pytest.fixture(autouse=True)
def short(broad_strokes: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(PRESETS, "draft", replace(PRESETS["draft"], stylize=SHORT))


@pytest.fixture
def scene(tmp_path: Path, balls: Scene) -> Path:
    """The balls with a lighting network that is told apart from none: whether flat balls get one is a near thing."""
    path, settings = tmp_path / "balls.svv", replace(balls.settings, lighting="network")
    flat = balls.palette_network
    assert flat is not None
    torch.manual_seed(0)
    network = PaletteField(settings, balls.occupancy, balls.base.geometry_width, flat.colours)
    network.load_state_dict({**network.state_dict(), **flat.state_dict()})
    assert network.lighting_mlp is not None
    with torch.no_grad():
        list(network.lighting_mlp.parameters())[-1].mul_(10.0)
    replace(balls, settings=settings, palette_network=network).save(path)
    return path


@pytest.fixture
def styles(tmp_path: Path) -> list[str]:
    """A red and a green picture, each of three bands that are three parts."""
    rng, found = np.random.default_rng(0), []
    bands = np.repeat([1.0, 0.7, 0.4], [22, 21, 21])[:, None, None]
    for name, colour in (("red", (0.8, 0.2, 0.2)), ("green", (0.2, 0.7, 0.2))):
        found.append(str(tmp_path / f"{name}.png"))
        write_png(found[-1], np.clip(bands * rng.normal(colour, 0.03, (64, 64, 3)), 0, 1))
    return found


def panel(path: Path, row: int, column: int, rows: int, columns: int) -> np.ndarray:
    """A picture of a sheet of rows x columns, levels. (h, w, 3)"""
    head = 30 if path.name == "sheet.png" else 18  # it alone has captions
    whole = np.asarray(Image.open(path)).astype(float)[head:, :, :3]
    height, width = ((side + 6) // number for side, number in zip(whole.shape, (rows, columns), strict=False))
    return whole[row * height : (row + 1) * height - 6, column * width : (column + 1) * width - 6]


def ink(picture: np.ndarray) -> np.ndarray:
    """How much of each colour is missing from white: what was painted has less of that. (3,)"""
    return (255.0 - picture).mean(axis=(0, 1))


def test_a_sheet_has_a_row_a_scene_and_a_column_a_style_and_is_not_painted_twice(
    scene: Path, styles: list[str], tmp_path: Path
) -> None:
    out = tmp_path / "sheet"
    path = paint_sheet([scene], styles, out, HOW)
    for row in (0, 1):
        assert [ink(panel(path, row, column, 2, 3)).argmin() for column in (1, 2)] == [0, 1]
    assert (panel(path, 0, 0, 2, 3) == 255).all() and (panel(path, 1, 0, 2, 3) < 255).any()
    assert (np.asarray(Image.open(path))[18:30] < 200).any(), "figures stand under the names"
    made = {file: file.stat().st_mtime_ns for file in out.glob("*.svv")}
    assert sorted(file.name for file in made) == ["balls-green.svv", "balls-red.svv"]
    paint_sheet([scene], styles[:1], out, HOW)
    assert {file: file.stat().st_mtime_ns for file in out.glob("*.svv")} == made


@pytest.mark.slow
def test_figures_show_parts_alone_together_and_edited(scene: Path, styles: list[str], tmp_path: Path) -> None:
    out = tmp_path / "figures"
    several, parts, edits = paint_figures(scene, styles, out, HOW)
    regions = len(Scene.load(scene).regions)
    assert [r.style is not None for r in Scene.load(out / "only-1.svv").regions] == [k == 1 for k in range(regions)]
    own, alone, all_of_them = (panel(several, 0, k, 1, regions + 4) for k in (0, 2, regions + 3))
    assert np.abs(own - alone).mean() > 1 and np.abs(alone - all_of_them).mean() > 1
    assert (panel(parts, 0, 1, 2, 4).mean(axis=2) > 250).mean() > 0.1  # beyond the part it is white
    painted, faint, bright = (panel(edits, 0, column, 1, 6) for column in (1, 2, 5))
    assert ink(faint).sum() < ink(painted).sum() and np.abs(bright - painted).mean() > 0.1


def test_bad_input_is_told_before_anything_is_painted(scene: Path, styles: list[str], tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(BadInput, match="two styles"):
        paint_figures(scene, styles[:1], out, HOW)
    with pytest.raises(BadInput, match="Two styles are called 'red'"):
        paint_sheet([scene], [styles[0], styles[0]], out, HOW)
    with pytest.raises(BadInput, match="0 to 180"):
        Exhibit(frame=181)
    plain = tmp_path / "plain.svv"
    replace(Scene.load(scene), palette_network=None, regions=()).save(plain)
    with pytest.raises(BadInput, match="no palette network"):
        paint_sheet([plain], styles, out, HOW)
    assert not out.exists()
