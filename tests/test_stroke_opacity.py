"""Opacity that follows strokes: dark or light strokes are as dense as the region, and the ground between is clearer."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from svv.core.strokes.strokes import Brush, straight_stroke
from svv.errors import BadInput
from svv.fields.radiance.networks import UnrestrictedField
from svv.fields.radiance.rendering import RayCaster, march
from svv.fields.scene.images import marching_as_edited
from svv.fields.scene.scene import Scene
from svv.fields.scene.stroke_opacity import LOG_FACTOR, MOST_DEVIATIONS, fade_of, paleness, strokes_of
from svv.fields.strokes.stored_strokes import Brushed
from svv.io import scene_file
from tests.cube import cube_camera, cube_paint, cube_scene

EVERY = {0: "oil", 1: "ink", 2: "oil"}


@pytest.fixture(scope="module")
def painted() -> Scene:
    """The cube, painted all over."""
    cube = cube_scene()
    return cube.painted(strong_paint(cube), EVERY, {}, "oil")


def strong_paint(scene: Scene) -> UnrestrictedField:
    """A painting of more contrast than what comes as it may."""
    network = cube_paint(scene, 1)
    with torch.no_grad():
        dict(network.named_parameters())["colour_mlp.4.weight"].mul_(8.0)
    return network


@pytest.fixture(params=[True, False], ids=["kernels", "torch"])
def image(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch):  # type: ignore[no-untyped-def]
    """Render the cube from the front, with the kernels or without."""
    if not request.param:
        monkeypatch.setattr("svv.fields.scene.images.image_kernels_of", lambda _: None)
    return lambda scene, network=None: scene.render(cube_camera(), network).rgba


def of_one_colour(scene: Scene) -> Scene:
    """The cube painted grey."""
    network = cube_paint(scene, 1)
    with torch.no_grad():
        network.encoding.table.zero_()
    return scene.painted(network, EVERY, {}, "grey")


AMOUNT = st.floats(-1.0, 1.0)


def sigmas(scene: Scene) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Extinctions of samples without strokes and with them, and regions, all (S,)."""
    rays = RayCaster([cube_camera()], scene.occupancy.box, scene.device).view(0)
    samples = march(rays, scene.occupancy, scene.base.density, marching_as_edited(scene, "styled"))
    _, region, sigma = scene.shade(samples, rays, "styled")
    return samples.sigma, sigma, region


@given(st.tuples(AMOUNT, AMOUNT, AMOUNT))
@settings(max_examples=8)
def test_nothing_is_denser_than_its_region_and_nothing_a_hole(
    painted: Scene, amounts: tuple[float, float, float]
) -> None:
    scene = painted
    for number, amount in enumerate(amounts):
        scene = scene.with_stroke_opacity(amount, number)
    before, after, region = sigmas(scene)
    factor = (after / before).log()
    least = -LOG_FACTOR * MOST_DEVIATIONS * torch.tensor(amounts).abs()[region]
    assert torch.all(factor <= 1e-5) and torch.all(factor >= least - 1e-5)


@pytest.mark.parametrize("amount", [1.0, -1.0])
def test_most_paint_is_as_opaque_as_its_region(painted: Scene, amount: float) -> None:
    before, after, region = sigmas(painted.with_stroke_opacity(amount))
    for own in range(3):
        mine = region == own
        assert float((after / before)[mine].mean()) > 0.7


@pytest.mark.parametrize("opacity", [0.2, 3.0])
def test_that_holds_of_regions_as_they_are_edited(painted: Scene, opacity: float) -> None:
    edited = painted.edited(0, opacity=opacity).with_strength(0.7).hidden(1)
    plain, strokes = (s.render(cube_camera()).rgba[..., 3] for s in (edited, edited.with_stroke_opacity(0.8)))
    assert (strokes - plain).max() < 1e-3 and (strokes - plain).min() < -1e-3


@pytest.mark.parametrize("amount", [0.6, -0.6])
def test_strokes_of_one_side_are_more_opaque_than_those_of_the_other(painted: Scene, amount: float) -> None:
    """Above 0 the dark and vivid ones: a factor of paleness alone, one deviation from the mean exp(-LOG_FACTOR a)."""
    scene = painted.with_stroke_opacity(amount)
    strokes = strokes_of(scene)
    assert strokes is not None
    rays = RayCaster([cube_camera()], scene.occupancy.box, scene.device).view(0)
    samples = march(rays, scene.occupancy, scene.base.density, scene.marching_for_images)
    _, region, sigma = scene.shade(samples, rays, "styled")
    factor = (sigma / samples.sigma).log() - strokes[region, 0]
    assert scene.styled is not None
    dark = strokes[region, 2] - paleness(scene.styled(samples.position), strokes[region, 1])
    assert torch.all(factor * dark * amount >= -1e-6)
    assert float(factor.abs().max()) == pytest.approx(0.5 * LOG_FACTOR * MOST_DEVIATIONS * abs(amount), abs=1e-4), (
        "it is clipped"
    )
    middle = (factor.abs() > 1e-3) & (factor.abs() < 0.99 * 0.5 * LOG_FACTOR * MOST_DEVIATIONS * abs(amount))
    torch.testing.assert_close((factor / dark)[middle], strokes[region[middle], 1], rtol=1e-2, atol=1e-3)
    for region_ in range(3):  # the slope is that of a deviation's reach, over a deviation of less than half the range
        assert 2.0 * LOG_FACTOR < float(strokes[region_, 1]) / amount < 100.0


def test_vivid_strokes_are_not_taken_for_pale_ones() -> None:
    """Pure yellow is nearly as luminous as white, but as far from white paper as black."""
    colours = torch.tensor([[1.0, 1.0, 1.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
    assert paleness(colours, torch.ones(4)).tolist() == [1.0, 0.0, 0.0, 0.0]
    assert paleness(colours, -torch.ones(4)).tolist() == [1.0, 1.0, 1.0, 0.0]


@pytest.mark.parametrize("amount", [0.8, -0.8])
def test_it_is_seen_in_alpha(amount: float) -> None:
    """Of a cube whose left half is painted dark and whose right half light."""
    cube = cube_scene()
    network = cube_paint(cube, 1)
    painted = replace(cube.painted(network, EVERY, {}, "oil"), styled=HalfDark(network))
    both = painted, painted.with_stroke_opacity(amount)
    plain, followed = (scene.render(cube_camera()).rgba[..., 3] for scene in both)
    translucent = (plain > 0.1) & (plain < 0.9)
    rise = np.where(translucent, followed - plain, 0.0)
    dark, light = rise[:, :10].sum(), rise[:, 14:].sum()
    assert abs(dark if amount > 0.0 else light) < 1e-3 and (light if amount > 0.0 else dark) < -0.1


class HalfDark(torch.nn.Module):
    """Black where x is below the middle of the box, white beyond."""

    def __init__(self, network: torch.nn.Module) -> None:
        super().__init__()
        self.resolutions, self.direct, self.brushed, self.painted_in = network.resolutions, False, None, None

    def forward(self, position: torch.Tensor) -> torch.Tensor:
        return (position[:, :1] > 0.5).to(position).expand(-1, 3)


def test_none_is_what_it_was_to_the_bit(painted: Scene, image) -> None:  # type: ignore[no-untyped-def]
    off = painted.with_stroke_opacity(0.5).with_stroke_opacity(0.0)
    assert strokes_of(off) is None and strokes_of(painted.with_stroke_opacity(0.5)) is not None
    np.testing.assert_array_equal(image(off), image(painted))
    followed = painted.with_stroke_opacity(0.5)
    assert np.abs(image(followed) - image(painted)).max() > 0.01
    for network in ("base", "pcn"):
        np.testing.assert_array_equal(image(followed, network), image(painted, network))
    np.testing.assert_array_equal(image(followed.with_strength(0.0)), image(painted.with_strength(0.0)))


def test_what_has_no_strokes_stays(painted: Scene, image) -> None:  # type: ignore[no-untyped-def]
    bare = painted.without_variant("oil")
    np.testing.assert_array_equal(image(bare.with_stroke_opacity(1.0)), image(bare))
    one = bare.painted(strong_paint(bare), {0: "oil"}, {}, "oil")
    strokes = strokes_of(one.with_stroke_opacity(1.0))
    assert strokes is not None and strokes[0, 1] > 0.0 and not bool(strokes[1:].any())
    grey = of_one_colour(bare)
    strokes = strokes_of(grey.with_stroke_opacity(1.0))
    assert strokes is not None and not bool(strokes.any())
    np.testing.assert_allclose(image(grey.with_stroke_opacity(1.0)), image(grey), atol=1e-6)


def test_kernels_and_torch_agree(painted: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = painted.with_stroke_opacity(0.8).with_stroke_opacity(-0.5, 2).edited(1, opacity=0.4).with_strength(0.7, 0)
    quick = scene.render(cube_camera())
    monkeypatch.setattr("svv.fields.scene.images.image_kernels_of", lambda _: None)
    plain = scene.render(cube_camera())
    np.testing.assert_allclose(quick.rgba, plain.rgba, atol=2e-5)
    np.testing.assert_allclose(quick.depth, plain.depth, atol=2e-4)


def test_rays_go_on_behind_what_is_made_transparent(painted: Scene) -> None:
    scene = painted.with_stroke_opacity(1.0)
    rays = RayCaster([cube_camera()], scene.occupancy.box, scene.device).view(0)
    samples = march(rays, scene.occupancy, scene.base.density, scene.marching_for_images)
    _, _, sigma = scene.shade(samples, rays, "styled")
    assert fade_of(scene, "styled") <= float((sigma / samples.sigma).min()) + 1e-6
    assert fade_of(scene, "pcn") == fade_of(painted, "styled") == 1.0


def test_samples_are_not_changed(painted: Scene) -> None:
    rays = RayCaster([cube_camera()], painted.occupancy.box, painted.device).view(0)
    samples = march(rays, painted.occupancy, painted.base.density, painted.marching_for_images)
    before = samples.sigma.clone()
    painted.with_stroke_opacity(0.7).shade(samples, rays, "styled")
    assert torch.equal(samples.sigma, before)


def test_files_hold_it_and_it_is_undone(painted: Scene, tmp_path: Path) -> None:
    scene = painted.with_stroke_opacity(0.3, 1).with_stroke_opacity(-1.0).undone()
    assert [r.stroke_opacity for r in scene.regions] == [0.0, 0.3, 0.0]
    assert [step.what for step in scene.history.past] == ["stroke opacity 0.3"]
    scene.save(tmp_path / "new.svv")
    new = Scene.load(tmp_path / "new.svv")
    assert (new.regions, new.history) == (scene.regions, scene.history)
    assert [r.stroke_opacity for r in new.redone().regions] == [-1.0] * 3
    assert new.undone().regions == painted.regions
    header, arrays = painted.to_arrays()
    header["regions"] = [{k: v for k, v in r.items() if k != "stroke_opacity"} for r in header["regions"]]
    scene_file.write_scene_file(tmp_path / "old.svv", header, arrays)
    assert Scene.load(tmp_path / "old.svv").regions == painted.regions


def washed(scene: Scene, glazes: dict[int, float], name: str) -> Scene:
    """The cube painted by strokes that are glazes where a number says how far opacity is to follow them."""
    network = strong_paint(scene)
    works = {k: (straight_stroke((0.2, 0.5, 0.5), (0.8, 0.5, 0.5), 0.05), Brush(0.0, 0.0, 0.0)) for k in range(3)}
    network.brushed = Brushed(works, None, np.full((3, 3), 0.5, np.float32), glazes)
    painted = scene.painted(network, EVERY, {}, name)
    network.brushed = None  # which files have only beside a lattice
    return painted


def test_what_painting_gave_is_no_edit(tmp_path: Path) -> None:
    """Reset took the opacity of glazes, and a region that was painted again kept it with any other hand."""
    first = washed(cube_scene(), {0: 0.3, 2: 0.5}, "washed")
    amounts = lambda scene: [r.stroke_opacity for r in scene.regions]  # noqa: E731
    edited = first.with_stroke_opacity(-0.2, 0).with_stroke_opacity(0.1, 2)
    assert amounts(first) == [0.3, 0.0, 0.5] and amounts(edited) == [-0.2, 0.0, 0.1]
    assert edited.reset().regions == first.regions == edited.undone().undone().regions
    assert amounts(edited.reset(2)) == [-0.2, 0.0, 0.5]
    both = washed(edited, {1: 0.4}, "oil")
    assert amounts(both) == [-0.2, 0.4, 0.1] and amounts(both.reset()) == [0.0, 0.4, 0.0]
    both.save(tmp_path / "both.svv")
    for scene in (both, Scene.load(tmp_path / "both.svv")):
        assert amounts(scene.with_variant("washed")) == amounts(edited)
        assert amounts(scene.reset().with_variant("washed")) == [0.3, 0.0, 0.5]
        assert amounts(scene.reset().with_variant("washed").with_variant("oil")) == [0.0, 0.4, 0.0]
        assert amounts(scene.reset().without_variant("oil").without_variant("washed")) == [0.0, 0.0, 0.0]
    assert amounts(first.with_stroke_opacity(0.0, 2)) == [0.3, 0.0, 0.0]
    plain = first.painted(strong_paint(first), EVERY, {}, "pieces")
    assert amounts(plain) == [0.0, 0.0, 0.0], "paint without strokes"


@pytest.mark.parametrize(
    ("amount", "regions", "words"),
    [(1.5, (), "between -1 and 1"), (-1.1, (), "between -1 and 1"), (float("nan"), (), "between -1 and 1"),
     (0.5, (7,), "no region 7")],
)  # fmt: skip
def test_amounts_that_cannot_be_are_one_sentence(
    painted: Scene, amount: float, regions: tuple[int, ...], words: str
) -> None:
    with pytest.raises(BadInput, match=words):
        painted.with_stroke_opacity(amount, *regions)
