"""Figures: their files, legends, scale bars and axes, and what cannot be drawn."""

from __future__ import annotations

import re
import zlib
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import svv
from svv.cli import app as cli
from svv.core.colour.light import Lamp
from svv.core.geometry.cameras import Camera, look_at
from svv.errors import BadInput
from svv.fields.scene.scene import Scene
from svv.fields.scene.seen_colours import Pair, seen_in, seen_of
from svv.options.figures import JOURNALS, FigureOptions
from svv.render.figures.annotations import bar_of, format_length
from svv.render.figures.colour_check import describe_lookalikes, report_on, seen_in_picture
from svv.render.figures.figure import Panel, _front, drawing_of
from svv.render.figures.files import KINDS, pixels_of, write_figure
from svv.render.figures.framing import (
    Window,
    camera_through,
    free_corner,
    parallel,
    preview_camera,
    together,
    windows_of,
)
from svv.render.figures.layout import laid_out
from svv.render.figures.lettering import Lettering, families_for
from svv.render.figures.swatches import Entry, _towards, format_ranges, swatch
from svv.render.frames import orbit, seen_from
from tests.cube import cube_paint
from tests.nightly import nightly

pytest.importorskip("matplotlib")

pytestmark = pytest.mark.filterwarnings("ignore:Regions look alike")  # those of the cube do

SMALL: Any = {"dpi": 50, "width": 60.0}
"""Options of a figure that is drawn in little time."""


@pytest.fixture(autouse=True)
def small_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Swatches and previews are cut from small pictures, which take little time."""
    monkeypatch.setattr("svv.render.figures.figure.SWATCH_VIEW", 48)
    monkeypatch.setattr("svv.render.figures.swatches.LIGHT_VIEW", 24)
    monkeypatch.setattr("svv.render.figures.framing.PREVIEW", 64)


def texts_of(figure: Any) -> list[str]:
    """All that is written in a figure."""
    from matplotlib.text import Text

    return [text.get_text() for text in figure.findobj(Text) if text.get_text()]


def entry(name: str, values: str = "1 to 2 HU") -> Entry:
    return Entry(0, name, values, np.ones((8, 8, 4), np.float32))


@pytest.fixture(scope="module")
def named(cube: Scene) -> Scene:
    return cube.edited(0, name="bone").edited(1, name="soft tissue")


def test_a_figure_says_what_is_in_it(named: Scene) -> None:
    figure = svv.figure(named, None, unit="mm", value_unit="HU", **SMALL)
    texts = texts_of(figure)
    assert {"bone", "soft tissue", "Region 2", "x", "y", "z"} <= set(texts)
    assert any(re.fullmatch(r"[125]0*|0\.0*[125]", t.removesuffix(" mm")) for t in texts if t.endswith(" mm"))
    assert not {"a", "b"} & set(texts), "one panel needs no letter"


def test_pixels_too_small_to_see_have_one_ray(cube: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, sizes = cube.painted(cube_paint(cube, 1), {0: "oil"}, {}, "oil"), list[int]()
    render = Scene.render

    def noted(self: Scene, camera: Camera, *rest: Any) -> Any:
        sizes.append(camera.width)
        return render(self, camera, *rest)

    monkeypatch.setattr(Scene, "render", noted)
    monkeypatch.setattr("svv.render.supersampled.shows_strokes", lambda scene: True)
    last = []
    for dpi in (300, 600):
        svv.figure(scene, None, width=20.0, dpi=dpi, legend="none", scale_bar=False, axes="none")
        last.append(sizes[-1])
    assert last[0] == pytest.approx(last[1], abs=2), "as many rays along an inch of 300 dpi as of 600"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"unit": "a\nb"}, "The unit is one line of text, without the control character U\\+000A"),
        ({"unit": "m" * 300}, "The unit has at most 20 characters"),
        ({"unit": "\ud800"}, "U\\+D800"),
        ({"value_unit": "a\nb"}, "The unit of the values is one line"),
        ({"title": ("a\x07",)}, "Title 0 is one line"),
        ({"background": (2.0, 0.0, 0.0)}, "is no background: give red, green and blue"),
        ({"background": (float("nan"), 0.0, 0.0)}, "is no background"),
        ({"axes": "x,\u202e,z"}, "The name of an axis is one line"),
    ],
)
def test_texts_are_lines(cube: Scene, changes: dict[str, Any], words: str) -> None:
    with pytest.raises(BadInput, match=words):
        svv.figure(cube, None, **SMALL, **changes)
    with pytest.raises(BadInput, match="title of a panel is one line"):
        svv.figure(svv.Panel(cube, title="a\nb"), None, **SMALL)


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_of_file(named: Scene, tmp_path: Path, kind: str) -> None:
    file = tmp_path / f"figure{kind}"
    svv.figure(named, file, unit="µm", transparent=True, **SMALL)
    content = file.read_bytes()
    assert [path.name for path in tmp_path.iterdir()] == [file.name]
    if kind == ".svg":
        text = content.decode()
        assert re.search(r"<text[^>]*>soft tissue<", text) and "font/woff;base64," in text
        assert '<path d="M 0 ' not in text.split("</style>")[1][:300], "no rectangle lies behind a transparent figure"
    elif kind == ".pdf":
        streams = re.findall(rb"stream\r?\n(.*?)\r?\nendstream", content, re.S)
        assert b"/FontFile2" in content and b"DejaVuSans" in content and b"/Type3" not in content
        inside = b"".join(zlib.decompressobj().decompress(s) for s in streams if s[:1] == b"x")
        assert b"BT" in inside and b"TJ" in inside
    else:
        with Image.open(file) as picture:
            assert picture.size[0] == round(60 / 25.4 * 50) and picture.mode == "RGBA"
            assert [round(float(x)) for x in picture.info["dpi"]] == [50, 50]
            assert np.asarray(picture)[0, 0, 3] == 0
    before = content
    svv.figure(named, file, unit="µm", transparent=True, **SMALL)
    assert file.read_bytes() == before, "the same figure is the same file"


def test_an_opaque_figure_has_no_alpha_and_dark_ones_white_text(named: Scene, tmp_path: Path) -> None:
    figure = svv.figure(named, tmp_path / "a.tif", background=(0.0, 0.0, 0.0), **SMALL)
    with Image.open(tmp_path / "a.tif") as picture:
        assert picture.mode == "RGB" and np.asarray(picture)[0, 0].tolist() == [0, 0, 0]
    assert all(text.get_color() == "#ffffff" for text in figure.texts)


def test_a_picture_is_placed_without_being_sampled_again(cube: Scene) -> None:
    """The pixels of a panel are those of the scene's own picture."""
    figure = svv.figure(cube, legend="none", axes="none", scale_bar=False, letters="none", **SMALL)
    shown = pixels_of(figure)
    camera = orbit(cube, 181, 800, 800)[90]
    (window,) = windows_of([cube.while_moving().render(preview_camera(camera), "pcn").rgba[..., 3]], True)
    rows, columns = np.nonzero((shown != 255).any(2))
    width = round(58 / 25.4 * 50)
    own = cube.render(camera_through(camera, window, width, round(58 * window.aspect / 25.4 * 50)), None, (1, 1, 1))
    expected = np.rint(own.rgba[..., :3] * 255).astype(np.uint8)
    left = top = round(50 / 25.4)
    np.testing.assert_array_equal(shown[top : top + len(expected), left : left + width], expected)
    assert len(rows) and len(columns)


def test_scenes_of_one_volume_have_one_scale(cube: Scene) -> None:
    """Their own cameras stand as far away as each needs; scenes elsewhere, or of other sizes, keep their own."""
    nearer = replace(cube, camera_rig=replace(cube.rig, radius=0.8 * cube.rig.radius))
    cameras: list[Any] = [panel.camera for panel in drawing_of([nearer, cube], width=60.0).panels]
    cameras += [panel.camera for panel in drawing_of(cube, width=60.0).panels]
    assert all(np.array_equal(one.camera_to_world, cameras[-1].camera_to_world) for one in cameras)
    assert len({one.fov_x for one in cameras}) == 1
    for rig in (replace(cube.rig, radius=0.2 * cube.rig.radius), replace(cube.rig, centre=(90.0, 0.0, 0.0))):
        apart = replace(cube, camera_rig=rig)
        assert _front([Panel(apart), Panel(cube)]) is None


def test_panels_have_letters_titles_and_one_scale(named: Scene, tmp_path: Path) -> None:
    painted = named.painted(cube_paint(named, 1), {0: "oil"}, {}, "oil")
    figure = svv.figure([named, painted], title=("before", "after"), across=2, **(SMALL | {"width": 120.0}))
    texts = texts_of(figure)
    assert [t for t in texts if t in ("a", "b")] == ["a", "b"] and {"before", "after"} <= set(texts)
    assert texts.count("bone") == 2, "panels that look different have legends of their own"
    alike = svv.figure(
        [svv.Panel(named), svv.Panel(named, seen_from(named, 90.0, 0.0, 80, 80))], letters="(a)", **SMALL
    )
    assert texts_of(alike).count("bone") == 1 and "(b)" in texts_of(alike)


@pytest.mark.parametrize(
    "name",
    nightly(
        ['the "inner" <shell> & more', "$x_1^2$ \\alpha {", "עצם רכה", "عظم", "Ψ⁺ 5′", "☺", "l" * 100, "a b " * 25],
        'the "inner" <shell> & more', "$x_1^2$ \\alpha {", "עצם רכה", "l" * 100,
    ),
)  # fmt: skip
def test_names_of_all_kinds_stay_what_they_are(cube: Scene, tmp_path: Path, name: str) -> None:
    scene = cube.edited(0, name=name)
    for kind in (".svg", ".pdf", ".png"):
        figure = svv.figure(scene, tmp_path / f"a{kind}", **SMALL)
    assert "".join(name.split()) in "".join("".join(texts_of(figure)).split())


def test_twelve_regions_find_room(cube: Scene) -> None:
    entries = [entry(f"region of number {n}") for n in range(12)]
    lettering = Lettering(families_for([], None), 7.0, "#000000")
    layout = laid_out(FigureOptions(), lettering, 0.8, [entries], False, 1)
    boxes = [line.box for line in layout.legend]
    assert len(boxes) == 12 and all(0 <= b.left and b.left + b.width <= layout.width + 1e-6 for b in boxes)
    assert max(b.top + b.height for b in boxes) <= layout.height
    places = {(round(b.left, 3), round(b.top, 3)) for b in boxes}
    assert len(places) == 12


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"width": 0.0}, "between 20 and 1000 mm, not 0"),
        ({"width": float("nan")}, "between 20 and 1000 mm"),
        ({"dpi": 5000}, "between 50 and 1200 dpi"),
        ({"width": 390.0, "dpi": 1200}, "fewer dpi than 1200"),
        ({"font_size": 90.0}, "between 4 and 40 pt"),
        ({"font_size": 40.0, "width": 30.0}, "The legend needs more|wider than its panel|leaves"),
        ({"font": "No Such Font"}, "no font 'No Such Font' on this machine: leave it out, or name one of"),
        ({"axes": "x,y"}, "three short names"),
        ({"across": 0}, "at least one panel across"),
        ({"network": "styled"}, "no network 'styled', only base, pcn"),
        ({"title": ("one", "two")}, "2 titles for 1 panels"),
        ({"title": ("much too long a title " * 9,)}, "wider than its panel"),
    ],
)
def test_what_cannot_be_drawn_is_one_sentence(cube: Scene, options: dict[str, Any], words: str) -> None:
    with pytest.raises(BadInput, match=words):
        svv.figure(cube, None, **(SMALL | options))


def test_files_and_panels_that_cannot_be(cube: Scene, tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"name a figure .pdf, .svg, .png or .tiff"):
        svv.figure(cube, tmp_path / "a.jpg", **SMALL)
    with pytest.raises(BadInput, match="folder does not exist"):
        svv.figure(cube, tmp_path / "none" / "a.pdf", **SMALL)
    with pytest.raises(BadInput, match="1 to 24 panels, not 0"):
        svv.figure([], **SMALL)
    with pytest.raises(BadInput, match="No installed font has the character '\U000e01ef"):
        families_for(["x\U000e01ef"], None)
    lettering = Lettering(families_for([], None), 7.0, "#000000")
    with pytest.raises(BadInput, match=r"leaves .* for each of 9 panels"):
        laid_out(FigureOptions(across=9), lettering, 1.0, [[entry("bone")]], False, 9)
    with pytest.raises(BadInput, match="mm high, more than 400"):
        laid_out(FigureOptions(), lettering, 30.0, [[]], False, 1)
    with pytest.raises(BadInput, match="legend needs more than the 18 mm"):
        laid_out(
            FigureOptions(width=20.0, legend="below"), replace(lettering, points=12.0), 1.0, [[entry("b")]], True, 1
        )


def test_without_matplotlib_one_sentence_names_the_extra(cube: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(BadInput, match=r"pip install 'svv\[figure\]'"):
        svv.figure(cube)


def test_the_scale_bar_is_as_long_as_it_says(cube: Scene) -> None:
    """Projected onto the panel, the ends of the bar are as far apart as the bar is drawn."""
    camera = seen_from(cube, 20.0, 10.0, 300, 200)
    middle = cube.occupancy.box.bounds.mean(0)
    length, mm = bar_of(camera, middle, 60.0)
    across = camera.camera_to_world[:3, 0] * length
    columns, _, _ = camera.project(np.stack([middle, middle + across]))
    assert mm == pytest.approx((columns[1] - columns[0]) * 60.0 / camera.width, rel=1e-9)
    flat = parallel(camera, middle)
    assert bar_of(flat, middle + 0.3 * camera.camera_to_world[:3, 2], 60.0) == pytest.approx((length, mm), rel=1e-9)
    assert [format_length(1.0, None), format_length(20.0, None), format_length(2e5, "m")] == [
        "1 unit",
        "20 units",
        "2 × 10⁵ m",
    ]


@pytest.mark.parametrize("span", [None, 3.0])
def test_a_window_shows_what_it_is_cut_from(span: float | None) -> None:
    pose = look_at((1.0, 2.0, 4.0), (0.1, 0.0, 0.2))
    camera = Camera(pose, 0.6, 400, 300, span, (180.0, 170.0))
    window = Window(40.0, 30.0, 120.0, 90.0)
    cut = camera_through(camera, window, 480, 360)
    points = np.random.default_rng(0).uniform(-0.3, 0.3, (20, 3))
    whole, part = preview_camera(camera).project(points), cut.project(points)
    np.testing.assert_allclose(part[0], 4.0 * (whole[0] - 40.0), atol=1e-6)
    np.testing.assert_allclose(part[1], 4.0 * (whole[1] - 30.0), atol=1e-6)


def test_annotations_stand_where_nothing_is_visible() -> None:
    alpha = np.zeros((100, 100))
    alpha[60:, :50] = 1.0
    whole = Window(0.0, 0.0, 100.0, 100.0)
    assert free_corner(alpha, whole, (0.3, 0.3), []) == "lower right"
    assert free_corner(alpha, whole, (0.3, 0.3), ["lower right"]) == "upper left"
    assert free_corner(np.ones((100, 100)), whole, (0.3, 0.3), []) is None
    assert free_corner(np.ones((100, 100)), whole, (0.3, 0.3), [], strip=0.3) == "lower left"


def test_a_crowded_panel_gets_a_strip_for_its_annotations(cube: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    full = np.ones((200, 320), np.float32)
    monkeypatch.setattr("svv.render.figures.figure.Drawing._preview", lambda self, panel: full)
    crowded = svv.figure(cube, frame="camera", legend="none", **SMALL).get_figheight()
    plain = svv.figure(cube, frame="camera", legend="none", axes="none", scale_bar=False, **SMALL).get_figheight()
    assert crowded > plain + 4 / 25.4


def test_a_swatch_has_the_regions_colour_light_and_ink(cube: Scene) -> None:
    camera = orbit(cube, 181, 120, 120)[90]
    picture = swatch(cube, 0, camera, "pcn", 40, 10.0)
    assert picture is not None
    red = cube.edited(0, colour=(0.1, 0.2, 0.9))
    other = swatch(red, 0, camera, "pcn", 40, 10.0)
    assert other is not None and other[20, 20, 2] > other[20, 20, 0]
    assert picture[0, 0, 3] == 0.0 and picture[20, 20, 3] > 0.4
    inked = swatch(cube.with_outline(1.0, 0, colour=(0.0, 0.0, 0.0)), 0, camera, "pcn", 40, 10.0)
    assert inked is not None and inked[20, 1, :3].max() < picture[20, 1, :3].max() - 0.05
    assert swatch(cube.hidden(0), 0, camera, "pcn", 40, 10.0) is not None, "it shows what the region would look like"


def test_the_light_of_a_swatch_is_that_of_the_scene() -> None:
    camera = Camera(look_at((0.0, 0.0, 4.0), (0.0, 0.0, 0.0)), 0.5, 10, 10)
    np.testing.assert_allclose(_towards(Lamp(), camera), (0.0, 0.0, 1.0), atol=1e-12)
    np.testing.assert_allclose(_towards(Lamp(90.0, 0.0), camera), (1.0, 0.0, 0.0), atol=1e-12)
    np.testing.assert_allclose(_towards(Lamp(direction=(0.0, 2.0, 0.0)), camera), (0.0, 1.0, 0.0), atol=1e-12)


def test_values_and_units() -> None:
    assert format_ranges((), "HU") == "" and format_ranges(((1.0, 2.0),), None) == "1 to 2"


def alike(scene: Scene, **options: Any) -> Any:
    """A figure of a scene, with what is told of it."""
    said: list[str] = []
    return drawing_of(scene, None, tell=said.append, **(SMALL | options)), said


def test_a_legend_names_regions_that_look_alike(named: Scene, balls: Scene) -> None:
    """Two white regions are alike, balls of other colours are not; without a legend, it is told all the same."""
    white = named.edited(0, colour=(1.0, 1.0, 1.0)).edited(1, colour=(1.0, 1.0, 1.0)).hidden(2)
    for legend in ("right", "below", "none"):
        drawing, said = alike(white, legend=legend)
        written = "bone and soft tissue look alike" in " ".join(texts_of(drawing.figure))
        assert written == (legend != "none")
        assert len(said) == 1 and said[0].startswith("Regions look alike: bone and soft tissue ")
        (pair,) = drawing.report()["legends"][0]["look_alike"]
        assert (pair["first"], pair["second"]) == ("bone", "soft tissue") and pair["difference"] < 12.0
    for scene in (balls, white.hidden(1), replace(named, palette_network=None, regions=())):
        drawing, said = alike(scene)
        assert not said and "look alike" not in " ".join(texts_of(drawing.figure))
        assert drawing.report()["legends"][0]["look_alike"] == []


def test_a_figures_differences_are_those_of_check_colours(named: Scene, tmp_path: Path) -> None:
    """Of its scene from all around, and of its own file; the remark has the smaller of both."""
    painted = named.painted(cube_paint(named, 1), {0: "oil"}, {}, "oil")
    drawing = drawing_of(painted, tmp_path / "a.png", tell=lambda said: None, **SMALL)
    (panel,), (legend,) = drawing.report()["panels"], drawing.report()["legends"]
    assert panel["from_all_around"] == report_on(list(seen_in(painted).values()))
    (seen,) = seen_in_picture(tmp_path / "a.png")
    smallest = []
    for told, again in ((panel["colours"], report_on(seen)), (panel["from_all_around"], panel["from_all_around"])):
        ours, theirs = (one["smallest"]["normal"] for one in (told, again))
        assert (
            ours["difference"] == pytest.approx(theirs["difference"], abs=0.05) and ours["between"] == theirs["between"]
        )
        smallest.append(ours["difference"])
    assert legend["look_alike"][0]["difference"] == min(smallest)


@pytest.mark.parametrize(
    ("pairs", "said"),
    [
        ("", ""),
        ("ab", "a and b look alike"),
        ("ab bc ac", "a, b and c look alike"),
        ("ab bc", "a and b look alike; b and c look alike"),
        ("ab cd ef gh", "a and b look alike; c and d look alike; e and f look alike; others look alike, too"),
        (" ".join(map("".join, combinations("abcdefghijkl", 2))), "a, b, c, d, e, f, g, h, i, j, k and l look alike"),
    ],
)
def test_look_alikes_are_said_in_few_words(pairs: str, said: str) -> None:
    assert describe_lookalikes([Pair(pair[0], pair[1], "normal", 5.0) for pair in pairs.split()]) == said


def test_a_region_of_clear_pixels_has_no_colours(cube: Scene) -> None:
    picture = cube.render(orbit(cube, 181, 24, 24)[90], "pcn")
    clear = replace(picture, rgba=np.where(picture.region[..., None] == 1, 0.0, picture.rgba).astype(np.float32))
    assert sorted(seen_of(cube, [clear], (1.0, 1.0, 1.0))) == [0, 2]


def test_a_remark_has_room_in_legends_of_all_kinds() -> None:
    lettering = Lettering(families_for([], None), 7.0, "#000000")
    entries = [entry(f"region of number {n}") for n in range(12)]
    remark = "region of number 1 and region of number 2 look alike; " * 3
    for options, legends in (
        (FigureOptions(legend="right"), [entries]), (FigureOptions(legend="below"), [entries]),
        (FigureOptions(), [entries, entries[:1]]),
    ):  # fmt: skip
        layout = laid_out(options, lettering, 0.8, legends, True, len(legends), [remark] * len(legends))
        lines = [line for line in layout.legend if line.entry is None]
        assert len(lines) == len(legends)
        for line in layout.legend:
            assert line.box.top + line.box.height <= layout.height
            assert line.box.left + max(map(lettering.width, line.name)) <= layout.width
        for line in lines:
            others = [o.box for o in layout.legend if o.entry is not None and o.box.left >= line.box.left]
            assert all(line.box.top >= o.top + o.height for o in others if o.left < line.box.left + line.box.width)


def test_panels_of_one_camera_are_trimmed_alike(cube: Scene) -> None:
    left, right = np.zeros((20, 30), np.float32), np.zeros((20, 30), np.float32)
    left[5:9, 3:8], right[8:15, 20:22] = 1.0, 0.5
    camera, other = (seen_from(cube, angle, 0.0, 30, 20) for angle in (0.0, 5.0))
    one, two, alone = together([left, right, left], [camera, camera.resized(30, 20), other])
    np.testing.assert_array_equal(one, np.maximum(left, right))
    np.testing.assert_array_equal(one, two)
    np.testing.assert_array_equal(alone, left)


def test_the_widths_of_journals() -> None:
    assert all(FigureOptions(journal=j).mm == w[0] for j, w in JOURNALS.items())  # type: ignore[arg-type]
    assert FigureOptions(columns="double").mm == 183.0 and FigureOptions(width=70.0).mm == 70.0


def test_views_from_the_side(cube: Scene) -> None:
    front = orbit(cube, 181, 64, 64)[90]
    np.testing.assert_allclose(seen_from(cube, 0.0, 0.0, 64, 64).camera_to_world, front.camera_to_world, atol=1e-9)
    for angles, axis in (((90.0, 0.0), 0), ((0.0, 90.0), 1)):
        camera = seen_from(cube, *angles, 64, 64)
        np.testing.assert_allclose(camera.camera_to_world[:3, 2], front.camera_to_world[:3, axis], atol=1e-9)


@pytest.fixture
def run(cube: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    monkeypatch.chdir(tmp_path)
    cube.save("cube.svv")
    return lambda *arguments: cli.app(list(arguments), prog_name="svv", standalone_mode=False)


def test_the_command(run: Callable[..., None], capsys: pytest.CaptureFixture[str]) -> None:
    run("figure", "cube.svv", "--view", "0,0", "--view", "90,10", "--width", "80", "--dpi", "60", "--out", "a.png")
    said = capsys.readouterr()
    assert said.out.endswith("a.png\n") and "--parallel makes it hold everywhere" in said.err
    run("check-colours", "a.png")
    checked = capsys.readouterr().out
    assert "panel a" in checked and "panel b" in checked and "Region 0" in checked
    run("figure", "cube.svv", "--parallel", "--dpi", "60", "--out", "b.svg")
    assert "--parallel" not in capsys.readouterr().err
    with pytest.raises(BadInput, match="no time steps"):
        run("figure", "cube.svv", "--time", "1", "--out", "c.png")
    with pytest.raises(BadInput, match="degrees to the right, from -180 to 180"):
        run("figure", "cube.svv", "--view", "270,0", "--out", "c.png")


def test_a_figure_of_ones_own_is_written_whole(cube: Scene, tmp_path: Path) -> None:
    figure = svv.figure(cube, **SMALL)
    figure.text(0.5, 0.5, "mine")
    write_figure(figure, tmp_path / "a.svg")
    assert ">mine<" in (tmp_path / "a.svg").read_text()


def test_files_of_figures_say_what_they_show(named: Scene, tmp_path: Path) -> None:
    words = "A rendering of 3 regions: bone, soft tissue, region 2"
    figure = svv.figure([named, named], tmp_path / "a.svg", **SMALL)
    svv.figure(named, tmp_path / "a.png", **SMALL)
    svv.figure(named, tmp_path / "a.pdf", **SMALL)
    assert f"<title>{words}</title>" in (tmp_path / "a.svg").read_text()
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.info["Description"] == words
    assert f"/Subject ({words})".encode() in (tmp_path / "a.pdf").read_bytes()
    figure.set_label("My own <words>")
    write_figure(figure, tmp_path / "b.svg")
    assert "<title>My own &lt;words&gt;</title>" in (tmp_path / "b.svg").read_text()
