"""The notebook's widget: several on one page of a real browser, with a stand-in for the notebook's models."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("anywidget", reason="the widget needs anywidget: install svv[notebook]")

from IPython.core.formatters import DisplayFormatter

import svv
from svv.core.colour.colour import over
from svv.core.geometry.cameras import CameraRig
from svv.errors import BadInput
from svv.fields.scene.joined import joined
from svv.fields.scene.scene import Scene
from svv.job.dataset import dataset_of
from svv.render.web.notebook import SceneWidget, _edited
from tests.browser import Opened
from tests.cube import cube_paint, cube_scene
from tests.stand_in_learning import StandIn

CLOSE = 38.0
"""Least PSNR of the page's picture against the renderer's, in dB."""

NOTEBOOK = """<!doctype html><title>notebook</title><body><style>button { display: none }</style><script>
class Model {  // what a front end gives to anywidget
  constructor(state) { this.state = state; this.calls = {}; this.saved = 0; }
  get(name) { return this.state[name]; }
  set(name, value) { this.state[name] = value; }
  save_changes() { this.saved++; }
  on(name, call) { (this.calls[name] ??= []).push(call); }
  off(name, call) { this.calls[name] = this.calls[name].filter((other) => other !== call); }
  receive(state) {  // from Python
    Object.assign(this.state, state);
    for (const name of Object.keys(state)) for (const call of this.calls[`change:${name}`] ?? []) call();
  }
}
const models = [];
let ends = [];
async function show(program, states) {
  const { default: widget } = await import(URL.createObjectURL(new Blob([program], { type: "text/javascript" })));
  for (const state of states) {
    const el = document.createElement("div"), model = new Model(state);
    document.body.append(el);
    models.push(model);
    ends.push(widget.render({ model, el }));
  }
}
</script></body>"""


@pytest.fixture
def notebook(open_page: Callable[..., Opened], tmp_path: Path) -> Opened:
    (tmp_path / "notebook.html").write_text(NOTEBOOK)
    return open_page(tmp_path / "notebook.html", size=(1000, 700))


@pytest.fixture(scope="module")
def _few_frames() -> Any:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("svv.render.web.page.MOVIE_FRAMES", 2)
        yield


@pytest.fixture
def shown(balls: Scene, _few_frames: Any) -> SceneWidget:
    return dataset_of(balls).svv.widget(title='"><script>alert(1)</script>', height=300)


def state(widget: SceneWidget) -> dict[str, Any]:
    """What a front end gets when the widget is displayed."""
    return {name: value for name, value in widget.get_state().items() if isinstance(value, str | int | float | dict)}


def told(notebook: Opened, number: int, after: int) -> dict[str, Any]:
    """What a page tells Python, once it has done so ``after`` times."""
    notebook.until(f"models[{number}].saved >= {after}")
    content = notebook.page.evaluate(f"JSON.stringify(models[{number}].state)")
    return {name: value for name, value in json.loads(content).items() if name in ("view", "_camera", "edits")}


def test_widgets_tell_python_what_is_set_and_leave_each_other_alone(
    notebook: Opened, shown: SceneWidget, balls: Scene
) -> None:
    assert shown.camera is None and shown.scene.regions == balls.regions
    notebook.page.evaluate("([program, states]) => show(program, states)", [shown._esm, [state(shown), state(shown)]])
    first, second = (notebook.page.frame_locator("iframe").nth(k) for k in range(2))
    told(notebook, 0, 1), told(notebook, 1, 1)
    assert notebook.page.locator("iframe").first.bounding_box()["height"] == 300
    first.get_by_label("Colour of Region 0").fill("#20a040")
    first.get_by_label("Opacity of Region 1").fill("0.3")
    first.get_by_role("application").press("ArrowLeft")
    notebook.until("models[0].state.edits.regions[1].opacity === 0.3 && models[0].state.view.axes[0] > 0")
    shown.set_state(told(notebook, 0, 2))
    wanted = balls.edited(0, (32 / 255, 160 / 255, 64 / 255)).edited(1, opacity=0.3)
    assert shown.scene.regions == wanted.regions
    assert shown.scene.undone().regions == balls.regions
    camera = shown.camera
    assert camera is not None and CameraRig.of([camera]).radius > 0
    small = camera.resized(96, 96)
    sent = {"camera_to_world": small.camera_to_world.ravel().tolist(), "fov_x": small.fov_x, "span_x": small.span_x,
            "width": 96, "height": 96}  # fmt: skip
    frame = notebook.page.frames[1]
    data = frame.evaluate("async (camera) => Array.from((await window.svv).picture(camera).data)", sent)
    picture = np.reshape(data, (96, 96, 4))[..., :3] / 255
    assert -10 * np.log10(np.square(picture - over(shown.scene.render(small).rgba)).mean()) > CLOSE
    assert told(notebook, 1, 1)["edits"]["regions"][0]["edited"] is None
    assert second.get_by_label("Opacity of Region 1").input_value() == "1"


def test_python_sets_the_page_and_a_frame_that_loads_again_keeps_it(notebook: Opened, shown: SceneWidget) -> None:
    notebook.page.evaluate("([program, states]) => show(program, states)", [shown._esm, [state(shown)]])
    before = told(notebook, 0, 1)
    turned = {**before["view"], "zoom": 2.0, "axes": [1, 0, 0, 0, 0, 1, 0, -1, 0]}
    edits = {**before["edits"], "regions": [{**r, "hidden": k == 0} for k, r in enumerate(before["edits"]["regions"])]}
    notebook.page.evaluate("(state) => models[0].receive(state)", {"view": turned, "edits": edits})
    after = told(notebook, 0, 2)
    assert (after["view"], after["edits"]) == (turned, edits)
    assert after["_camera"]["camera_to_world"][:3] == [1, 0, 0]
    shown.set_state(after)
    assert [r.hidden for r in shown.scene.regions] == [True, False]
    notebook.page.evaluate("document.body.prepend(document.querySelector('iframe').parentElement)")
    notebook.page.frame_locator("iframe").get_by_label("Hide Region 0").and_(
        notebook.page.frame_locator("iframe").locator("[aria-pressed=true]")
    ).wait_for()
    notebook.page.evaluate("() => { ends.forEach((end) => end()); models[0].receive({ height: 500 }) }")
    assert notebook.page.locator("iframe").bounding_box()["height"] == 300, "a view that was removed hears nothing"


def displayed(widget: SceneWidget, monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """The outputs of a cell that ends with a widget."""
    outputs: list[dict[str, Any]] = []
    monkeypatch.setattr("svv.render.web.notebook.display", lambda data, raw: outputs.append(data))
    assert DisplayFormatter().format(widget) == ({}, {})  # it displays itself
    return outputs


def test_without_widgets_the_page_is_there(
    shown: SceneWidget, open_page: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page, widget = displayed(shown, monkeypatch)
    assert widget["application/vnd.jupyter.widget-view+json"]["model_id"] == shown.model_id
    assert list(page) == ["text/html"], "exporters choose one kind of an output, and the widget first"
    (tmp_path / "exported.html").write_text(f"<!doctype html><body>{page['text/html'] * 2}</body>")
    opened = open_page(tmp_path / "exported.html")
    for number in range(2):
        frame = opened.page.frame_locator("iframe").nth(number)
        frame.locator("body.live").wait_for()
        assert frame.get_by_role("heading", level=1).inner_text() == '"><script>alert(1)</script>'


def test_the_widget_takes_the_place_of_the_page(notebook: Opened, shown: SceneWidget, balls: Scene) -> None:
    other = dataset_of(balls).svv.widget()
    html = shown._repr_html_() + other._repr_html_()
    notebook.page.evaluate("(html) => document.body.insertAdjacentHTML('afterbegin', html)", html)
    notebook.page.evaluate("([program, states]) => show(program, states)", [shown._esm, [state(shown)]])
    told(notebook, 0, 1)
    assert notebook.page.locator("iframe").count() == 2, "the other widget's page stays"
    assert notebook.page.locator("[data-svv]").count() == 1
    titles = notebook.page.locator("iframe").evaluate_all("(frames) => frames.map((frame) => frame.title)")
    assert sorted(titles) == [
        '"><script>alert(1)</script>. A rendering of 2 regions: region 0, region 1',
        "scene. A rendering of 2 regions: region 0, region 1",
    ]


def test_paintings_are_those_of_the_page(balls: Scene) -> None:
    scene = balls.painted(cube_paint(balls, 1), {0: "a"}, {}, "one").painted(cube_paint(balls, 2), {1: "b"}, {}, "two")
    regions = [{"edited": None, "opacity": 1, "hidden": False} for _ in balls.regions]
    told = {"painting": 1, "strength": 1, "light": 1, "lamp": vars(scene.lamp), "regions": regions}
    for change, variant, strengths in (({}, "two", [1.0, 1.0]), ({"painting": 0, "strength": 0.5}, "one", [0.5, 1.0]),
                                       ({"painting": None}, "two", [1.0, 0.0])):  # fmt: skip
        edited = _edited(scene, {**told, **change})
        assert edited.variant == variant and [r.strength for r in edited.regions] == strengths
    assert _edited(scene, told) is scene
    assert [r.lighting for r in _edited(scene, {**told, "light": 0.5}).regions] == [0.5, 0.5]


def test_the_painting_of_a_joined_scene_is_that_of_its_members(balls: Scene) -> None:
    painted = balls.painted(cube_paint(balls, 1), {0: "a"}, {}, "one")
    both = joined([balls, painted])
    regions = [{"edited": None, "opacity": 1, "hidden": k == 1} for k in range(4)]
    told = {"painting": 0, "strength": 0.5, "light": 1, "lamp": vars(both.lamp), "regions": regions}
    edited = _edited(both, told)
    assert [r.strength for r in edited.regions] == [1.0, 1.0, 0.5, 1.0]
    assert [r.hidden for r in edited.regions] == [False, True, False, False]
    assert [r.strength for r in _edited(both, {**told, "painting": None}).regions] == [1.0, 1.0, 0.0, 1.0]
    with pytest.raises(IndexError):
        _edited(both, {**told, "painting": 1})


def test_edits_that_do_not_fit_are_refused(shown: SceneWidget) -> None:
    none: dict[str, Any] = {"painting": None, "strength": 1, "light": 1, "regions": [], "lamp": {}}
    tried: list[dict[str, Any]] = [{"regions": []}, none, {**none, "painting": 3}]
    for edits in tried:
        shown.edits = edits
        with pytest.raises(BadInput, match="not those of this scene's page"):
            _ = shown.scene


def test_without_anywidget_it_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "svv.render.web.notebook", raising=False)
    monkeypatch.setitem(sys.modules, "anywidget", None)
    with pytest.raises(BadInput, match=r"pip install 'svv\[notebook\]'"):
        svv.widget(cube_scene())


@pytest.mark.usefixtures("_few_frames")
def test_a_training_in_the_background_sharpens_and_stays_turned(notebook: Opened, balls: Scene) -> None:
    learning = StandIn(balls, balls, balls.edited(0, colour=(0.0, 1.0, 0.0)))
    widget = svv.widget(learning, height=300)
    with pytest.raises(BadInput, match="no scene yet"):
        _ = widget.scene
    notebook.page.evaluate("([program, states]) => show(program, states)", [widget._esm, [state(widget)]])

    def hear() -> None:
        learning.step()
        told = {name: getattr(widget, name) for name in ("edits", "page", "fraction", "told")}
        notebook.page.evaluate("(state) => models[0].receive(state)", told)

    hear()
    assert notebook.page.locator("progress").evaluate("bar => bar.value") == pytest.approx(1 / 3)
    assert notebook.page.get_by_text("scene 1").is_visible() and widget.scene is balls
    before = told(notebook, 0, 1)
    notebook.page.frame_locator("iframe").get_by_role("application").press("ArrowLeft")
    notebook.until(f"JSON.stringify(models[0].state.view) !== {json.dumps(json.dumps(before['view']))}")
    turned = told(notebook, 0, 2)["view"]
    saved = notebook.page.evaluate("models[0].saved")
    hear()
    hear()
    assert told(notebook, 0, saved + 1)["view"] == turned
    assert not notebook.page.locator("progress").is_visible()
    assert widget.scene.regions[0].edited_colour == (0.0, 1.0, 0.0) and widget.fraction == 1.0

    failed = svv.widget(failing := StandIn(balls, balls, error="The disk is full."))
    failing.step()
    assert (failed.fraction, failed.told) == (1.0, "The disk is full.")
