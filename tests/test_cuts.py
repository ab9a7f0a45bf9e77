"""Scenes that are cut open: what a cut takes away, what it leaves, and where it is told or refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

import svv
from svv.cli.app import app
from svv.core.geometry.box import Box
from svv.core.geometry.cameras import Camera, look_at
from svv.core.geometry.cuts import Cut, clip_rays, divide_rays
from svv.errors import BadInput
from svv.fields.radiance.cutting import march_uncut
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.rendering import Marching, Rays
from svv.fields.scene.joined import joined, members
from svv.fields.scene.scene import Scene
from svv.options.baking import BakeOptions
from svv.render.emptiness import why_empty
from svv.render.web.page import html_of
from tests.cube import cube_camera, cube_scene, faint, hash_cube_scene, lit_cube_scene

BOUNDS = ((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5))
SHAPES = ("x>20%", "x<0.1&y>40%", "plane:0,0.1,0:1,2,-1", "box:-0.2,-0.3,0.1:0.3,0.2,0.6", "sphere:0.1,0,0.2:0.3",
          "cylinder:0,0.1,0:1,0.5,0:0.25")  # fmt: skip

numbers = st.floats(-2.0, 2.0)
points = st.tuples(numbers, numbers, numbers)


def side_camera() -> Camera:
    return Camera(look_at((2.0, 1.0, 2.0), (0.0, 0.0, 0.0)), 0.5, 24, 24)


def cut_with(scene: Scene, text: str, outside: bool = False) -> Scene:
    return scene.cut(outside * "outside " + text)


@given(st.sampled_from(SHAPES), st.sampled_from(SHAPES), st.booleans(), points, points)
@settings(deadline=None)
def test_what_is_left_of_a_ray_is_what_no_cut_holds(
    one: str, other: str, outside: bool, start: tuple[float, ...], towards: tuple[float, ...]
) -> None:
    direction = torch.tensor(towards, dtype=torch.float64)
    if float(direction.norm()) < 0.1:
        return
    cuts = [Cut.parse(one, BOUNDS), Cut.parse(outside * "outside " + other, BOUNDS)]
    origin = torch.tensor([start], dtype=torch.float64)
    direction = (direction / direction.norm())[None]
    begin, end = (spans[0] for spans in clip_rays(cuts, origin, direction))
    assert bool((begin[1:] >= begin[:-1]).all())
    t = torch.linspace(0.0, 5.0, 501, dtype=torch.float64)
    depth = torch.stack([cut.depth(origin + t[:, None] * direction) for cut in cuts])
    clear = (depth.abs() > 1e-6).all(0)  # not on a face
    kept = ((t[:, None] >= begin) & (t[:, None] < end)).any(1)
    assert bool((kept == (depth <= 0.0).all(0))[clear].all())


@given(st.sampled_from(SHAPES), st.sampled_from(SHAPES), st.booleans(), points, points)
@settings(deadline=None)
def test_samples_of_divided_rays_stand_for_all_of_them_on_one_side_of_each_face(
    of_all: str, of_some: str, both: bool, start: tuple[float, ...], towards: tuple[float, ...]
) -> None:
    """In a fog of extinction 1, what they stand for is as long as what is left of a ray."""
    direction = torch.tensor([towards])
    if float(direction.norm()) < 0.1:
        return
    direction, origin = direction / direction.norm(), torch.tensor([start]) + 0.5
    occupancy = Occupancy.full(Box((-0.5, -0.5, -0.5), 1.0, (1.0, 1.0, 1.0)), 4)
    cuts = [Cut.parse(text, BOUNDS) for text in (of_all, "1=" + of_some)[0 if both else 1 :]]
    rays, how = Rays(origin, direction), Marching(1 / 16)
    samples = march_uncut(rays, occupancy, None, how, cuts, None)
    whole = [cut.in_box(occupancy.box) for cut in cuts if not cut.regions]
    t = torch.linspace(0.0, 6.0, 6001)
    at = origin + t[:, None] * direction
    left = ((at >= 0.0) & (at <= 1.0)).all(1)
    for cut in whole:
        left &= cut.depth(at) <= 0.0
    stands_for = how.step * float(samples.sigma.sum())
    assert stands_for == pytest.approx(float(left.sum()) * 1e-3, abs=how.step + 4e-3)  # up to half a step at each wall
    begin, end = divide_rays([cut.in_box(occupancy.box) for cut in cuts], origin, direction)
    along = ((samples.position - origin) * direction).sum(1, keepdim=True)
    assert bool(((along > begin - 1e-4) & (along < end + 1e-4)).any(1).all())
    assert bool((along[1:] > along[:-1] - 1e-5).all())


def test_a_face_in_what_stays_is_not_seen() -> None:
    """A cut of a region that is hidden anyway divides rays, and changes nothing else."""
    scene = faint(cube_scene(), 0.1).hidden(1)
    whole, divided = (
        one.render(side_camera(), "pcn").rgba[..., 3] for one in (scene, scene.cut("1=plane:0,0.1,0:1,2,-1"))
    )
    np.testing.assert_allclose(divided, whole, atol=0.06)  # samples lie elsewhere behind a face
    assert float(np.abs(divided - whole).mean()) < 0.004 and abs(float((divided - whole).mean())) < 0.001


@given(st.sampled_from(SHAPES), points, st.floats(1e-3, 1e3), st.booleans())
@settings(deadline=None)
def test_a_cut_is_the_same_in_the_world_and_in_the_box(
    shape: str, low: tuple[float, float, float], size: float, outside: bool
) -> None:
    box, cut = Box(low, size, (1.0, 1.0, 1.0)), Cut.parse(outside * "outside " + shape, BOUNDS)
    world = torch.from_numpy(np.random.default_rng(0).uniform(-1.0, 1.0, (50, 3)))
    inside = torch.from_numpy(box.to_box(world.numpy()))
    np.testing.assert_allclose(cut.in_box(box).depth(inside) * size, cut.depth(world), atol=1e-9 * (1 + size))


@given(
    st.sampled_from((*SHAPES, "plane:0.3,-0.2,0.1:0,1,0", "plane:0,0,0:1,1,0&x>0&sphere:0,0,0:1")),
    st.booleans(),
    st.sets(st.integers(0, 2)),
)
def test_a_cut_is_what_its_text_says(shape: str, outside: bool, regions: set[int]) -> None:
    cut = replace(Cut.parse(outside * "outside " + shape, BOUNDS), regions=tuple(regions))
    text = cut.to_text()
    again, at = (
        Cut.parse(text, ((0.0,) * 3, (9.0,) * 3)),
        torch.from_numpy(np.random.default_rng(0).normal(size=(50, 3))),
    )
    assert (again.outside, again.regions) == (cut.outside, cut.regions)
    np.testing.assert_allclose(again.depth(at), cut.depth(at), atol=1e-12)


@pytest.mark.parametrize("make", [cube_scene, lit_cube_scene, hash_cube_scene])
@pytest.mark.parametrize("shape", SHAPES)
def test_what_a_cut_takes_and_what_it_leaves_are_the_whole(make: Callable[[], Scene], shape: str) -> None:
    """The transmittance of a ray is that of what lies inside of a shape times that of what lies outside."""
    scene = faint(make(), 0.1)
    for camera in (cube_camera(), side_camera()):
        whole, without, only = (
            1.0 - one.render(camera, "pcn").rgba[..., 3].astype(np.float64)
            for one in (scene, cut_with(scene, shape), cut_with(scene, shape, outside=True))
        )
        np.testing.assert_allclose(without * only, whole, atol=0.06)  # samples lie elsewhere behind a face
        assert float(np.abs(without * only - whole).mean()) < 0.004
        assert abs(float((without * only - whole).mean())) < 6e-4  # samples across a face stand for less than a step
        assert float((without - whole).max()) > 0.02


@pytest.mark.parametrize("shape", SHAPES)
def test_a_cut_of_all_regions_one_by_one_is_a_cut(shape: str) -> None:
    scene = faint(cube_scene(), 0.1)
    for camera in (cube_camera(), side_camera()):
        one, other = (cut_with(scene, text).render(camera, "pcn") for text in (shape, f"0,1,2={shape}"))
        np.testing.assert_allclose(one.rgba[..., 3], other.rgba[..., 3], atol=0.005)
        assert float(np.abs(one.rgba[..., 3] - other.rgba[..., 3]).mean()) < 2e-4


def test_other_regions_stay_whole() -> None:
    scene = cube_scene().isolated(1)
    images = [one.render(cube_camera(), "pcn").rgba for one in (scene, scene.cut("0,2=x>-1"), scene.cut("1=x>-1"))]
    np.testing.assert_allclose(images[0], images[1], atol=2e-3)
    assert images[2][..., 3].max() < 1e-3


def test_a_cut_opens_the_view_of_what_was_hidden() -> None:
    """A ray that ended in front of a cut goes on behind it, and depths begin at the face."""
    scene = cube_scene()
    for region in range(3):
        scene = scene.edited(region, opacity=50.0)
    whole, open_ = (one.render(cube_camera(), "pcn") for one in (scene, scene.cut("z>30%")))
    middle = (slice(10, 14), slice(10, 14))
    np.testing.assert_allclose(whole.depth[middle], 2.5, atol=0.06)
    np.testing.assert_allclose(open_.depth[middle], 3.2, atol=0.06)  # the camera is at z = 3, the face at -0.2
    hole = scene.cut("sphere:0,0,0.5:0.4").render(cube_camera(), "pcn")
    np.testing.assert_allclose(hole.depth[middle], 2.9, atol=0.06)
    assert scene.cut("sphere:0,0,0.5:0.4").point_at(cube_camera(), (12, 12))[2] == pytest.approx(0.1, abs=0.06)


def test_what_is_cut_away_wholly_shows_nothing() -> None:
    scene = cube_scene()
    for one in (scene.cut("x>-10"), scene.cut("x>50%", "x<50%"), cut_with(scene, "sphere:9,9,9:1", outside=True)):
        empty = one.render(cube_camera())
        assert not empty.rgba.any() and "its cuts take away all" in why_empty(one, empty.depth)


def test_cuts_are_edits() -> None:
    scene = cube_scene()
    half = scene.cut("x>50%")
    corner = half.cut("0,2=y>50%", "x>50%")  # there already
    assert [cut.describe() for cut in corner.cuts] == ["cut x > 0", "cut y > 0 of regions 0, 2"]
    assert corner.undone().cuts == half.cuts and corner.undone().undone().cuts == ()
    assert corner.undone().redone() == replace(corner, history=corner.undone().redone().history)
    assert corner.uncut().cuts == () and corner.uncut().undone().cuts == corner.cuts
    assert corner.reset().cuts == () and corner.reset(0).cuts == corner.cuts
    again = Scene.from_bytes(corner.to_bytes())
    assert again.cuts == corner.cuts and again.undone().cuts == half.cuts
    np.testing.assert_array_equal(again.render(cube_camera()).rgba, corner.render(cube_camera()).rgba)


def test_an_image_that_is_kept_is_not_that_of_another_cut() -> None:
    scene = cube_scene()
    for _ in range(4):
        images = [one.render(cube_camera(), "pcn").rgba for one in (scene, scene.cut("x>50%"), scene.cut("x>60%"))]
        assert not np.array_equal(images[0], images[1]) and not np.array_equal(images[1], images[2])


def test_a_joined_scene_keeps_the_cuts_of_its_members_and_takes_others() -> None:
    one, other = cube_scene(), cube_scene(1)
    both = joined([one.cut("x>50%"), other.cut("1=y>50%")])
    assert [cut.regions for cut in both.cuts] == [(0, 1, 2), (4,)]
    assert [member.cuts for member in members(both)] == [one.cut("x>50%").cuts, other.cut("1=y>50%").cuts]
    alone = joined([one.cut("x>0%"), other]).render(cube_camera(), "pcn")
    np.testing.assert_allclose(alone.rgba, other.render(cube_camera(), "pcn").rgba, atol=0.02)
    assert not both.cut("x>-1").render(cube_camera(), "pcn").rgba.any()


def test_a_baked_volume_is_cut() -> None:
    scene = cube_scene()
    volume = svv.bake(scene.cut("x>50%", "1=y>50%"), BakeOptions(resolution=16))
    x, y, _ = np.meshgrid(*(o + volume.grid.spacing * np.arange(n) for o, n in zip(
        volume.grid.origin, volume.grid.shape, strict=True)), indexing="ij")  # fmt: skip
    whole, codes = (
        one.rgba[..., 3].transpose(2, 1, 0) for one in (svv.bake(scene, BakeOptions(resolution=16)), volume)
    )
    beyond = x > 2.5 * volume.grid.spacing
    assert whole[beyond].any() and not codes[beyond].any()
    left = x < -0.5 * volume.grid.spacing
    assert (codes[left & (y < 0)] > 0).sum() == (whole[left & (y < 0)] > 0).sum()
    assert 0 < (codes[left & (y > 0.2)] > 0).sum() < (whole[left & (y > 0.2)] > 0).sum()


def test_a_page_has_no_room_for_cuts_of_many_regions_or_planes() -> None:
    with pytest.raises(BadInput, match="at most 6 planes"):
        html_of(
            cube_scene().cut("&".join(["x>10%", "y>10%", "z>10%", "x<90%", "y<90%", "z<90%", "x>20%"])), "Cube", "cube"
        )
    scene = cube_scene()
    many = replace(scene, regions=(*scene.regions, *(replace(scene.regions[0], part_of=0) for _ in range(29))))
    with pytest.raises(BadInput, match="at most 31 regions, not 32: take the cuts away"):
        html_of(many.cut("1=x>50%"), "Cube", "cube")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("x=5", "'x=5' is no cut: give sides"),
        ("", "is no cut"),
        ("x>", "is no cut"),
        ("w>5", "is no cut"),
        ("sphere:1,2,3", "is no cut"),
        ("sphere:1,2,3:-1", "radius of a cut must be above 0, not -1"),
        ("plane:0,0,0:0,0,0", "direction that is not 0"),
        ("cylinder:0,0,0:0,0,0:1", "axis that is not 0"),
        ("x>nan", "is no cut"),
        ("outside", "is no cut"),
        ("box:0,0,inf:1,1,1", "must be finite"),
        ("-1=x>5", "is no cut"),
        ("7=x>5", "There is no region 7: the scene has the regions 0 to 2"),
    ],
)
def test_what_is_no_cut_is_one_sentence(text: str, told: str) -> None:
    with pytest.raises(BadInput, match=told):
        cube_scene().cut(text)


def test_too_many_cuts() -> None:
    scene = cube_scene().cut(*(f"x>{k}" for k in range(16)))
    with pytest.raises(BadInput, match="at most 16 cuts"):
        scene.cut("y>0")


@pytest.mark.parametrize("cuts", [{}, ["x"], [{"planes": [[1, 0, 0]]}], [{"radius": 1}], [{"shape": "x"}]])
def test_a_damaged_file_is_one_sentence(cuts: object, monkeypatch: pytest.MonkeyPatch) -> None:
    from svv.fields.scene import scene_arrays

    scene = cube_scene()

    def with_other(scene: Scene, packed: bool, whole: bool = True) -> tuple[dict[str, object], object]:
        header, arrays = arrays_of(scene, packed, whole)
        return {**header, "cuts": cuts}, arrays

    arrays_of = scene_arrays.arrays_of
    monkeypatch.setattr("svv.fields.scene.scene.arrays_of", with_other)
    content = scene.to_bytes()
    with pytest.raises(BadInput):
        Scene.from_bytes(content)


def test_the_command_cuts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    cube_scene().save("scene.svv")

    def run(*words: str) -> None:
        app(list(words), prog_name="svv", standalone_mode=False)

    run(
        "edit",
        "scene.svv",
        "--cut",
        "x>50%&y>50%",
        "--cut",
        "0=z>0",
        "--cut",
        "outside sphere:0,0,0:0.4",
        "--out",
        "c.svv",
    )
    made = Scene.load("c.svv")
    assert [cut.describe() for cut in made.cuts] == [
        "cut x > 0 and y > 0", "cut z > 0 of region 0", "cut all but ball of radius 0.4 at 0, 0, 0",
    ]  # fmt: skip
    assert len(made.history.past) == 1
    run("edit", "c.svv", "--uncut", "--cut", "z<25%", "--out", "d.svv")
    assert [cut.describe() for cut in Scene.load("d.svv").cuts] == ["cut z < -0.25"]
    run("edit", "c.svv", "--undo", "--out", "e.svv")
    assert Scene.load("e.svv").cuts == ()
    run("info", "c.svv", "--json", "info.json")
    assert json.loads(Path("info.json").read_text())["cuts"] == [cut.describe() for cut in made.cuts]
