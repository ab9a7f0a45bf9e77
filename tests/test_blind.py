"""Blind comparison sheets: the method is not revealed, the key needs all choices, and agreement is counted right."""

from __future__ import annotations

import json
import struct
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import gaussian_filter

from svv.cli import app as cli
from svv.errors import BadInput
from svv.io.pictures.output import write_png
from svv.styles.gallery.textures import style_picture
from svv_bench.styles.blind import agreement, find_cases, open_key, read_choices, report, wilson, write_sheets

NAMES = ("ball-brush-0", "ball-brush-1", "ball-dots-0", "ball-dots-1", "cube-dots-0")
SIZE = 96


def ball(colours: NDArray[np.floating]) -> NDArray[np.floating]:
    inside = np.hypot(*(np.mgrid[:SIZE, :SIZE] - SIZE / 2)) < SIZE * 0.4
    return np.concatenate([colours[:SIZE, :SIZE], inside[..., None]], axis=2)


@pytest.fixture(scope="module")
def trial(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Path], Path]:
    """Two ways: one shows the style itself, the other mud of it."""
    folder = tmp_path_factory.mktemp("trial")
    pictures = {"brush": style_picture("brush strokes", SIZE), "dots": style_picture("stippling", SIZE)}
    for name, picture in pictures.items():
        (folder / "styles").mkdir(exist_ok=True)
        write_png(folder / "styles" / f"{name}.png", picture)
    random = np.random.default_rng(0)
    for way in ("crisp", "mud"):
        (folder / way).mkdir()
        for name in NAMES:
            shown = np.roll(pictures[name.split("-")[1]], int(random.integers(SIZE)), 1)
            shown = shown if way == "crisp" else gaussian_filter(shown, (2, 2, 0))
            write_png(folder / way / f"{name}.png", ball(shown))
    return [folder / "crisp", folder / "mud"], folder / "styles"


def written(trial: tuple[list[Path], Path], folder: Path, **options: Any) -> dict[str, Any]:
    ways, styles = trial
    assert write_sheets(ways, styles, folder / "sheets", folder / "key.json", **options) == len(NAMES)
    return dict(json.loads((folder / "key.json").read_text()))


def choose(folder: Path, key: dict[str, Any], way: int) -> Path:
    """As a person would who always finds one way the best."""
    path = folder / "sheets" / "choices.json"
    path.write_text(json.dumps({f"{n + 1:03d}": s["columns"].index(way) + 1 for n, s in enumerate(key["sheets"])}))
    return path


# --- sheets ------------------------------------------------------------------------------------------------------


def test_sheets_hold_pixels_and_nothing_else(trial: tuple[list[Path], Path], tmp_path: Path) -> None:
    written(trial, tmp_path)
    files = sorted(p.name for p in (tmp_path / "sheets").iterdir())
    assert files == [*(f"{n + 1:03d}.png" for n in range(len(NAMES))), "choices.json"]
    for path in (tmp_path / "sheets").glob("*.png"):
        data, at, chunks = path.read_bytes(), 8, []
        while at < len(data):
            (length,) = struct.unpack(">I", data[at : at + 4])
            chunks.append(data[at + 4 : at + 8])
            at += length + 12
        assert set(chunks) == {b"IHDR", b"IDAT", b"IEND"}
    text = (tmp_path / "sheets" / "choices.json").read_text()
    assert set(json.loads(text).values()) == {None}
    assert "crisp" not in text and "ball" not in text


def test_columns_show_what_the_key_says(trial: tuple[list[Path], Path], tmp_path: Path) -> None:
    key = written(trial, tmp_path, crops=1)
    assert sorted(s["name"] for s in key["sheets"]) == sorted(NAMES)
    for number, entry in enumerate(key["sheets"]):
        sheet = np.asarray(Image.open(tmp_path / "sheets" / f"{number + 1:03d}.png"), np.float32)
        width = (sheet.shape[1] + 6) // 3
        columns = [sheet[20:, width * k : width * (k + 1) - 6] for k in (1, 2)]
        fine = [np.abs(np.diff(c, axis=1)).mean() for c in columns]
        assert entry["columns"][int(np.argmax(fine))] == 0  # the crisp way


def test_the_seed_and_the_pictures_say_the_order(trial: tuple[list[Path], Path], tmp_path: Path) -> None:
    orders = []
    for number, seed in enumerate((0, 0, 1, 2)):
        (tmp_path / str(number)).mkdir()
        key = written(trial, tmp_path / str(number), seed=seed)
        orders.append([(s["name"], s["columns"]) for s in key["sheets"]])
    assert orders[0] == orders[1]
    assert orders[0] != orders[2] or orders[0] != orders[3]
    one, two = ((tmp_path / k / "sheets" / "003.png").read_bytes() for k in "01")
    assert one == two


def test_equal_ways_give_equal_columns(trial: tuple[list[Path], Path], tmp_path: Path) -> None:
    ways, styles = trial
    (tmp_path / "twin").mkdir()
    for path in ways[0].iterdir():
        (tmp_path / "twin" / path.name).write_bytes(path.read_bytes())
    write_sheets([ways[0], tmp_path / "twin"], styles, tmp_path / "sheets", tmp_path / "key.json")
    sheet = np.asarray(Image.open(tmp_path / "sheets" / "001.png"))
    width = (sheet.shape[1] + 6) // 3
    np.testing.assert_array_equal(sheet[20:, width : 2 * width - 6], sheet[20:, 2 * width : 3 * width - 6])


# --- the key -----------------------------------------------------------------------------------------------------


def test_the_eye_and_the_figures_agree_on_mud(trial: tuple[list[Path], Path], tmp_path: Path) -> None:
    key = written(trial, tmp_path)
    found = open_key(choose(tmp_path, key, 0), tmp_path / "key.json")
    assert found["ways"]["crisp"]["chosen"] == len(NAMES) and found["ways"]["mud"]["share"] == 0
    assert found["figures"]["lines"]["share"] == 1
    assert {"contrast", "patches 1/1", "colour"} <= set(found["figures"])
    other = open_key(choose(tmp_path, key, 1), tmp_path / "key.json")
    for name, own in found["figures"].items():
        assert other["figures"][name]["agreed"] == own["of"] - own["agreed"]
    text = report(found)
    assert "| crisp | 5 of 5 | 100 % | 57 % to 100 % |" in text and "| lines | 5 of 5 |" in text


def test_missing_choices_keep_it_closed(trial: tuple[list[Path], Path], tmp_path: Path) -> None:
    key = written(trial, tmp_path)
    choices = tmp_path / "sheets" / "choices.json"
    with pytest.raises(BadInput, match="5 of 5 sheets have no choice yet, the first is 001"):
        open_key(choices, tmp_path / "key.json")
    given = json.loads(choose(tmp_path, key, 0).read_text())
    for wrong, said in (
        ({**given, "002": None}, "1 of 5 sheets have no choice yet, the first is 002"),
        ({**given, "002": 3}, "column from 1 to 2"),
        ({**given, "002": True}, "column from 1 to 2"),
        ({**given, "009": 1}, "does not exist"),
        ([1, 2], "JSON object"),
    ):
        choices.write_text(json.dumps(wrong))
        with pytest.raises(BadInput, match=said):
            open_key(choices, tmp_path / "key.json")
    choices.write_text(json.dumps({str(int(k)): v for k, v in given.items()}))
    assert read_choices(choices, 5, 2) == [v - 1 for v in given.values()]  # 1 is sheet 001


def test_other_pictures_than_those_of_the_sheets_are_found_out(trial: tuple[list[Path], Path], tmp_path: Path) -> None:
    key = written(trial, tmp_path)
    moved = {**key, "ways": list(reversed(key["ways"]))}
    (tmp_path / "key.json").write_text(json.dumps(moved))
    with pytest.raises(BadInput, match="no longer the one on the sheet"):
        open_key(choose(tmp_path, key, 0), tmp_path / "key.json")
    (tmp_path / "key.json").write_text("{}")
    with pytest.raises(BadInput, match="not a key"):
        open_key(tmp_path / "sheets" / "choices.json", tmp_path / "key.json")


def test_agreement_counts_pairs_with_the_chosen_one() -> None:
    def row(chosen: str, **values: float) -> dict[str, Any]:
        figures = {way: {"lines": v, "contrast": 1 + v} for way, v in values.items()}
        return {"chosen": chosen, "figures": figures}

    rows = [row("a", a=0.1, b=0.2, c=0.05), row("b", a=0.3, b=0.3, c=0.5)]
    assert agreement(rows)["lines"] | {"low": 0, "high": 0} == {
        "agreed": 2,
        "of": 3,
        "share": 2 / 3,
        "low": 0,
        "high": 0,
    }
    ratios = [{"chosen": "a", "figures": {"a": {"contrast": 0.6}, "b": {"contrast": 1.5}}}]
    assert agreement(ratios)["contrast"]["agreed"] == 0  # 1 / 0.6 is more than 1.5


@pytest.mark.parametrize(
    ("count", "of", "low", "high"),
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_wilson_s_interval_as_published(count: int, of: int, low: float, high: float) -> None:
    """Newcombe 1998, table I, method 3."""
    assert wilson(count, of) == pytest.approx((low, high), abs=5.1e-5)


@given(st.integers(1, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_wilson_s_interval_holds_the_share_and_mirrors(pair: tuple[int, int]) -> None:
    count, of = pair
    low, high = wilson(count, of)
    assert 0 <= low <= count / of + 1e-12 and count / of - 1e-12 <= high <= 1
    assert wilson(of - count, of) == pytest.approx((1 - high, 1 - low))


# --- bad input and the command -----------------------------------------------------------------------------------


def test_what_cannot_be_compared_is_said(trial: tuple[list[Path], Path], tmp_path: Path) -> None:
    ways, styles = trial
    (tmp_path / "few").mkdir()
    few = tmp_path / "few"
    for folders, known, said in (
        (ways[:1], styles, "two folders"),
        ([ways[0], ways[0]], styles, "different names"),
        ([ways[0], tmp_path / "none"], styles, "no folder"),
        ([ways[0], few], styles, "not in every folder"),
        ([few, tmp_path], styles, "no PNG"),
        (ways, None, "No style is known for ball-brush-0"),
        (ways, tmp_path / "none.json", "Cannot read the styles"),
    ):
        with pytest.raises(BadInput, match=said):
            find_cases(folders, known)
    with pytest.raises(BadInput, match="among the sheets"):
        write_sheets(ways, styles, tmp_path / "sheets", tmp_path / "sheets" / "key.json")
    (few / "x-dots.png").write_bytes(b"")
    (tmp_path / "two").mkdir()
    write_png(tmp_path / "two" / "x-dots.png", np.ones((8, 8, 4)))
    with pytest.raises(BadInput, match="Cannot read"):
        write_sheets([few, tmp_path / "two"], styles, tmp_path / "sheets", tmp_path / "key.json")
    write_png(few / "x-dots.png", np.ones((8, 9, 4)))
    with pytest.raises(BadInput, match="differ in size"):
        write_sheets([few, tmp_path / "two"], styles, tmp_path / "sheets", tmp_path / "key.json")
    assert not (tmp_path / "sheets").exists()
    written(trial, tmp_path)
    with pytest.raises(BadInput, match="another trial"):
        written(trial, tmp_path)


def test_styles_are_named_by_a_file_or_the_gallery(tmp_path: Path) -> None:
    for way in ("a", "b"):
        (tmp_path / way).mkdir()
        write_png(tmp_path / way / "ring-ink-wash-076.png", np.ones((8, 8, 4)))
    ways = [tmp_path / "a", tmp_path / "b"]
    assert find_cases(ways, None)[0].style == "gallery:ink-wash"
    (tmp_path / "styles.json").write_text(json.dumps({"ring-ink-wash-076": "wash.png"}))
    assert find_cases(ways, tmp_path / "styles.json")[0].style == "wash.png"


@pytest.mark.slow
def test_the_command_goes_from_folders_to_agreement(
    trial: tuple[list[Path], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ways, styles = trial

    def call(*arguments: str | Path) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["svv", "bench", "blind", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        return int(ended.value.code or 0), *capsys.readouterr()

    assert call(*ways, "--styles", styles, "--out", tmp_path / "sheets")[0] == 0
    key = json.loads((tmp_path / "sheets-key.json").read_text())
    choices = tmp_path / "sheets" / "choices.json"
    code, _, said = call("--choices", choices)
    assert code == 2 and said.splitlines()[-1].startswith("svv: 5 of 5 sheets have no choice yet")
    choose(tmp_path, key, 0)
    code, table, _ = call("--choices", choices, "--json", tmp_path / "agreement.json")
    assert code == 0 and "| crisp | 5 of 5 |" in table
    assert len(json.loads((tmp_path / "agreement.json").read_text())["sheets"]) == 5
    assert call(*ways)[0] == call(*ways, "--choices", choices)[0] == 2
