"""Mask files: they are read back as written, points are kept and added to, and bad files give one sentence."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from svv.cli import app as cli
from svv.cli.options import parse_mapping, parse_points, parse_style_masks
from svv.errors import BadInput
from svv.io.pictures.mask_file import (
    Selection,
    overlay_file,
    picture_size,
    points_file,
    read_mask,
    read_selection,
    write_mask,
)
from svv.io.pictures.mask_pictures import mask_overlay, region_map_overlay, regions_overlay, with_rulers

H, W = 60, 80


@pytest.fixture
def picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Red at the left, blue at the right; the folder is the current one."""
    monkeypatch.chdir(tmp_path)
    levels = np.zeros((H, W, 3), np.uint8)
    levels[:, :40], levels[:, 40:] = [200, 40, 30], [30, 60, 200]
    levels += np.random.default_rng(0).integers(0, 12, levels.shape, dtype=np.uint8)
    Image.fromarray(levels).save("picture.png")
    return Path("picture.png")


def call(*arguments: str | Path, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(sys, "argv", ["svv", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    return int(ended.value.code or 0)


def test_masks_are_read_as_written_and_at_any_size(tmp_path: Path) -> None:
    mask = np.random.default_rng(0).random((H, W)) < 0.3
    write_mask(tmp_path / "a.png", mask)
    np.testing.assert_array_equal(read_mask(tmp_path / "a.png", (H, W, 3)), mask)
    write_mask(tmp_path / "b.png", mask.repeat(3, 0).repeat(3, 1))
    np.testing.assert_array_equal(read_mask(tmp_path / "b.png", (H, W)), mask)
    thin = np.zeros((8 * H, 8 * W), bool)
    thin[100] = True
    write_mask(tmp_path / "c.png", thin)
    assert read_mask(tmp_path / "c.png", (H, W)).sum() == W  # a line does not vanish


def test_drawn_masks_may_be_grey_or_transparent(tmp_path: Path) -> None:
    drawn = np.zeros((H, W, 4), np.uint8)
    drawn[:, :20] = [255, 255, 255, 255]
    drawn[:, 20:40] = [255, 255, 255, 0]
    Image.fromarray(drawn).save(tmp_path / "a.png")
    np.testing.assert_array_equal(read_mask(tmp_path / "a.png"), np.arange(W)[None].repeat(H, 0) < 20)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "no mask at"),
        ("text", "not a picture"),
        (np.zeros((H, W)), "is empty"),
        (np.ones((W, H)), "belongs to another picture"),
    ],
)
def test_masks_that_cannot_be(content: object, words: str, tmp_path: Path) -> None:
    path = tmp_path / "mask.png"
    if isinstance(content, str):
        path.write_text(content)
    elif content is not None:
        write_mask(path, np.asarray(content, bool))
    with pytest.raises(BadInput, match=words):
        read_mask(path, (H, W))


def test_a_picture_is_as_large_as_it_is_shown(tmp_path: Path) -> None:
    image, turned = Image.new("RGB", (W, H)), Image.Exif()
    turned[0x0112] = 6
    image.save(tmp_path / "a.jpg", exif=turned)
    image.save(tmp_path / "b.png")
    assert picture_size(tmp_path / "a.jpg") == (H, W) and picture_size(tmp_path / "b.png") == (W, H)


@pytest.mark.parametrize(
    ("positive", "negative", "words"),
    [
        ([(W, 5.0)], [], "outside the picture"),
        ([(5.0, -1.0)], [], "outside the picture"),
        ([], [(5.0, H)], f"y from 0 to {H - 1}"),
        ([(5.0, 5.0)], [(6.0, 5.0)], "both positive and negative"),
        ([], [(20.0, 20.0)], "both positive and negative"),
    ],
)
def test_points_that_cannot_be(positive: list, negative: list, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        Selection((W, H), ((20.0, 20.0),)).with_points(positive, negative)


def test_points_are_added_once_and_scaled() -> None:
    selection = Selection((W, H)).with_points([(4.0, 6.0)], []).with_points([(4.0, 6.0), (8.0, 6.0)], [(40.0, 30.0)])
    assert selection.positive == ((4.0, 6.0), (8.0, 6.0))
    assert selection.scaled((H // 2, W // 2, 3)) == ([(2.0, 3.0), (4.0, 3.0)], [(20.0, 15.0)])


def test_a_selection_is_shown_saved_and_refined(picture: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = Path("mask.png")
    assert call("style-mask", picture, "--positive", "10,30", "--out", out, monkeypatch=monkeypatch) == 0
    left = np.arange(W)[None].repeat(H, 0) < 40
    assert (read_mask(out) == left).mean() > 0.98
    shown = np.asarray(Image.open(overlay_file(out)).convert("RGB"))
    assert shown.shape == (H, W, 3) and shown[5, 70].max() < 80 < shown[5, 30].max()
    assert json.loads(points_file(out).read_text())["positive"] == [[10.0, 30.0]]
    arguments = ["style-mask", picture, "--refine", out, "--positive", "70,30", "--negative", "12,5"]
    assert call(*arguments, "--out", out, monkeypatch=monkeypatch) == 0
    kept = read_selection(out)
    assert kept is not None and kept.positive == ((10.0, 30.0), (70.0, 30.0)) and kept.negative == ((12.0, 5.0),)
    mask = read_mask(out)
    assert mask[30, 70] and mask[30, 10] and not mask[5, 12]
    arguments = ["--positive", "10,30", "--positive", "70,30", "--negative", "12,5"]
    assert call("style-mask", picture, *arguments, "--out", "at-once.png", monkeypatch=monkeypatch) == 0
    np.testing.assert_array_equal(read_mask("at-once.png"), mask)


def test_regions_are_masks_that_can_be_refined(picture: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert call("style-mask", picture, "--regions", "2", "--out", "parts", monkeypatch=monkeypatch) == 0
    masks = [read_mask(f"parts/region-{k}.png") for k in (0, 1)]
    np.testing.assert_array_equal(masks[0], ~masks[1])
    with Image.open("parts/overlay.png") as overlay:
        assert overlay.size == (W, H)
    x = 10 if masks[0][30, 10] else 70
    arguments = ["--refine", "parts/region-0.png", "--negative", f"{x},30", "--out", "less.png"]
    assert call("style-mask", picture, *arguments, monkeypatch=monkeypatch) == 0
    less = read_mask("less.png")
    assert not less[30, x] and (less & masks[0]).sum() > 0.6 * masks[0].sum() and not (less & masks[1]).any()


def test_a_point_in_a_large_picture_means_its_own_pixels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    levels = np.repeat([[[220, 60, 40]], [[40, 60, 220]]], 2048, 1).repeat(512, 0)
    Image.fromarray(levels.astype(np.uint8)).save("p.png")
    assert call("style-mask", "p.png", "--positive", "2000,900", "--out", "m.png", monkeypatch=monkeypatch) == 0
    mask = read_mask("m.png")  # worked on, and written, with a long side of 1024
    assert mask.shape == (512, 1024) and mask[300:].all() and not mask[:200].any()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["none.png", "--positive", "1,1", "--out", "m.png"], "no style picture"),
        (["gallery:gouache", "--positive", "1,1", "--out", "m.png"], "no 'gouache'"),
        (["picture.png", "--out", "m.png"], "Say what to select"),
        (["picture.png", "--positive", "1;1", "--out", "m.png"], "is not a point"),
        (["picture.png", "--positive", "nan,1", "--out", "m.png"], "is not a point"),
        (["picture.png", "--positive", "80,1", "--out", "m.png"], "outside the picture"),
        (["picture.png", "--negative", "8,1", "--out", "m.png"], "at least one --positive"),
        (["picture.png", "--positive", "8,8", "--negative", "8,8", "--out", "m.png"], "both positive and negative"),
        (["picture.png", "--positive", "8,8", "--out", "m.jpg"], "name the mask .png"),
        (["picture.png", "--positive", "8,8", "--out", "none/m.png"], "folder does not exist"),
        (["picture.png", "--positive", "8,8", "--regions", "3", "--out", "m"], "or points"),
        (["picture.png", "--regions", "1", "--out", "m"], "2 to 32"),
        (["picture.png", "--regions", "3", "--out", "m.png"], "as a folder"),
        (["picture.png", "--refine", "none.png", "--positive", "8,8", "--out", "m.png"], "no mask at"),
        (["picture.png", "--refine", "other.png", "--positive", "8,8", "--out", "m.png"], "was made for a picture"),
        (["picture.png", "--refine", "odd.png", "--positive", "8,8", "--out", "m.png"], "does not contain the points"),
        (["picture.png", "--positive", "8,8", "--with", "sam", "--out", "m.png"], "SAM"),
    ],
)
def test_bad_use_is_one_sentence_and_leaves_nothing(
    arguments: list[str], said: str, picture: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("SVV_SAM_WEIGHTS", "none.pth")
    for name, points in (("other", {"svv": "selection", **vars(Selection((40, 30)))}), ("odd", {"a": 1})):
        write_mask(f"{name}.png", np.ones((H, W), bool))
        points_file(Path(f"{name}.png")).write_text(json.dumps(points))
    before = sorted(Path.cwd().iterdir())
    assert call("style-mask", *arguments, monkeypatch=monkeypatch) == 2
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "%" not in line]  # progress
    assert line.startswith("svv: ") and said in line
    assert sorted(Path.cwd().iterdir()) == before


def test_a_selection_of_everything_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Image.new("RGB", (20, 16), "grey").save("flat.png")
    assert call("style-mask", "flat.png", "--positive", "3,3", "--out", "m.png", monkeypatch=monkeypatch) == 0
    assert "covers the whole picture" in capsys.readouterr().err
    assert call("style-mask", "flat.png", "--regions", "2", "--out", "m", monkeypatch=monkeypatch) in (0, 2)


def test_overlays_show_points_and_numbers() -> None:
    mask = np.zeros((H, W), bool)
    mask[:, :40] = True
    grey = np.full((H, W, 3), 0.5, np.float32)
    shown = mask_overlay(grey, mask, Selection((W, H), ((20.0, 30.0),), ((60.0, 30.0),))).astype(int)
    assert shown[28, 18, 1] > shown[28, 18, 0] + 50 and shown[28, 58, 0] > shown[28, 58, 1] + 50
    tinted = regions_overlay(grey, mask.astype(np.int64))
    assert len(np.unique(tinted[30, [2, 77]], axis=0)) == 2


def test_texts_of_options() -> None:
    assert parse_style_masks(["1=a=b.png", "0=c.png"], 2) == {1: Path("a=b.png"), 0: Path("c.png")}
    assert parse_points(["3,4.5"], "--positive") == [(3.0, 4.5)]
    assert parse_mapping("colour") == parse_mapping("Color") == "colour"


@pytest.mark.parametrize(
    ("texts", "words"),
    [(["a.png"], "a style's mask"), (["x=a.png"], "a style's mask"), (["0="], "a style's mask"),
     (["2=a.png"], "no style 2"), (["0=a.png", "0=b.png"], "two masks")],
)  # fmt: skip
def test_texts_of_masks_that_cannot_be(texts: list[str], words: str) -> None:
    with pytest.raises(BadInput, match=words):
        parse_style_masks(texts, 2)


def test_a_map_of_regions_has_their_colours_and_numbers() -> None:
    region = np.full((60, 90), -1)
    region[:, 30:60], region[:, 60:] = 0, 2
    shown = region_map_overlay(region, [(1, 0, 0), (0, 1, 0), (0, 0, 1)])
    assert (shown[region < 0, 3] == 0).all() and (shown[region >= 0, 3] == 255).all()
    assert tuple(shown[0, 45]) == (255, 0, 0, 255) and tuple(shown[0, 75]) == (0, 0, 255, 255)
    numbered = (shown[..., :3] != [255, 0, 0]).any(-1) & (region == 0)
    assert 0 < numbered.sum() < 0.3 * (region == 0).sum()
    assert not region_map_overlay(np.full((20, 20), -1))[..., 3].any()


@pytest.mark.parametrize("size", [(200, 100), (4000, 2000), (20, 10)])
def test_rulers_stay_at_the_edges(size: tuple[int, int]) -> None:
    picture = np.full((100, 200, 3), 90, np.uint8)
    shown = with_rulers(picture, size)
    assert (shown[40:, 50:] == picture[40:, 50:]).all() and (shown[:20] > 200).any() and (shown[:, :30] > 200).any()
