"""A scene in PyVista's window: the picture is the scene's own rendering, wherever the mouse moves the camera."""

from __future__ import annotations

import sys
import time
from base64 import b64decode
from collections.abc import Iterator
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from PIL import Image

pyvista = pytest.importorskip("pyvista")

import svv  # noqa: E402
from svv.core.frame_rate import AIM  # noqa: E402
from svv.core.geometry.cameras import Camera, look_at  # noqa: E402
from svv.fields.scene.model import in_words  # noqa: E402
from svv.fields.scene.scene import Scene  # noqa: E402
from svv.io.pictures.output import write_vti  # noqa: E402
from svv.render.show import SceneFollower  # noqa: E402
from tests.cube import cube_paint  # noqa: E402
from tests.stand_in_learning import StandIn  # noqa: E402

SIZE = (64, 48)
GREY = (0.3, 0.3, 0.3)


def oblique() -> Camera:
    return Camera(look_at((1.5, 1.0, 2.0), (0.1, -0.05, 0.0), (0.2, 1.0, 0.1)), 0.5, *SIZE)


def rendered(scene: Scene, camera: Camera) -> np.ndarray:
    return np.rint(255.0 * scene.render(camera, background=GREY).rgba[..., :3]).astype(np.uint8)


def assert_same_picture(one: np.ndarray, other: np.ndarray) -> None:
    """To one level: a camera that has gone through VTK differs by rounding."""
    assert one.shape == other.shape
    assert np.abs(one.astype(int) - other).max() <= 1


@pytest.fixture
def follower(cube: Scene) -> Iterator[SceneFollower]:
    plotter = pyvista.Plotter(off_screen=True, window_size=list(SIZE))
    yield SceneFollower(plotter, cube, oblique(), None, GREY)
    plotter.close()


def mouse(follower: SceneFollower, event: str, x: int, y: int) -> None:
    interactor = follower.plotter.iren.interactor
    interactor.SetEventInformation(x, y, 0, 0, chr(0), 0, None)
    interactor.InvokeEvent(f"{event}Event")


def test_the_picture_is_the_scenes_rendering(cube: Scene, tmp_path: Path) -> None:
    camera = oblique()
    shown = svv.show(
        cube, camera=camera, size=SIZE, background=GREY, off_screen=True, screenshot=tmp_path / "shown.png"
    )
    assert shown is not None
    assert_same_picture(np.asarray(shown), rendered(cube, camera))
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "shown.png")), np.asarray(shown))


def test_without_a_camera_it_is_seen_from_the_front(cube: Scene) -> None:
    shown = svv.show(cube, size=SIZE, background=GREY, off_screen=True)
    assert_same_picture(np.asarray(shown), rendered(cube, svv.orbit(cube, 181, *SIZE)[90]))


def test_the_window_shows_the_picture(follower: SceneFollower) -> None:
    follower.plotter.show(auto_close=False)
    assert_same_picture(follower.plotter.screenshot(), rendered(follower.scene, oblique()))


def test_meshes_stand_where_the_scene_has_them(follower: SceneFollower) -> None:
    """VTK's projection of a point of the world is the camera's: x = f X / -Z from the middle of the picture."""
    follower.plotter.show(auto_close=False)
    camera, renderer = follower.camera(), follower.plotter.renderer
    for point in follower.scene.occupancy.box.bounds:
        renderer.SetWorldPoint(*point, 1.0)
        renderer.WorldToDisplay()
        x, y, z = np.linalg.inv(camera.camera_to_world)[:3] @ [*point, 1.0]
        expected = 0.5 * np.array(SIZE) + camera.focal * np.array([x, y]) / -z
        np.testing.assert_allclose(renderer.GetDisplayPoint()[:2], expected, atol=1e-3)


def test_it_is_small_while_the_mouse_moves_and_sharp_when_it_rests(follower: SceneFollower) -> None:
    follower.plotter.show(auto_close=False)
    before = follower.picture
    mouse(follower, "LeftButtonPress", 30, 20)
    mouse(follower, "MouseMove", 42, 25)
    assert follower.picture.shape == (19, 26, 3)
    mouse(follower, "LeftButtonRelease", 42, 25)
    assert follower.picture.shape == (48, 64, 3)
    assert np.abs(follower.picture.astype(int) - before).max() > 20  # it has turned
    assert np.linalg.norm(follower.camera().position - oblique().position) > 0.1
    assert_same_picture(follower.picture, rendered(follower.scene, follower.camera()))


def test_the_small_picture_grows_where_there_is_time(follower: SceneFollower, monkeypatch: pytest.MonkeyPatch) -> None:
    follower.plotter.show(auto_close=False)
    for seconds, part in ((4 * AIM, 0.2), (AIM, 0.2), (AIM / 4, 0.4), (1e-9, 1.0), (1e9, 0.2)):
        clock = iter((0.0, seconds))
        monkeypatch.setattr("svv.render.show.time", SimpleNamespace(perf_counter=lambda clock=clock: next(clock)))
        follower.plotter.render_window.SetDesiredUpdateRate(15.0)
        follower.plotter.camera.azimuth += 5.0
        follower.update()
        assert follower.pace.part == pytest.approx(part)


def test_nothing_is_rendered_where_nothing_moved(follower: SceneFollower) -> None:
    follower.plotter.show(auto_close=False)
    before = follower.picture
    follower.plotter.render()
    assert follower.picture is before


def test_a_key_sets_the_camera_back_around_the_scene(follower: SceneFollower) -> None:
    follower.plotter.show(auto_close=False)
    follower.plotter.camera.position = (100.0, 0.0, 0.0)
    follower.plotter.reset_camera()
    assert np.linalg.norm(follower.camera().position) < 10.0


def test_in_a_notebook_the_picture_stands_below_the_cell(cube: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    shell = type("ZMQInteractiveShell", (), {})()
    ipython = ModuleType("IPython")
    ipython.get_ipython = lambda: shell  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "IPython", ipython)
    monkeypatch.setitem(sys.modules, "pyvista", None)  # not even asked for
    shown = svv.show(cube, camera=oblique(), size=SIZE, background=GREY)
    assert_same_picture(np.asarray(shown), rendered(cube, oblique()))
    assert shown is not None and shown.copy().size == SIZE


def test_a_notebook_keeps_the_regions_names_as_the_text_of_the_picture(cube: Scene) -> None:
    """IPython's own formatter says what a notebook's file has; exporters take the text from there."""
    formatters = pytest.importorskip("IPython.core.formatters")
    scene = cube.edited(0, name='bone "A" & <b>').hidden(1).hidden(2)
    shown = svv.show(scene, camera=oblique(), size=SIZE, off_screen=True)
    data, metadata = formatters.DisplayFormatter().format(shown)
    assert set(data) == {"image/png", "text/html", "text/plain"}
    html = data["text/html"]
    assert '<img alt="A rendering of 1 region: bone &#34;A&#34; &amp; &lt;b&gt;" ' in html
    assert b64decode(html.partition("base64,")[2].partition('"')[0]) == data["image/png"]
    assert metadata == {"image/png": {"alt": 'A rendering of 1 region: bone "A" & <b>'}}
    np.testing.assert_array_equal(np.asarray(Image.open(BytesIO(data["image/png"]))), np.asarray(shown))


def test_pictures_are_told_in_words(cube: Scene) -> None:
    assert in_words(cube) == "A rendering of 3 regions: region 0, region 1, region 2"
    assert in_words(cube.hidden(0).hidden(1).hidden(2)) == "A rendering of a scene, all of whose regions are hidden"
    painted = cube.painted(cube_paint(cube, 1), {0: "oil"}, {}, "oil")
    assert in_words(painted) == "A painting of 3 regions: region 0, region 1, region 2"
    assert in_words(painted, "pcn") == "A rendering of 3 regions: region 0, region 1, region 2"
    many = replace(cube, regions=cube.regions * 5)
    assert in_words(many).endswith("region 11 and 3 more")


def test_what_is_missing_is_said(cube: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(svv.BadInput, match="no network 'styled'"):
        svv.show(cube, network="styled", size=SIZE, off_screen=True)
    with monkeypatch.context() as patch, pytest.raises(svv.BadInput, match="give off_screen=True"):
        patch.setattr(pyvista, "system_supports_plotting", lambda: False)
        svv.show(cube)
    with monkeypatch.context() as patch, pytest.raises(svv.BadInput, match=r"pip install 'svv\[standalone\]'"):
        patch.setitem(sys.modules, "pyvista", None)
        svv.show(cube, off_screen=True)
    with monkeypatch.context() as patch, pytest.raises(svv.BadInput, match="StyleRF Render"):
        patch.setitem(sys.modules, "paraview", ModuleType("paraview"))
        svv.show(cube, off_screen=True)


def test_image_data_is_what_the_vti_file_holds(cube: Scene, tmp_path: Path) -> None:
    rendering = cube.render(replace(oblique(), width=20, height=12))
    image = svv.image_data(rendering)
    write_vti(tmp_path / "view.vti", rendering.rgba, rendering.depth, rendering.region)
    file = pyvista.read(tmp_path / "view.vti")
    assert image.dimensions == file.dimensions == (20, 12, 1)
    assert image.active_scalars_name == file.active_scalars_name == "RGBA"
    assert set(image.point_data.keys()) == set(file.point_data.keys())
    for name in file.point_data.keys():
        assert image[name].dtype == file[name].dtype
        np.testing.assert_array_equal(image[name], file[name])


def test_a_training_in_the_background_sharpens_in_the_window(
    follower: SceneFollower, cube: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    green = cube.edited(0, colour=(0.0, 1.0, 0.0))
    learning, looks = StandIn(cube, cube, green), []
    learning.step()
    monkeypatch.setattr(follower.plotter, "add_timer_event", lambda **given: looks.append(given["callback"]))
    follower.sharpen(learning)
    follower.plotter.show(auto_close=False)
    looks[0](0)
    assert "33%: scene 1" in follower.plotter.actors["progress"].GetText(2)
    before = follower.picture
    learning.step()
    learning.step()
    looks[0](1)
    assert follower.scene is green and follower.plotter.actors["progress"].GetText(2) == ""
    assert_same_picture(follower.picture, rendered(green, oblique()))
    assert np.abs(follower.picture.astype(int) - before).max() > 20
    looks.clear()
    follower.sharpen(learning)
    assert not looks, "there is nothing to look for"


def test_a_picture_of_a_training_waits_for_the_first_scene(cube: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    learning, clock = StandIn(cube, cube), {"perf_counter": time.perf_counter}
    monkeypatch.setattr("svv.render.show.time", SimpleNamespace(sleep=lambda _: learning.step(), **clock))
    shown = svv.show(learning, camera=oblique(), size=SIZE, background=GREY, off_screen=True)
    assert_same_picture(np.asarray(shown), rendered(cube, oblique()))
    failing = StandIn(cube, error="The disk is full.")
    failing._scenes = (cube, cube, cube)
    monkeypatch.setattr(type(failing), "scene", property(lambda self: None))
    monkeypatch.setattr("svv.render.show.time", SimpleNamespace(sleep=lambda _: failing.step(), **clock))
    with pytest.raises(svv.BadInput, match="The disk is full"):
        svv.show(failing, size=SIZE, off_screen=True)
