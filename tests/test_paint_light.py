"""Light on paint: form is visible, the style's brightness is preserved, and unpainted regions do not change."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from svv.core.geometry.cameras import sphere_cameras
from svv.errors import BadInput
from svv.fields.scene.paint_light import lights_of, mean_lights
from svv.fields.scene.scene import Scene
from svv.io import scene_file
from svv.options.editing import PAINT_LIGHT
from tests.cube import cube_camera, cube_paint, cube_scene, lit_cube_scene

EVERY = {0: "oil", 1: "ink", 2: "oil"}
KEPT = 0.01
"""Part of its brightness by which paint may differ from unlit paint."""


def dark_cube() -> Scene:
    """The cube under a learned light that takes away most of what it falls on."""
    cube = cube_scene()
    assert cube.palette_network is not None and cube.palette_network.lighting_mlp is not None
    last = dict(cube.palette_network.lighting_mlp.named_parameters())["4.weight"]
    with torch.no_grad():  # what comes in is not negative, so the shade is below 1
        last.copy_(-last.abs() * torch.tensor([[1.0], [12.0]]))
    return Scene.from_bytes(cube.to_bytes())


def dark_lit_cube() -> Scene:
    """The cube under an explicit light of which it gives little back."""
    cube = lit_cube_scene()
    assert cube.palette_network is not None and cube.palette_network.phong is not None
    with torch.no_grad():
        cube.palette_network.phong.raw[:, :3] = torch.tensor(
            [[-1.5, -1.0, -5.0], [-2.0, 0.0, -5.0], [-1.0, -1.0, -4.0]]
        )
    return cube


@pytest.fixture(scope="module", params=[dark_cube, dark_lit_cube], ids=["network", "phong"])
def painted(request: pytest.FixtureRequest) -> Scene:
    """The cube, painted all over."""
    cube = request.param()
    return cube.painted(cube_paint(cube, 1), EVERY, {}, "oil")


@pytest.fixture(params=[True, False], ids=["kernels", "torch"])
def image(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch):  # type: ignore[no-untyped-def]
    """Render the cube from the front, with the kernels or without."""
    if not request.param:
        monkeypatch.setattr("svv.fields.scene.images.image_kernels_of", lambda _: None)
    return lambda scene, network=None: scene.render(cube_camera(), network).rgba


def unlit(scene: Scene) -> Scene:
    """The scene in its flat colours."""
    return replace(scene, regions=tuple(replace(r, lighting=0.0) for r in scene.regions))


def as_multiplied(scene: Scene) -> Scene:
    """The scene with the learned shade itself on its paint."""
    return replace(scene, regions=tuple(replace(r, paint_light=1.0, mean_light=(1.0, 0.0)) for r in scene.regions))


def brightness(scene: Scene) -> float:
    """Mean over what is seen from all around."""
    total = np.zeros(2)
    for camera in sphere_cameras(6, (0.0, 0.0, 0.0), 3.0, 0.5, 24):
        rgba = scene.render(camera).rgba
        total += (rgba[..., :3].mean(axis=2) * rgba[..., 3]).sum(), rgba[..., 3].sum()
    return float(total[0] / total[1])


def test_without_light_paint_is_as_it_was_painted(painted: Scene, image) -> None:
    np.testing.assert_array_equal(image(painted.with_paint_light(0.0)), image(unlit(painted)))


@pytest.mark.parametrize("amount", [PAINT_LIGHT, 1.0])
def test_lit_paint_is_as_bright_as_unlit_paint(painted: Scene, amount: float) -> None:
    lit, flat = painted.with_paint_light(amount), unlit(painted)
    assert brightness(lit) == pytest.approx(brightness(flat), rel=KEPT)
    assert brightness(as_multiplied(painted)) < 0.8 * brightness(flat)
    assert np.abs(lit.render(cube_camera()).rgba - flat.render(cube_camera()).rgba).max() > 0.05, "form is seen"


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 2.0))
def test_the_mean_light_leaves_paint_as_it_is(painted: Scene, amount: float, strength: float, lighting: float) -> None:
    """1 + f (a m - 1) and f (c_s - b) are linear, so it is enough that they give the mean of both at the means."""
    region = replace(painted.regions[0], lighting=lighting)
    scene = replace(painted, regions=(region, *painted.regions[1:])).with_paint_light(amount).with_strength(strength)
    factor, scale, less = lights_of(scene, "styled")[0].double().tolist()
    shade, specular = mean_lights(painted)[0]
    assert factor * (scale * shade - 1.0) == pytest.approx((1.0 - strength) * lighting * (shade - 1.0), abs=1e-5)
    assert factor * (specular - less) == pytest.approx((1.0 - strength) * lighting * specular, abs=1e-5)


def test_more_light_is_more_contrast(painted: Scene) -> None:
    flat = unlit(painted).render(cube_camera()).rgba
    change = [
        np.abs(painted.with_paint_light(amount).render(cube_camera()).rgba - flat).mean()
        for amount in (0.0, 0.3, PAINT_LIGHT, 1.0)
    ]
    assert change[0] == 0.0 and np.all(np.diff(change) > 0.0)


def test_what_is_not_painted_is_as_before_to_the_bit(painted: Scene, image) -> None:
    bare = painted.without_variant("oil").edited(1, lighting=1.3)
    one = bare.painted(cube_paint(bare, 1), {0: "oil"}, {}, "oil")
    for amount in (0.0, PAINT_LIGHT, 1.0):
        np.testing.assert_array_equal(image(bare.with_paint_light(amount)), image(bare))
        lit = one.with_paint_light(amount)
        np.testing.assert_array_equal(image(lit, "pcn"), image(bare))
        np.testing.assert_array_equal(image(lit.hidden(0)), image(bare.hidden(0)))
        assert lights_of(lit, "styled")[1:].tolist() == torch.tensor([[1.3, 1.0, 0.0], [1.0, 1.0, 0.0]]).tolist()


def test_strength_goes_from_the_palette_s_light_to_the_paint_s(painted: Scene, image) -> None:
    none = painted.with_paint_light(0.2).with_strength(0.0)
    np.testing.assert_allclose(image(none), image(painted, "pcn"), atol=1e-6)


def test_kernels_and_torch_agree(painted: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = painted.with_paint_light(0.8, 0, 2).with_strength(0.7, 1)
    quick = scene.render(cube_camera()).rgba
    monkeypatch.setattr("svv.fields.scene.images.image_kernels_of", lambda _: None)
    np.testing.assert_allclose(quick, scene.render(cube_camera()).rgba, atol=2e-5)


def test_the_mean_of_a_constant_shade_is_that() -> None:
    cube = lit_cube_scene()
    assert cube.palette_network is not None and cube.palette_network.phong is not None
    with torch.no_grad():  # softplus(-60) is 0: no diffuse light, so that the shade is the ambient light everywhere
        cube.palette_network.phong.raw[:, :3] = torch.tensor([-1.0, -60.0, -60.0])
    expected = float(torch.nn.functional.softplus(torch.tensor(-1.0)))
    np.testing.assert_allclose(mean_lights(cube), [(expected, 0.0)] * 3, atol=1e-6)
    black = lit_cube_scene()
    assert black.palette_network is not None and black.palette_network.phong is not None
    with torch.no_grad():
        black.palette_network.phong.raw.fill_(-60.0)
    assert np.isfinite(black.painted(cube_paint(black, 1), EVERY, {}).render(cube_camera()).rgba).all()


def test_edits_do_not_change_what_is_counted_from(painted: Scene) -> None:
    means = [r.mean_light for r in painted.regions]
    edited = painted.edited(0, opacity=0.3, lighting=2.0).hidden(1)
    again = edited.painted(cube_paint(edited, 2), EVERY, {}, "other")
    assert [r.mean_light for r in again.regions] == means == list(mean_lights(painted))
    assert all(r.mean_light is None for r in painted.without_variant("oil").regions)
    assert painted.without_variant("oil").with_edits_of(edited).regions[0].mean_light is None


def test_files_hold_it_and_older_ones_get_it(painted: Scene, tmp_path: Path) -> None:
    scene = painted.with_paint_light(0.3, 1).with_paint_light(1.0, 2).undone()
    scene.save(tmp_path / "new.svv")
    new = Scene.load(tmp_path / "new.svv")
    assert (new.regions, new.history) == (scene.regions, scene.history)
    assert new.redone().regions == painted.with_paint_light(0.3, 1).with_paint_light(1.0, 2).regions
    header, arrays = painted.to_arrays()
    left_out = ("paint_light", "mean_light")
    header["regions"] = [{k: v for k, v in r.items() if k not in left_out} for r in header["regions"]]
    scene_file.write_scene_file(tmp_path / "old.svv", header, arrays)
    painted.save(tmp_path / "painted.svv")
    old, now = Scene.load(tmp_path / "old.svv"), Scene.load(tmp_path / "painted.svv")
    assert [(r.paint_light, r.mean_light) for r in old.regions] == [(PAINT_LIGHT, None)] * 3
    np.testing.assert_allclose(old.render(cube_camera()).rgba, now.render(cube_camera()).rgba, atol=1e-3)


@pytest.mark.parametrize(
    ("amount", "regions", "words"),
    [(1.5, (), "between 0 and 1"), (-0.1, (), "between 0 and 1"), (float("nan"), (), "between 0 and 1"),
     (0.5, (7,), "no region 7")],
)  # fmt: skip
def test_light_that_cannot_be_is_one_sentence(
    painted: Scene, amount: float, regions: tuple[int, ...], words: str
) -> None:
    with pytest.raises(BadInput, match=words):
        painted.with_paint_light(amount, *regions)
