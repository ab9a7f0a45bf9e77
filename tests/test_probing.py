"""Reading off what a pixel shows: region, place, distance, opacity and colour as rendered, and the volume's value."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import map_coordinates
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOXML import vtkXMLImageDataReader

from svv.cli.app import main
from svv.core.geometry.cameras import Camera
from svv.core.rays.compositing import LEAST_ALPHA
from svv.core.volumes.classified import LARGEST, ValueGrid, grid_shape
from svv.dvr.draw.views import make_views
from svv.dvr.read.grids import from_array
from svv.errors import BadInput
from svv.fields.following.followed_scene import at_step
from svv.fields.radiance.kept_values import KeptValues
from svv.fields.radiance.time_steps import TimeSteps, packed_codes
from svv.fields.scene.joined import joined
from svv.fields.scene.probing import NOT_KEPT, VIEWS_ONLY, measure
from svv.fields.scene.scene import Scene
from svv.fields.scene.scene_arrays import restored
from svv.io.views.viewset import ViewSet
from svv.render.frames import orbit
from svv.train.pipeline import train_scene
from svv.train.run.config import preset
from tests.solid_ball import RADIUS, solid_ball
from tests.test_ranges import BLUE, RED, ball, bumps

CELLS = 64
LOW, HIGH = -200.0, 800.0


def grid_over(scene: Scene, field: object) -> ValueGrid:
    """A function of places in the world (N, 3), on a grid over a scene's box."""
    shape = tuple(grid_shape(scene.occupancy.box, CELLS) + 1)
    place = scene.occupancy.box.to_world(np.moveaxis(np.indices(shape), 0, -1) / CELLS)
    share = (field(place.reshape(-1, 3)).reshape(shape) - LOW) / (HIGH - LOW)  # type: ignore[operator]
    codes = (1 + 64 * np.rint(LARGEST // 64 * np.clip(share, 0.0, 1.0))).astype(np.uint16)
    return ValueGrid(CELLS, codes, (LOW, HIGH), (0.0, 1.0))


def linear(place: np.ndarray) -> np.ndarray:
    return np.asarray(300.0 + 500.0 * place[:, 0] - 300.0 * place[:, 1] + 200.0 * place[:, 2])


def quadratic(place: np.ndarray) -> np.ndarray:
    return np.asarray(600.0 - 1500.0 * np.square(place).sum(axis=1))


def keeping(scene: Scene, field: object) -> Scene:
    grid = grid_over(scene, field)
    kept = KeptValues.of(grid, scene.occupancy.box, scene.occupancy)
    return replace(scene, kept=kept, made={"learned_from": "volume and views", "source": {"volume": "ball.vti"}})


def front(scene: Scene, size: int = 48) -> Camera:
    return orbit(scene, 181, size, size)[90]


def pixels_of(camera: Camera, apart: int) -> list[tuple[int, int]]:
    return [(x, y) for x in range(2, camera.width, apart) for y in range(2, camera.height, apart)]


@pytest.mark.parametrize("parallel", [False, True])
@pytest.mark.parametrize("field", [linear, quadratic])
def test_values_are_those_at_the_place_that_is_told(field: object, parallel: bool) -> None:
    scene = keeping(solid_ball(2.5), field)
    camera = front(scene)
    if parallel:
        camera = Camera.orthographic(camera.camera_to_world, 1.2, 48, 48)
    drawn, told, off = scene.render(camera), 0, []
    for column, row in pixels_of(camera, 5):
        found = scene.probe(camera, (column + 0.5, row))
        assert (found is None) == (drawn.rgba[row, column, 3] <= LEAST_ALPHA)
        if found is None:
            continue
        told += 1
        assert found.point == scene.point_at(camera, (column, row)) and found.pixel == (column, row)
        assert found.alpha == pytest.approx(drawn.rgba[row, column, 3], abs=2e-3)
        assert found.colour == pytest.approx(drawn.rgba[row, column, :3], abs=5e-3)
        origins, directions = (np.broadcast_to(v, (48, 48, 3))[row, column] for v in camera.rays())
        assert np.allclose(origins + found.distance * directions, found.point, atol=1e-6)
        assert np.linalg.norm(found.point) < RADIUS + 0.05
        assert found.value is not None and found.uncertainty is not None and not found.why
        off.append((abs(found.value - float(field(np.array([found.point]))[0])), found.uncertainty))  # type: ignore[operator]
    assert told > 20
    assert np.mean([one <= own for one, own in off]) >= 0.95
    assert np.median([own for _, own in off]) < 6.0  # of a thousand


def test_the_spread_is_that_of_the_values_along_the_ray() -> None:
    deep, flat = keeping(solid_ball(1.0), linear), keeping(solid_ball(1.0), lambda place: np.full(len(place), 120.0))
    camera = front(deep)
    one, two = deep.probe(camera, (24, 24)), flat.probe(camera, (24, 24))
    assert one is not None and two is not None and one.spread is not None
    assert one.spread > 20.0 and two.spread == pytest.approx(0.0, abs=1e-6)
    opaque = keeping(solid_ball(6.0), linear).probe(camera, (24, 24))
    assert opaque is not None and opaque.spread is not None and opaque.spread < 0.5 * one.spread


def test_the_picture_of_values_is_what_each_pixel_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    left = keeping(solid_ball(2.0), linear)
    both = joined((left, keeping(solid_ball(0.0, 0.3), quadratic)))
    for scene in (left, both):
        camera = front(scene)
        image = scene.value_image(camera)
        assert image is not None and image.shape == (48, 48)
        for column, row in pixels_of(camera, 6):
            found, value = scene.probe(camera, (column, row)), image[row, column]
            if found is None:
                assert np.isnan(value)
            else:
                assert value == pytest.approx(found.value, rel=1e-5)
    assert solid_ball().value_image(camera) is None
    left.save(tmp_path / "ball.svv")
    told = ("--size", "48", "--out", str(tmp_path / "ball.vti"))
    assert run("render", str(tmp_path / "ball.svv"), *told, monkeypatch=monkeypatch) == 0
    reader = vtkXMLImageDataReader()
    reader.SetFileName(str(tmp_path / "ball.vti"))
    reader.Update()
    written = vtk_to_numpy(reader.GetOutput().GetPointData().GetArray("Value")).reshape(48, 48)[::-1]
    assert np.nanmedian(np.abs(written - left.value_image(front(left)))) < 2.0


def test_a_scene_without_values_says_why_and_how_to_keep_them() -> None:
    scene = replace(solid_ball(), made={"learned_from": "views only"})
    camera = front(scene)
    one = scene.probe(camera, (24, 24))
    assert one is not None and one.value is None and one.why == VIEWS_ONLY
    for made in ({}, {"learned_from": "volume and views"}):  # older scenes do not tell
        two = replace(scene, made=made).probe(camera, (24, 24))
        assert two is not None and two.why == NOT_KEPT and "--keep-values" in two.describe()
    assert scene.probe(camera, (0, 0)) is None and scene.hidden(0).probe(camera, (24, 24)) is None
    base = keeping(scene, linear).probe(camera, (24, 24), "base")
    assert base is not None and base.region is None and base.value is not None
    for wrong, said in (((48, 3), "outside the picture"), ((-0.5, 3), "outside the picture")):
        with pytest.raises(BadInput, match=said):
            scene.probe(camera, wrong)
    with pytest.raises(BadInput, match="no network 'styled'"):
        scene.probe(camera, (24, 24), "styled")


def test_values_that_are_damaged_are_refused() -> None:
    scene = keeping(solid_ball(), linear)
    assert scene.kept is not None
    hurt = replace(scene, kept=replace(scene.kept, codes=scene.kept.codes[:50]))
    with pytest.raises(BadInput, match="train it again"):
        hurt.probe(front(scene), (24, 24))
    header, tensors = scene.to_arrays()
    for name, wrong in (("cells", 1 << 20), ("cells", 0), ("interval", [1.0, 1.0]), ("interval", [0.0, math.inf]),
                        ("edges", [[0.0] * 3] * 3), ("nearest", "no"), ("box", {"low": [0, 0, 0], "size": -1.0,
                         "extent": [1, 1, 1]})):  # fmt: skip
        with pytest.raises(BadInput, match="damaged"):
            restored(Scene, {**header, "kept": {**header["kept"], name: wrong}}, tensors, "ball.svv")
    with pytest.raises(BadInput, match="damaged"):
        restored(Scene, header, {k: v for k, v in tensors.items() if k != "kept.there"}, "ball.svv")


def test_values_outlast_the_file_and_every_edit(tmp_path: Path) -> None:
    scene = keeping(solid_ball(), linear)
    camera = front(scene)
    before = scene.probe(camera, (24, 24))
    scene.edited(0, opacity=0.99, name="ball").save(tmp_path / "ball.svv")
    again = Scene.load(tmp_path / "ball.svv")
    after = again.probe(camera, (24, 24))
    assert before is not None and after is not None and after.name == "ball" and after.array == "ball.vti"
    assert after.value == pytest.approx(before.value, abs=2.0)
    assert Scene.from_bytes(again.to_bytes()).kept is not None
    solid_ball().save(tmp_path / "plain.svv")  # as a file of an older version, without the key
    assert Scene.load(tmp_path / "plain.svv").kept is None


def test_of_joined_scenes_each_region_has_the_values_of_its_own() -> None:
    one = keeping(solid_ball(), lambda place: np.full(len(place), 100.0))
    two = keeping(solid_ball(), lambda place: np.full(len(place), 500.0))
    both = joined((one, two))
    for hidden, value in ((1, 100.0), (0, 500.0)):
        found = both.hidden(hidden).probe(front(both), (24, 24))
        assert found is not None and found.region == 1 - hidden
        assert found.value == pytest.approx(value, abs=0.6)


def test_the_value_is_that_of_the_step_that_is_shown() -> None:
    scene = solid_ball()
    grids = [grid_over(scene, lambda place, v=v: np.full(len(place), v)) for v in (100.0, 500.0)]  # type: ignore[misc]
    codes = tuple(packed_codes(grid.codes) for grid in grids)
    box = scene.occupancy.box
    steps = TimeSteps(box, CELLS, (LOW, HIGH), (0.0, 2.5), codes, (None, None), 1)
    found = replace(scene, steps=steps).probe(front(scene), (24, 24))
    assert found is not None and found.value == pytest.approx(500.0, abs=0.6) and found.time == 2.5
    shown = at_step(replace(scene, steps=replace(steps, own=0)), 0).probe(front(scene), (24, 24))
    assert shown is not None and shown.value == pytest.approx(100.0, abs=0.6)


points = st.tuples(*[st.floats(-100.0, 100.0)] * 3)


@given(points, points, points)
def test_distances_and_angles_are_those_of_the_triangle(a: tuple, b: tuple, c: tuple) -> None:  # type: ignore[type-arg]
    (first, second), angle = measure([a, b, c])
    assert first == pytest.approx(math.dist(a, b)) and second == pytest.approx(math.dist(b, c))
    if min(first, second) < 1e-3:
        return
    assert angle is not None and 0.0 <= angle <= 180.0
    third = math.sqrt(max(0.0, first**2 + second**2 - 2 * first * second * math.cos(math.radians(angle))))
    assert third == pytest.approx(math.dist(a, c), rel=1e-4, abs=1e-4)  # the law of cosines
    assert measure([a]) == ([], None) and measure([a, b, c, a])[1] is None


def run(*arguments: str, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr("sys.argv", ["svv", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


def test_the_command_tells_places_distances_and_the_angle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scene, file, out = keeping(solid_ball(), linear), str(tmp_path / "ball.svv"), tmp_path / "told.json"
    scene.save(file)
    at = ("--at", "24,24", "--at", "30,24", "--at", "24,15", "--size", "48")
    told = (*at, "--unit", "mm", "--value-unit", "HU", "--json", str(out))
    assert run("probe", file, *told, monkeypatch=monkeypatch) == 0
    lines = capsys.readouterr().out.splitlines()
    found = json.loads(out.read_text())
    assert len(lines) == 4 and lines[0].startswith("24,24: Region 0 (100 % of the pixel) at ")
    assert " HU of ball.vti" in lines[0] and lines[3].startswith("distances ") and lines[3].endswith("°")
    expected = [scene.probe(front(scene), pixel) for pixel in ((24, 24), (30, 24), (24, 15))]
    for one, other in zip(found["pixels"], expected, strict=True):
        assert other is not None and one["value"] == pytest.approx(other.value, abs=2.0)
        assert one["point"] == pytest.approx(other.point, abs=0.01)
    assert found["distances"] == pytest.approx(measure([one["point"] for one in found["pixels"]])[0])
    assert 0.0 < found["angle"] < 180.0 and found["unit"] == "mm"
    empty = ("--at", "0,0", "--at", "24,24", "--size", "48", "--view", "90,0")
    assert run("probe", file, *empty, monkeypatch=monkeypatch) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "0,0: nothing is visible there" and len(lines) == 2
    for wrong in ((), ("--at", "3"), ("--at", "900,3"), ("--at", "3,3", "--view", "0,0", "--camera", "c.json"),
                  ("--at", "3,3", "--time", "1"), ("--at", "3,3", "--frame", "1")):  # fmt: skip
        assert run("probe", file, *wrong, monkeypatch=monkeypatch) == 2


@pytest.fixture(scope="module")
def views() -> ViewSet:
    image = from_array(1000.0 * ball(32) - 100.0, (2.0, 2.0, 2.0), (5.0, 0.0, -7.0), "density")
    two = bumps((200.0, 200.0, 0.1, BLUE), (700.0, 300.0, 0.8, RED))
    return make_views(image, two, n=10, test=0, size=64)[0]


def test_training_keeps_the_volumes_values_if_it_is_told_to(views: ViewSet) -> None:
    short = preset("draft")
    few = replace(short.reconstruct, iterations=10, rays=256, cells=32)
    short = replace(short, reconstruct=few, recolour=replace(short.recolour, iterations=10, rays=256))
    scene, report = train_scene(views, short, keep_values=True)
    assert scene.kept is not None and any("values are kept: 0.0" in note for note in report["notes"])
    assert scene.kept.bytes <= 1.2 * scene.kept.count  # a byte a voxel, and which these are
    camera = orbit(scene, 181, 48, 48)[90]
    off = []
    for pixel in pixels_of(camera, 3):
        found = scene.probe(camera, pixel)
        if found is None or found.uncertainty is None:
            continue
        index = (np.array([found.point]) - (5.0, 0.0, -7.0)) / 2.0
        own = map_coordinates(1000.0 * ball(32) - 100.0, index[:, ::-1].T, order=1)[0]
        off.append(abs(found.value - own) <= found.uncertainty)
        assert found.array == "density"
    assert len(off) > 30 and np.mean(off) >= 0.95
    assert scene.info()["kept_values"]["bytes"] == scene.kept.bytes
    # Of a volume with voxels half as large, the values are means.
    grid = {**scene.made["source"]["grid"], "spacing": [1.0, 1.0, 1.0]}
    large = replace(scene, made={**scene.made, "source": {**scene.made["source"], "grid": grid}})
    found = large.probe(camera, (24, 24))
    assert found is not None and found.mean_of == 8 and "(mean of 8 voxels)" in found.describe()
    found = scene.probe(camera, (24, 24))
    assert found is not None and found.mean_of == 1
    for other, only, said in ((views, True, "not both"), (replace(views, classified=None), False, "leave it out")):
        with pytest.raises(BadInput, match=said):
            train_scene(other, short, keep_values=True, views_only=only)
