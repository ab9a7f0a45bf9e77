"""Looks: saved from one scene, given to others, and refused where they are no data of ours."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import svv
from svv.cli import app as cli
from svv.core.colour.light import Lamp
from svv.errors import BadInput
from svv.fields.scene.scene import Scene
from svv.fields.scene.style_pictures import drop_styles
from svv.io.pictures.picture_data import as_data, mask_in, picture_in
from svv.io.scene_file import write_scene_file
from svv.job.looks import file
from svv.job.looks.file import to_json
from svv.job.looks.look import Look
from svv.job.looks.look_content import LookRegion
from svv.options.figures import FigureOptions
from svv.render.frames import seen_from
from svv.train.paint.ink import Ink, StyleInput
from svv.train.pipeline import stylize_scene
from tests.cube import cube_scene, lit_cube_scene

PICTURE = np.random.default_rng(0).random((40, 32, 3)).astype(np.float32)
pytestmark = pytest.mark.usefixtures("broad_strokes")
MASK = np.arange(40 * 32).reshape(40, 32) % 32 < 16


@pytest.fixture(scope="module")
def painted(cube: Scene, broad_strokes: None) -> Scene:
    """The cube with a name, a masked picture, a plain region and an ink."""
    named = cube.edited(0, name="bone", opacity=0.5).edited(1, (0.1, 0.9, 0.8)).with_outline(0.7, 2)
    styles = [StyleInput(PICTURE, "noise", MASK), StyleInput(Ink("stippling"))]
    return stylize_scene(named, styles, "draft", mapping={0: 0, 2: 1}, manner="strokes")[0]


def from_json(content: Any, name: str) -> Look:
    """The look that plain values hold."""
    return Look(**vars(file.from_json(content, name)))


def told(look: Look) -> dict[str, Any]:
    """A look as a file holds it."""
    return json.loads(json.dumps(to_json(look)))


def test_a_scene_keeps_its_style_pictures_in_its_file(painted: Scene, tmp_path: Path) -> None:
    painted.save(tmp_path / "a.svv")
    loaded = Scene.load(tmp_path / "a.svv")
    kept = loaded.made["stylized"]["kept"]
    assert kept == painted.made["stylized"]["kept"]
    assert picture_in(kept["styles"]["noise"]["picture"], "It").shape == PICTURE.shape
    assert (mask_in(kept["styles"]["noise"]["mask"], PICTURE.shape, "It") == MASK).all()
    assert kept["laid"]["0"]["manner"] == "strokes" and kept["laid"]["2"]["style"] == "ink:stippling"
    told = drop_styles(loaded.made)["stylized"]
    assert isinstance(told, dict) and "kept" not in told and "data:image" not in json.dumps(loaded.info())


def test_paintings_share_a_picture_in_the_file_and_lose_it_with_the_painting(painted: Scene) -> None:
    styles = [StyleInput(PICTURE, "noise")]
    two, _ = stylize_scene(painted, styles, "draft", variant="two", mapping={1: 0}, manner="strokes", stroke_size=3.0)
    _, tensors = two.to_arrays()
    assert len([name for name in tensors if name.startswith("picture.")]) == 2  # picture and mask
    loaded = Scene.from_bytes(two.to_bytes()).with_variant("styled")
    assert loaded.made["stylized"]["kept"] == painted.made["stylized"]["kept"]
    assert not [n for n in loaded.without_variant("styled").without_variant("two").to_arrays()[1] if "picture" in n]


def test_pictures_of_the_same_name_are_both_kept(cube: Scene) -> None:
    other = 1.0 - PICTURE
    styles = [StyleInput(PICTURE, "same"), StyleInput(other, "same")]
    scene, _ = stylize_scene(cube, styles, "draft", mapping={0: 0, 1: 1}, manner="strokes", stroke_size=3.0)
    look = Look.of(scene)
    for region, picture in ((0, PICTURE), (1, other)):
        name = look.regions[region].style
        assert name is not None and np.abs(np.asarray(look.styles[name].style) - picture).mean() < 0.2


def test_going_on_keeps_the_pictures_of_both(painted: Scene) -> None:
    styles = [StyleInput(1.0 - PICTURE, "other")]
    more, _ = stylize_scene(painted, styles, "draft", mapping={1: 0}, go_on=True, manner="strokes", stroke_size=2.0)
    look = Look.of(more)
    assert [r.style for r in look.regions] == ["noise", "other", "ink:stippling"]
    assert [r.laid.stroke_size for r in look.regions] == [1.0, 2.0, 1.0]


def test_a_look_gives_the_same_picture_to_the_scene_it_came_from(cube: Scene, painted: Scene, tmp_path: Path) -> None:
    Look.of(painted, title="A look").save(tmp_path / "look.json")
    found = svv.Look.load(tmp_path / "look.json").applied(cube, preset="draft")
    assert [(m.region, m.source) for m in found.matches.pairs] == [(0, 0), (1, 1), (2, 2)]
    camera = seen_from(cube, 20.0, 10.0, 48, 48)
    before, after = painted.render(camera).rgba, found.scene.render(camera).rgba
    assert np.abs(after - before).mean() < 0.02 < np.abs(cube.render(camera).rgba - before).mean()
    assert found.scene.regions[0].name == "bone" and found.scene.history.past[-1].what == "look A look"
    assert found.scene.undone().regions[0].opacity == 1.0


def test_edits_of_any_region_survive_the_file(painted: Scene) -> None:
    scene = painted.with_strokes(0, relief=2.0, width=1.5, light=(1, 2, 3), palette=[(1, 0, 0), (0, 0, 1)])
    scene = scene.with_paint_light(0.9, 2).with_strength(0.4, 0).edited(1, recolour_in="oklab").hidden(1)
    look = from_json(told(Look.of(scene)), "it")
    after = look.applied(scene.reset(), preset="draft").scene
    for own, theirs in zip(scene.regions, after.regions, strict=True):
        assert replace(theirs, mean_light=own.mean_light, style=own.style) == own


def test_a_camera_and_settings_of_figures_fit_other_volumes(cube: Scene) -> None:
    camera = seen_from(cube, 40.0, 20.0, 64, 48)
    look = from_json(
        told(Look.of(cube, camera, FigureOptions(journal="science", unit="mm", background=(0, 0, 0)))), "it"
    )
    assert look.figure == {"journal": "science", "unit": "mm", "background": (0.0, 0.0, 0.0)}
    box = replace(cube.occupancy.box, low=(10.0, 10.0, 10.0), size=2.0)
    other = replace(cube, occupancy=replace(cube.occupancy, box=box))
    moved = look.camera_for(other)
    assert moved is not None and (moved.width, moved.height) == (64, 48)
    middle = np.array(box.bounds).mean(0)
    np.testing.assert_allclose(moved.position - middle, 2.0 * camera.position, atol=1e-9)
    assert np.abs(other.render(moved, "pcn").rgba - cube.render(camera, "pcn").rgba).max() < 0.02


def test_names_come_before_values_and_values_before_colours(cube: Scene) -> None:
    look = Look((
        LookRegion({"name": "Shell"}, (0.9, 0.2, 0.1), (0.0, 0.1)),
        LookRegion({}, (0.0, 0.0, 0.0), (0.5, 0.7)),
        LookRegion({}, (0.8, 0.3, 0.1)),
        LookRegion({"opacity": 0.3}, (1.0, 1.0, 1.0)),
    ))  # fmt: skip
    regions = [replace(r, values=v) for r, v in zip(cube.regions, ((0.0, 0.1), (0.55, 0.7), None), strict=True)]
    scene = replace(cube, regions=tuple(regions)).edited(2, name=" shell ")
    found = look.matched(scene)
    assert {m.region: m.source for m in found.pairs} == {0: 2, 1: 1, 2: 0}
    assert [m.reason.split(",")[0] for m in found.pairs] == [
        "the nearest colour",
        "overlapping values",
        "the same name",
    ]
    assert found.unused == (3,) and found.left == ()
    lines = found.describe(look, scene)
    assert (
        lines[2] == "Region 2 (shell) looks like Shell: the same name"
        and "region 3 of the look is not used" in lines[3]
    )


def test_regions_without_a_match_keep_their_looks(cube: Scene) -> None:
    look = Look((LookRegion({"opacity": 0.3}, (0.9, 0.2, 0.1)),))
    found = look.applied(cube.edited(2, opacity=0.7))
    assert [r.opacity for r in found.scene.regions] == [0.3, 1.0, 0.7] and found.matches.left == (1, 2)
    asked = look.applied(cube, {2: 0})
    assert [r.opacity for r in asked.scene.regions] == [1.0, 1.0, 0.3] and asked.matches.pairs[0].reason == "as asked"


def test_a_part_looks_like_its_whole_unless_it_is_named(cube: Scene) -> None:
    look = Look((LookRegion({"opacity": 0.3}, (0.9, 0.2, 0.1)), LookRegion({"name": "tooth", "opacity": 0.6})))
    split = cube.with_part(0, 0.5)
    assert look.matched(split).pairs[-1].source == 0
    assert look.matched(split.edited(3, name="Tooth")).pairs[-1].source == 1


def test_a_plain_look_hides_the_paint_of_a_painted_scene(cube: Scene, painted: Scene) -> None:
    found = Look.of(cube).applied(painted)
    camera = seen_from(cube, 0.0, 0.0, 32, 32)
    assert np.abs(found.scene.render(camera).rgba - cube.edited(0, name="x").render(camera).rgba).max() < 0.02


def test_light_is_taken_over_where_it_can_be_moved(cube: Scene) -> None:
    lit = lit_cube_scene().with_light(50.0, 10.0).edited(0, specular=0.5)
    look = from_json(told(Look.of(lit)), "it")
    assert look.lamp == Lamp(50.0, 10.0)
    assert look.applied(lit_cube_scene()).scene.lamp == look.lamp
    plain = look.applied(cube)
    assert plain.scene.regions[0].specular is None and "light of the look was left out" in plain.notes[0]


def broken(change: dict[str, Any]) -> dict[str, Any]:
    """A look with one thing changed."""
    plain = {"svv_look": 1, "regions": [{"edits": {}, "style": "a"}], "styles": {"a": {"picture": as_data(PICTURE)}}}
    return {**plain, **change}


def of_region(**change: Any) -> dict[str, Any]:
    """A look whose region has something changed."""
    return broken({"regions": [{"edits": {}, **change}]})


GOOD = as_data(PICTURE)
BAD = [
    ({"svv_look": 2}, "version 2, but this program reads version 1: update svv"),
    ({"svv_look": "1"}, "its version is '1'"),
    ({"regions": []}, "1 to 256 regions"),
    ({"script": "import os"}, "'script', which this version of svv does not know"),
    ({"title": "a\nb"}, "one line"),
    ({"styles": {"a": {"picture": "../../secret.png"}}}, "not '../../secret.png': pictures are never read from paths"),
    ({"styles": {"a": {"picture": "/etc/passwd"}}}, "never read from paths"),
    ({"styles": {"a": {"picture": "file:///etc/passwd"}}}, "never read from paths"),
    ({"styles": {"a": {"path": "a.png"}}}, "'path', which"),
    ({"styles": {"a": {"picture": GOOD[: len(GOOD) // 2]}}}, "is broken"),
    ({"styles": {"a": {"picture": "data:image/png;base64,AAAA"}}}, "is broken"),
    ({"styles": {"a": {"picture": as_data(PICTURE[:8])}}}, "pixels; sides of 16 to 2048"),
    ({"styles": {"a": {"picture": GOOD, "mask": GOOD[:200]}}}, "is broken"),
    ({"styles": {"a": {"picture": GOOD, "mask": as_data(PICTURE[:20])}}}, "another size than its picture"),
    ({"styles": {}}, "whose picture is not in the look"),
    ({"styles": {"a": {"ink": "blood"}}}, "no 'ink:blood'"),
    ({"styles": {"a": {"gallery": "../a"}}}, "gallery"),
    ({"camera": {"camera_to_world": [[1, 0, 0, 0]] * 4, "fov": 30}}, "camera_to_world|matrix"),
    ({"camera": {"fov": 30}}, "camera_to_world"),
    ({"figure": {"journal": "diary"}}, "must be one of nature"),
    ({"figure": {"dpi": "many"}}, "whole number"),
    ({"figure": {"run": "x"}}, "'run', which"),
    ({"lamp": {"azimuth": 1e9}}, "azimuth must lie"),
]
BAD_EDITS = [
    ({"opacity": -1}, "opacity must lie between 0"),
    ({"opacity": "much"}, "finite number"),
    ({"strength": 2}, "strength must lie"),
    ({"share": 0.5}, "is not an edit"),
    ({"colours": 1}, "has no colours"),
    ({"edited_colour": [2, 0, 0]}, "between 0 and 1"),
    ({"name": "a" * 300}, "at most 100 characters"),
    ({"outline_width": 99}, "at most 16 pixels wide"),
    ({"stroke_width": 9}, "out of range"),
    ({"shininess": 0.1}, "shininess"),
]


@pytest.mark.parametrize(("content", "words"), [
    *((broken(change), words) for change, words in BAD),
    *((of_region(edits=edits), words) for edits, words in BAD_EDITS),
    (of_region(laid={"hand": "foot"}), "does not know"),
    (of_region(laid={"stroke_size": 0}), "stroke size must lie"),
    (of_region(colour=[0, 0, 7]), "between 0 and 1"),
    ([], "not a look"),
    ({"regions": []}, "not a look"),
])  # fmt: skip
def test_what_is_no_look_of_ours_is_refused_in_a_sentence(content: Any, words: str, tmp_path: Path) -> None:
    (tmp_path / "look.json").write_text(json.dumps(content))
    with pytest.raises(BadInput, match=words) as raised:
        Look.load(tmp_path / "look.json")
    assert str(raised.value).endswith(".") and "\n" not in str(raised.value)


def test_edits_that_are_no_numbers_name_the_region(painted: Scene) -> None:
    for field, value in (("opacity", float("nan")), ("occlusion", "much"), ("occlusion", -1.0), ("name", "x" * 300)):
        told = to_json(Look.of(painted))
        told["regions"][1]["edits"][field] = value
        with pytest.raises(BadInput, match=r"it, region 1.*(save the look again|shorten it)"):
            from_json(told, "it")


@pytest.mark.parametrize("content", [b"", b"{", b"\xff\xfe", b"[" * 5000])
def test_files_that_are_not_json_are_refused(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "look.json").write_bytes(content)
    with pytest.raises(BadInput, match="is not JSON"):
        Look.load(tmp_path / "look.json")
    with pytest.raises(BadInput, match="There is no look"):
        Look.load(tmp_path / "none.json")
    with pytest.raises(BadInput, match="There is no look 'none' in the gallery"):
        Look.load("gallery:none")


def test_a_picture_that_the_scene_lost_can_be_given(painted: Scene) -> None:
    made = drop_styles(painted.made)  # as a scene that was painted by an older version
    with pytest.raises(BadInput, match="does not hold the picture of its style 'noise'"):
        Look.of(replace(painted, made=made))
    name = painted.regions[0].style
    look = Look.of(replace(painted, made=made), styles={str(name): StyleInput(PICTURE, name)})
    assert look.styles[str(name)].style is PICTURE


@pytest.mark.parametrize("name", ['the "inner" shell', "עצם", "🦴", "a" * 100])
def test_names_in_any_script_match(cube: Scene, name: str) -> None:
    look = from_json(told(Look.of(cube.edited(2, name=name, opacity=0.25))), "it")
    assert look.applied(cube.edited(0, name=name)).scene.regions[0].opacity == 0.25


def test_twelve_regions_and_none(cube: Scene) -> None:
    look = Look(tuple(LookRegion({"opacity": k / 12}, (k / 12, 0.5, 0.5)) for k in range(12)))
    assert len(look.matched(cube).unused) == 9
    with pytest.raises(BadInput, match="no regions"):
        look.matched(replace(cube, regions=()))
    for mapping in ({7: 0}, {0: 12}):
        with pytest.raises(BadInput, match="no region"):
            look.matched(cube, mapping)


@pytest.mark.slow
def test_the_commands(
    painted: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    painted.save("a.svv")
    cube_scene(1).save("b.svv")

    def run(*arguments: str) -> str:
        cli.app(["look", *arguments], prog_name="svv", standalone_mode=False)
        return capsys.readouterr().out

    run("save", "a.svv", "--view", "30,10", "--unit", "mm", "--about", "Noise", "--out", "look.json")
    said = run("show", "look.json")
    assert "Noise" in said and "region 0 (bone)" in said and "style noise" in said and "unit mm" in said
    assert run("apply", "look.json", "b.svv", "--dry-run").count("looks like") == 3 and not Path("c.svv").exists()
    run("apply", "look.json", "b.svv", "--map", "1=0", "--preset", "draft", "--camera", "c.json", "--out", "c.svv")
    scene = Scene.load("c.svv")
    assert scene.regions[1].name == "bone" and scene.regions[1].style is not None
    assert svv.read_camera("c.json").width == 800 and not list(tmp_path.glob("*.checkpoint*"))
    with pytest.raises(BadInput, match="Give --out"):
        run("apply", "look.json", "b.svv")
    with pytest.raises(BadInput, match="not a mapping"):
        run("apply", "look.json", "b.svv", "--map", "a=b", "--dry-run")
    with pytest.raises(BadInput, match="not both"):
        run("save", "a.svv", "--view", "0,0", "--camera", "c.json", "--out", "d.json")
    run("save", "b.svv", "--out", "plain.json")
    with pytest.raises(BadInput, match="has no camera"):
        run("apply", "plain.json", "b.svv", "--camera", "d.json", "--out", "d.svv")


@pytest.mark.parametrize(
    "kept",
    [
        [], "x", {}, {"styles": [], "laid": {}}, {"styles": {}, "laid": {"a": {}}}, {"styles": {}, "laid": {"0": []}},
        {"styles": {"a": {"picture": "picture.none"}}, "laid": {}}, {"styles": {"a": {"picture": [1]}}, "laid": {}},
        {"styles": {"a": {"picture": "base.encoding.table"}}, "laid": {}},
        {"styles": {}, "laid": {"0": {"style": 1, "manner": "auto", "hand": "auto", "stroke_size": 1}}},
    ],
)  # fmt: skip
def test_damaged_records_of_styles_are_one_sentence(painted: Scene, kept: Any, tmp_path: Path) -> None:
    header, tensors = painted.to_arrays()
    header["made"]["stylized"] = {**header["made"]["stylized"], "kept": kept}
    write_scene_file(tmp_path / "a.svv", header, tensors)
    with pytest.raises(BadInput, match=r"a\.svv"):
        Scene.load(tmp_path / "a.svv")


def test_looks_that_ship_are_sound_and_differ() -> None:
    from svv.job.looks.offered import LOOKS

    assert len(LOOKS) == 10 and {len(look["regions"]) for look in LOOKS.values()} == {1, 2, 3}
    for name in LOOKS:
        look = Look.load(f"gallery:{name}")
        assert look.title and all(region.edits or region.style for region in look.regions)


def test_a_figure_takes_camera_and_settings_from_a_look(
    cube: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("matplotlib", reason="figures need matplotlib: install svv[figure]")
    monkeypatch.chdir(tmp_path)
    cube.save("a.svv")
    camera = seen_from(cube, 90.0, 0.0, 64, 64)
    Look.of(cube, camera, FigureOptions(width=50.0, dpi=60, legend="none", scale_bar=False, axes=None)).save(
        "look.json"
    )
    seen = []
    monkeypatch.setattr(
        "svv.render.figures.figure.drawing_of", lambda panels, out, options, *_, **__: seen.append((panels, options))
    )
    cli.app(["figure", "a.svv", "--look", "look.json", "--dpi", "80", "--out", "f.png"], standalone_mode=False)
    ((panel,), options) = seen[0]
    np.testing.assert_allclose(panel.camera.position, camera.position, atol=1e-9)
    assert (options.width, options.dpi, options.legend, options.scale_bar) == (50.0, 80, "none", False)


def test_a_job_gives_its_scene_a_look(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from svv.job.source import ViewSource
    from svv.job.stages import Stages, unseen
    from svv.job.steps import Job, JobSettings
    from svv.options.making import TrainOptions

    look = Look((LookRegion({"opacity": 0.5, "matcap": "jade", "name": "stone"}),), title="Stone")
    settings = JobSettings(train=TrainOptions(preset="draft", device="cpu"), look=look)
    job = Job(ViewSource(tmp_path), [], tmp_path, settings, Stages(tmp_path, unseen))
    cube_scene().save(job.scene)
    monkeypatch.setattr(job.stages, "do", lambda name, label, given, files, work, after=(): work(lambda *_: None))
    job.give_look()
    scene = Scene.load(job.variants["styled"][1])
    assert [r.name for r in scene.regions].count("stone") == 1
    assert "looks like stone: in turn" in json.loads((tmp_path / "look.json").read_text())["matches"][0]
    with pytest.raises(BadInput, match="not both"):
        cli.app(
            ["run", "x.vti", "--look", "gallery:sea-glass", "--style", "a.png", "--out", "o"], standalone_mode=False
        )
