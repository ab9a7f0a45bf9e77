"""Pictures that several regions share: families of strokes, their pairs with regions, and every way to choose them."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import svv
from svv.cli.options import parse_mapping
from svv.cli.swatches import print_swatches
from svv.errors import BadInput
from svv.fields.scene.region import swatches
from svv.fields.scene.scene import Scene
from svv.io.files.atomic import write_json
from svv.io.pictures.output import write_png
from svv.io.scene_file import write_scene_file
from svv.job.looks import file
from svv.job.looks.look import Look
from svv.options.making import PaintOptions
from svv.styles.families import areas_of, divisions, names_of
from svv.styles.hand import measure_hand
from svv.train.paint import dividing
from svv.train.paint.dividing import Division, divided
from svv.train.paint.ink import Ink, StyleInput
from svv.train.paint.pairing import Glimpse, paired
from svv.train.paint.plan import ordered, with_hands
from svv.train.pipeline import stylize_scene
from tests.cube import cube_scene

pytestmark = pytest.mark.usefixtures("broad_strokes")
Picture = NDArray[np.float32]
LETTERS = st.text("abcdefghijklmnopqrstuvwxyz-", min_size=1, max_size=12)


def bands(*colours: Sequence[float], seed: int = 0) -> Picture:
    """A picture of broken colours one above the other, the first at the top."""
    rows = np.repeat(np.array(colours, np.float32), [40, *[24] * (len(colours) - 1)], 0)[:, None] + np.zeros(
        (1, 80, 1), np.float32
    )
    return (rows + np.random.default_rng(seed).normal(0.0, 0.04, rows.shape)).clip(0.0, 1.0).astype(np.float32)


FOUR = bands((0.5, 0.7, 0.95), (0.95, 0.9, 0.5), (0.7, 0.2, 0.15), (0.1, 0.15, 0.1))


def parts(scene: Scene, picture: Picture = FOUR, mask: NDArray[np.bool_] | None = None, **how: Any) -> Division:
    """The division of one picture."""
    return divided(scene, [StyleInput(picture, "bands", mask)], PaintOptions(**how))


@settings(max_examples=6)
@given(st.integers(0, 99), st.integers(1, 5), st.sampled_from(["areas", "colours"]), st.booleans())
def test_families_have_each_stroke_once_and_areas_are_disjoint(seed: int, count: int, way: Any, masked: bool) -> None:
    rng = np.random.default_rng(seed)
    picture = bands(*rng.random((int(rng.integers(1, 5)), 3)).tolist(), seed=seed)
    mask = np.zeros(picture.shape[:2], bool)
    mask[: len(picture) // 2, 10:60] = True
    hand = measure_hand(picture, mask if masked else None)
    (families,) = divisions(picture, hand, [count], [way])
    assert 1 <= len(families) <= count
    assert (np.sum([one.own for one in families], 0) == 1).all()
    areas = areas_of(picture, families, mask if masked else None)
    assert (np.sum(areas, 0) == (mask if masked else 1)).all()
    firsts = [words[0] for words in names_of(families)]
    assert len(set(firsts)) == len(firsts)


@settings(max_examples=6)
@given(st.integers(0, 999), st.permutations(range(4)))
def test_pairs_move_with_the_regions(seed: int, order: list[int]) -> None:
    rng = np.random.default_rng(seed)
    together = rng.random((4, 4))
    seen, encloses = rng.dirichlet(np.ones(4)), np.triu(rng.random((4, 4)) > 0.5, 1)
    colours = rng.uniform((10.0, -60.0, -60.0), (90.0, 60.0, 60.0), (4, 3))
    glimpse = Glimpse(seen, np.maximum(together, together.T), encloses, colours)
    (families,) = divisions(FOUR, measure_hand(FOUR), [4], ["colours"])
    pairs, moved = paired(glimpse, families), paired(glimpse.of(order), families)
    assert moved == {place: pairs[region] for place, region in enumerate(order)}


@given(st.dictionaries(st.integers(0, 40), st.one_of(st.integers(0, 40), LETTERS), min_size=1))
def test_a_mapping_is_read_as_it_is_written(mapping: dict[int, int | str]) -> None:
    text = ",".join(f"{region}={value}" for region, value in mapping.items())
    read = {region: int(v) if str(v).isdigit() else v for region, v in mapping.items()}
    if text.lower() not in ("colour", "color"):
        assert parse_mapping(text) == read


@given(st.text(max_size=20))
def test_any_text_is_a_mapping_or_refused_in_a_sentence(text: str) -> None:
    found = None
    with contextlib.suppress(BadInput):
        found = parse_mapping(text)
    if found is None:
        with pytest.raises(BadInput, match=r"is not a mapping; write|names a region twice\.$"):
            parse_mapping(text)
    else:
        assert found == "colour" or all(isinstance(region, int) and value != "" for region, value in found.items())


def test_regions_have_parts_of_their_own_and_no_gives_all_the_whole(cube: Scene) -> None:
    found = parts(cube)
    assert sorted(found.shares) == [0, 1, 2] and len({one["part"] for one in found.shares.values()}) == 3
    assert found.options.mapping is not None and not isinstance(found.options.mapping, str)
    assert sorted(found.options.mapping.values()) == [0, 1, 2]
    again = parts(cube)  # as when a painting is resumed
    assert all(
        np.array_equal(np.asarray(a.mask), np.asarray(b.mask)) for a, b in zip(found.inputs, again.inputs, strict=True)
    )
    assert again.options == found.options and again.shares == found.shares
    plain = parts(cube, divide="no")
    assert plain.shares == {} and [s.mask for s in plain.inputs] == [None]
    order = with_hands(ordered(cube, plain.inputs, plain.options), "strokes")
    whole = measure_hand(FOUR)
    for hand in order.hands.values():
        for name in ("colours", "places", "tones", "angles", "palette", "inks"):
            assert getattr(hand, name).tobytes() == getattr(whole, name).tobytes()


def test_the_colours_of_a_mask_never_leave_it(cube: Scene) -> None:
    mask = np.zeros(FOUR.shape[:2], bool)
    mask[:64] = True  # the blue and the yellow band
    found = parts(cube, mask=mask)
    assert all(one.mask is not None and not (one.mask & ~mask).any() for one in found.inputs)
    order = with_hands(ordered(cube, found.inputs, found.options), "strokes")
    inside = {tuple(colour) for colour in measure_hand(FOUR, mask).colours.tolist()}
    for hand in order.hands.values():
        assert {tuple(colour) for colour in hand.colours.tolist()} <= inside


def test_naming_a_part_leaves_the_others_as_they_are_found(cube: Scene) -> None:
    free = parts(cube)
    names = free.shares[0]["parts"]
    assert "sky" not in names  # it is a place's name, beside that of the colour
    for name in names:
        found = parts(cube, mapping={1: name})
        assert found.shares[1]["part"] == name and sorted(found.shares) == [0, 1, 2]
        assert found.shares[0]["parts"] == names
    assert parts(cube, mapping={1: "SKY"}).shares[1]["part"] == parts(cube, mapping={1: "0: sky"}).shares[1]["part"]
    every = parts(cube, mapping={0: names[0], 1: names[1], 2: names[2]})
    assert [every.shares[k]["part"] for k in range(3)] == names[:3]
    both = parts(cube, mapping={0: names[0], 1: names[0]})
    assert any("Region 0 and Region 1 have the same part of bands" in note for note in both.notes)
    assert sorted(parts(cube, mapping={0: names[0], 2: 0}).shares) == [0, 2]  # with numbers, others are not painted
    assert parts(cube, mapping={0: np.int64(0)}).shares == {}


@pytest.mark.parametrize(("how", "words"), [
    ({"mapping": {0: "nonsense"}}, "bands has no part called 'nonsense'; its parts are "),
    ({"mapping": {0: "x:sky"}}, "begin with the picture's number, such as 0=0:sky"),
    ({"mapping": {0: "3:sky"}}, "There is no style 3"),
    ({"mapping": {7: "sky"}}, "There is no region 7"),
    ({"mapping": {0: "sky"}, "divide": "no"}, "leave out --divide no"),
    ({"mapping": {0: "sky"}, "keep": (0,)}, "both kept and styled"),
])  # fmt: skip
def test_what_names_no_part_is_one_sentence(cube: Scene, how: dict[str, Any], words: str) -> None:
    with pytest.raises(BadInput, match=words) as raised:
        parts(cube, **how)
    assert str(raised.value).endswith(".") and "\n" not in str(raised.value)


def test_a_name_of_several_parts_is_refused_with_theirs() -> None:
    with pytest.raises(BadInput, match=r"bands has several parts called 'Sky': name one of them, red or blue\.$"):
        dividing._family("Sky", [["red", "sky"], ["blue", "sky"], ["green"]], "bands")


def test_several_pictures_and_inks_need_to_be_said(cube: Scene) -> None:
    two = [StyleInput(FOUR, "bands"), StyleInput(Ink("hatching"))]
    with pytest.raises(BadInput, match="could be a part of any of 2 pictures: write --map 0=0:sky"):
        divided(cube, two, PaintOptions(mapping={0: "sky"}))
    with pytest.raises(BadInput, match="ink:hatching has no parts to name: leave out 'sky'"):
        divided(cube, two, PaintOptions(mapping={0: "1:sky"}))
    found = divided(cube, two, PaintOptions())  # regions 0 and 2 share the picture
    assert sorted(found.shares) == [0, 2] and [isinstance(s.style, Ink) for s in found.inputs].count(True) == 1


def test_a_hidden_region_takes_no_part(cube: Scene) -> None:
    found = parts(cube.hidden(1))
    assert sorted(found.shares) == [0, 2]
    used = [found.inputs[found.options.mapping[k]] for k in range(3)]  # type: ignore[index]
    assert used[1].mask is None and not used[1].divided
    assert parts(cube.hidden(0, 1)).shares == {}
    assert sorted(parts(cube.hidden(1), mapping={1: "sky"}).shares) == [0, 1, 2]


def test_one_region_has_the_whole_picture(cube: Scene) -> None:
    assert parts(cube, keep=(0, 1)).shares == {} and parts(cube, mapping={2: 0}).shares == {}
    assert parts(cube, mapping={2: 0}).inputs[0].mask is None


def test_too_few_colours_are_shared_or_not_divided(cube: Scene) -> None:
    flat = np.full((48, 64, 3), 0.6, np.float32)
    found = parts(cube, flat)
    assert found.shares == {} and found.notes == ["bands has one colour only, so it was not divided among the regions."]
    with pytest.raises(BadInput, match="no part called 'sky'"):
        parts(cube, flat, mapping={0: "sky"})
    two = bands((0.9, 0.1, 0.1), (0.1, 0.2, 0.8))
    for how in ("auto", "areas", "colours"):
        assert sorted(parts(cube, two, divide=how).shares) == [0, 1, 2]
    grey = bands((0.1,) * 3, (0.45,) * 3, (0.8,) * 3)
    shades = {one["part"]: np.mean([int(code[1:3], 16) for code in one["colours"]]) for one in
              parts(cube, grey).shares.values()}  # fmt: skip
    assert len(shades) == 3


def test_twelve_regions_of_one_colour_are_divided(cube: Scene) -> None:
    scene = cube
    for number in range(9):
        scene = scene.with_part(number % 3, 0.1 * (1 + number // 3))
    for number in range(len(scene.regions)):
        scene = scene.edited(number, (0.8, 0.2, 0.2))
    found = parts(scene)
    assert len(scene.regions) == 12 and sorted(found.shares) == list(range(12))
    assert any("have the same part of bands" in note for note in found.notes)


@pytest.mark.parametrize(
    "shape", [(16, 400), *(pytest.param(shape, marks=pytest.mark.slow) for shape in ((8, 8), (300, 9)))]
)
def test_pictures_of_any_shape_are_divided(cube: Scene, shape: tuple[int, int]) -> None:
    picture = np.random.default_rng(0).random((*shape, 3)).astype(np.float32)
    found = parts(cube, picture)
    assert sorted(found.shares) == [0, 1, 2] and all(one.mask is not None and one.mask.any() for one in found.inputs)
    with_hands(ordered(cube, found.inputs, found.options), "strokes")


@pytest.fixture(scope="module")
def painted(cube: Scene, broad_strokes: None) -> tuple[Scene, Any]:
    """The cube with the parts of a picture, in pieces, which takes less time."""
    return stylize_scene(cube, [StyleInput(FOUR, "bands")], "draft", manner="pieces")


def test_a_part_stays_with_the_region_that_keeps_its_paint(painted: tuple[Scene, Any]) -> None:
    scene, report = painted
    free = next(part for part in report["divided"]["0"]["parts"]
                if part not in {one["part"] for one in report["divided"].values()})  # fmt: skip
    style = [StyleInput(FOUR, "bands")]
    more, told = stylize_scene(scene, style, "draft", manner="pieces", go_on=True, mapping={0: free})
    assert told["styles"] == {"0": "bands"} and told["divided"]["0"]["part"] == free
    for region in ("1", "2"):
        assert told["divided"][region] == report["divided"][region]
    kept = more.made["stylized"]["kept"]
    assert kept["laid"]["0"]["style"] == f"bands ({free})" and set(kept["laid"]) == {"0", "1", "2"}


@pytest.mark.slow
def test_a_look_keeps_parts_and_divides_anew_for_other_regions(
    cube: Scene, painted: tuple[Scene, Any], tmp_path: Path
) -> None:
    scene = Scene.from_bytes(painted[0].to_bytes())
    look = Look.of(scene)
    look.save(tmp_path / "look.json")
    look = Look.load(tmp_path / "look.json")
    for region, one in painted[1]["divided"].items():
        style = look.styles[str(look.regions[int(region)].style)]
        assert style.name == f"bands ({one['part']})" and style.divided and style.measured is None
    before = parts(cube, manner="pieces")
    for region, number in before.options.mapping.items():  # type: ignore[union-attr]
        mask = before.inputs[number].mask  # type: ignore[index]
        assert np.array_equal(np.asarray(look.styles[str(look.regions[region].style)].mask), np.asarray(mask))
    exact = {name: replace(style, style=FOUR) for name, style in look.styles.items()}  # not what a JPEG makes of it
    again = replace(look, styles=exact).applied(cube, preset="draft")
    camera = cube.rig.orbit(9, 40, [3])[0]
    assert np.abs(painted[0].render(camera).rgba - again.scene.render(camera).rgba).max() < 1e-6
    other = cube_scene().with_part(0, 0.5).edited(3, name="another", colour=(0.4, 0.4, 0.1))
    other = replace(other, regions=tuple(replace(r, part_of=None) for r in other.regions))
    matches = look.matched(other)
    whole = matches.divided_anew(look)
    assert whole is not None and whole.name == "bands" and whole.mask is None and matches.left == (3,)
    assert "gets a part of the look's picture" in matches.describe(look, other)[-1]
    assert look.matched(other, {3: 0}).divided_anew(look) is None  # the user has paired them
    assert look.matched(cube).divided_anew(look) is None


def test_a_part_in_a_look_is_data_that_is_checked(painted: tuple[Scene, Any]) -> None:
    told = file.to_json(Look.of(painted[0]))
    name = next(iter(told["styles"]))
    told["styles"][name]["part"] = "/etc/passwd"
    with pytest.raises(BadInput, match="never read from paths"):
        file.from_json(told, "it")


@pytest.mark.parametrize("told", [[], {"x": {}}, {"0": {}}, {"0": 1}, {"-1": {}}, {"0": {"colours": ["red;}"]}}])
def test_damaged_records_of_parts_are_one_sentence(painted: tuple[Scene, Any], told: Any, tmp_path: Path) -> None:
    header, tensors = painted[0].to_arrays()
    good = painted[1]["divided"]["0"]
    damaged = {k: {**good, **v} if isinstance(v, dict) and v else v for k, v in told.items()} if told else told
    header["made"]["stylized"] = {**header["made"]["stylized"], "divided": damaged}
    write_scene_file(tmp_path / "a.svv", header, tensors)
    with pytest.raises(BadInput, match=r"a\.svv"):
        Scene.load(tmp_path / "a.svv")


@pytest.mark.parametrize(
    ("terminal", "plain", "coloured"), [(True, False, True), (True, True, False), (False, False, False)]
)
def test_swatches_are_blocks_where_colours_are_shown(
    cube: Scene, monkeypatch: pytest.MonkeyPatch, terminal: bool, plain: bool, coloured: bool
) -> None:
    class Screen(io.StringIO):
        def isatty(self) -> bool:
            return terminal

    for name in ("NO_COLOR", "FORCE_COLOR", "TTY_COMPATIBLE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.setenv("COLORTERM", "truecolor")
    if plain:
        monkeypatch.setenv("NO_COLOR", "1")
    screen = Screen()
    monkeypatch.setattr("sys.stderr", screen)
    one = {
        "style": "[bold]a.png",
        "part": "sky",
        "colours": ["#102030", "#405060", "#708090"],
        "share": 0.5,
        "parts": [],
    }
    print_swatches({"0": one, "9": one}, cube.edited(0, name="bone").regions)
    shown = screen.getvalue()
    assert shown.count("\n") == 1 and "bone: sky of [bold]a.png" in shown
    assert ("48;2;16;32;48" in shown) == coloured and ("#102030 #405060 #708090" in shown) != coloured
    assert swatches({"0": one}, cube.regions) == [(one["colours"], "Region 0: sky of [bold]a.png")]


@pytest.mark.slow
def test_python_names_parts(cube: Scene) -> None:
    _, report = svv.stylize_scene(cube, [svv.StyleInput(FOUR, "bands")], "draft", mapping={0: "sky"}, manner="pieces")
    assert report["divided"]["0"]["part"].startswith(("blue", "pale-blue", "teal"))
    assert any("bands is divided among the regions: Region 0 has its" in note for note in report["notes"])


def test_the_page_of_results_shows_the_parts(painted: tuple[Scene, Any], cube: Scene, tmp_path: Path) -> None:
    from svv.job.page import Page, write_page
    from svv.job.result import _shared

    (table,) = _shared(Scene.from_bytes(painted[0].to_bytes()))
    write_page(tmp_path / "page.html", Page("Title", "Text.", (), None, [table]))
    text, one = (tmp_path / "page.html").read_text(), painted[1]["divided"]["0"]
    assert text.count("<i style=") == 9 and all(f'background:{code}"' in text for code in one["colours"])
    assert one["part"] in text and "Region 2" in text and _shared(cube) == []


def test_assistants_name_parts_and_hear_which_there_are(tmp_path: Path) -> None:
    from svv.io.pictures.output import write_png
    from svv.job.workshop import Workshop

    cube_scene().save(tmp_path / "cube.svv")
    write_png(tmp_path / "bands.png", FOUR)
    workshop = Workshop(tmp_path)
    with pytest.raises(BadInput, match="bands has no part called 'nonsense'; its parts are"):
        workshop.stylize("cube.svv", ["bands.png"], "a.svv", "draft", parts={"0": "nonsense"})
    with pytest.raises(BadInput, match="no region's number"):
        workshop.stylize("cube.svv", ["bands.png"], "a.svv", "draft", parts={"x": "sky"})
    with pytest.raises(BadInput, match="leave out --divide no"):
        workshop.stylize("cube.svv", ["bands.png"], "a.svv", "draft", "no", {"0": "sky"})


def test_a_job_takes_parts_and_refuses_them_without_pictures(tmp_path: Path) -> None:
    from svv.cli import app as cli
    from svv.job.steps import JobSettings
    from svv.options.making import SharingOptions

    settings_ = JobSettings(sharing=SharingOptions({0: "sky"}, "areas"))
    assert settings_.paint.mapping == {0: "sky"} and settings_.paint.divide == "areas"
    with pytest.raises(BadInput, match="give --style, or leave them out"):
        cli.app(["run", "x.vti", "--map", "0=sky", "--out", str(tmp_path / "o")], standalone_mode=False)


def test_svv_run_prints_which_part_each_region_has(
    cube: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def run_job(*_: object) -> Path:
        cube.save(tmp_path / "styled.svv")
        part = {"style": "a.png", "part": "sky", "colours": ["#102030", "#405060", "#708090"]}
        write_json(tmp_path / "stylize.json", {"notes": ["a.png is divided."], "divided": {"1": part}})
        return tmp_path / "report.html"

    from svv.cli import app as cli

    monkeypatch.setattr("svv.job.run.run_job", run_job)
    monkeypatch.setattr("svv.job.run.check", lambda settings: None)
    np.save(tmp_path / "v.npy", np.zeros((4, 4, 4), np.float32))
    write_png(tmp_path / "a.png", np.zeros((8, 8, 3), np.float32))
    given = ["run", str(tmp_path / "v.npy"), "--style", str(tmp_path / "a.png"), "--out", str(tmp_path)]
    cli.app(given, standalone_mode=False)
    said = capfd.readouterr()
    assert said.out.strip() == str(tmp_path / "report.html")
    assert "a.png is divided.\n" in said.err and "Region 1: sky of a.png" in said.err
