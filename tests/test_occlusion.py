"""Ambient occlusion: dark where little light arrives, the same in every kind of picture, kept like any other edit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from svv.cli import app as cli
from svv.errors import BadInput
from svv.fields.radiance.networks import PaletteField
from svv.fields.scene.image import image_kernels_of
from svv.fields.scene.joined import joined
from svv.fields.scene.occlusion import _directions, occlude
from svv.fields.scene.occlusion_kernels import mean_transmittance
from svv.fields.scene.scene import Scene
from svv.job.looks.file import from_json, to_json
from svv.job.looks.look import Look
from svv.options.baking import BakeOptions
from svv.render.baking.baked import bake
from svv.render.figures.swatches import swatch
from svv.render.web.page import html_of, write_html
from tests.cube import cube_camera, cube_paint, cube_scene, hash_cube_scene, lit_cube_scene
from tests.nightly import nightly

WALLS = np.zeros((33, 33, 33), np.float32)
"""Opaque where x < 8, where y < 8, and in a floor below z = 8."""


def light_at(field: NDArray[np.float32], *places: tuple[int, int, int]) -> NDArray[np.float32]:
    found = np.zeros(len(places), np.float32)
    mean_transmittance(field, np.array(places), _directions(), 0.5, 14.0, 1.0, 6.0, found)
    return found


def test_light_is_what_matter_leaves_of_all_directions() -> None:
    floor, edge, corner = (WALLS.copy() for _ in range(3))
    for field, axes in ((floor, 1), (edge, 2), (corner, 3)):
        for axis in range(axes):
            np.moveaxis(field, axis, 0)[:9] = 50.0
    at = (9, 9, 9)
    found = [float(light_at(field, at)[0]) for field in (WALLS, floor, edge, corner)]
    assert found[0] == 1.0
    assert found[1:] == pytest.approx([0.5, 0.25, 0.125], abs=0.07), "half of all directions, a quarter, an eighth"
    assert light_at(floor, (3, 16, 16))[0] < 0.01 and light_at(floor, (24, 16, 16))[0] == 1.0
    thin = floor * (0.05 / 50.0)
    assert found[1] < float(light_at(thin, at)[0]) < 1.0, "translucent matter shades less"


@pytest.mark.parametrize("lit", [False, True])
@pytest.mark.parametrize("painted", [False, True])
def test_kernels_and_plain_torch_agree(lit: bool, painted: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    plain_scene = (lit_cube_scene() if lit else cube_scene()).edited(2, matcap="chalk")
    if painted:
        plain_scene = plain_scene.painted(cube_paint(plain_scene, 1), {0: "oil", 1: "oil"}, {}, "oil")
    scene = plain_scene.with_occlusion(1.0)
    assert image_kernels_of(scene) is not None
    fast, before = scene.render(cube_camera()), plain_scene.render(cube_camera())
    monkeypatch.setattr("svv.fields.scene.images.image_kernels_of", lambda scene: None)
    np.testing.assert_allclose(fast.rgba, scene.render(cube_camera()).rgba, atol=2e-3)
    np.testing.assert_allclose(fast.rgba[..., 3], before.rgba[..., 3], atol=1e-5)
    assert (before.rgba - fast.rgba)[..., :3].max() > 0.015 and (before.rgba - fast.rgba).min() > -2e-3


def test_amounts_lie_between_none_and_all(cube: Scene) -> None:
    place, region = torch.rand(99, 3, generator=torch.Generator().manual_seed(0)), torch.arange(99) % 3
    scene = cube.with_occlusion(1.0, 0).with_occlusion(0.5, 1)
    found = torch.ones(99, 3)
    occlude(scene, found, place, region)
    whole = torch.ones(99, 3)
    occlude(cube.with_occlusion(1.0), whole, place, region)
    assert torch.equal(found[region == 0], whole[region == 0]) and bool((found[region == 2] == 1.0).all())
    torch.testing.assert_close(found[region == 1], 0.5 + 0.5 * whole[region == 1])
    assert 0.0 <= float(whole.min()) < 0.97 and float(whole.max()) <= 1.0


def test_hidden_regions_cast_no_shade_and_edits_are_noticed() -> None:
    scene = cube_scene().with_occlusion(1.0)
    place, region = torch.rand(200, 3, generator=torch.Generator().manual_seed(1)), torch.zeros(200, dtype=torch.int64)

    def seen(scene: Scene) -> torch.Tensor:
        colour = torch.ones(200, 3)
        occlude(scene, colour, place, region)
        return colour

    first = seen(scene)
    assert not torch.equal(seen(scene.hidden(1, 2)), first) and torch.equal(seen(scene), first)
    assert bool((seen(scene.edited(0, opacity=1e-6).hidden(1, 2)) > 0.9).all())
    assert scene.base.density is not None
    scene.base.density.table.sub_(4.0)
    assert not torch.equal(seen(scene), first)


def test_another_palette_is_noticed_even_where_the_old_one_was_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("svv.fields.scene.occlusion.id", lambda thing: 0, raising=False)  # as if freed before
    scene = cube_scene().hidden(0).with_occlusion(1.0)
    old = scene.palette_network
    assert old is not None
    new = PaletteField(scene.settings, scene.occupancy, scene.base.geometry_width, old.colours.detach())
    new.encoding.randomize(3.0, torch.Generator().manual_seed(9))
    assert new.encoding.table._version == old.encoding.table._version
    place, region = torch.rand(200, 3, generator=torch.Generator().manual_seed(1)), torch.ones(200, dtype=torch.int64)
    seen = [torch.ones(200, 3) for _ in range(2)]
    for colour, palette in zip(seen, (old, new.requires_grad_(False)), strict=True):
        occlude(replace(scene, palette_network=palette), colour, place, region)
    assert not torch.equal(*seen)


def test_it_is_an_edit_kept_in_file_history_and_look(cube: Scene, tmp_path: Path) -> None:
    scene = cube.with_occlusion(0.7)
    assert [step.what for step in scene.history.past] == ["occlusion 0.7"]
    scene.save(tmp_path / "a.svv")
    assert Scene.load(tmp_path / "a.svv").regions == scene.regions
    look = Look(**vars(from_json(to_json(Look.of(scene)), "it")))
    assert [r.occlusion for r in look.applied(cube).scene.regions] == [0.7] * 3
    assert scene.undone().regions == cube.regions and scene.reset().regions == cube.regions
    told = to_json(Look.of(scene))
    told["regions"][0]["edits"]["occlusion"] = 2.0
    with pytest.raises(BadInput, match="occlusion"):
        from_json(told, "it")


def test_a_swatch_is_a_sphere_in_the_open(cube: Scene) -> None:
    plain, deep = (swatch(s, 0, cube_camera(64), "pcn", 24, 20.0) for s in (cube, cube.with_occlusion(1.0)))
    assert plain is not None and deep is not None
    np.testing.assert_array_equal(plain, deep)


def test_what_cannot_be_is_refused(cube: Scene, tmp_path: Path) -> None:
    for amount in (-0.1, 1.5, float("nan")):
        with pytest.raises(BadInput, match="ambient occlusion must lie between 0 and 1"):
            cube.with_occlusion(amount)
    with pytest.raises(BadInput, match="no region 9"):
        cube.with_occlusion(0.5, 9)
    with pytest.raises(BadInput, match="in a hash grid: train it again"):
        hash_cube_scene().with_occlusion(0.5)
    with pytest.raises(BadInput, match="in a hash grid: train it again"):
        joined([cube, hash_cube_scene()]).with_occlusion(0.5)
    painted = cube.painted(cube_paint(cube, 1), {2: "oil"}, {})
    for scene, words in (
        (cube.with_occlusion(0.5).edited(1, matcap="jade"), "Region 1 has ambient occlusion and a MatCap, and no page"),
        (painted.with_occlusion(0.5).with_stroke_opacity(0.5, 2), "Region 2 has ambient occlusion and opacity that"),
    ):
        with pytest.raises(BadInput, match=words):
            write_html(tmp_path / "a.html", scene, "a")


def test_members_of_a_joined_scene_shade_themselves(cube: Scene) -> None:
    both = joined([cube, cube_scene(1)])
    plain, deep = (scene.render(cube_camera()).rgba for scene in (both, both.with_occlusion(1.0)))
    assert (plain - deep)[..., :3].max() > 0.015 and (plain - deep).min() > -2e-3


def test_a_baked_volume_has_it(cube: Scene) -> None:
    plain, deep = (bake(scene, BakeOptions(resolution=16)).rgba for scene in (cube, cube.with_occlusion(1.0)))
    seen = plain[..., 3] > 0
    np.testing.assert_array_equal(plain[..., 3], deep[..., 3])
    change = plain[..., :3][seen].astype(int) - deep[..., :3][seen]
    assert change.max() > 5 and change.mean() > 0.5 and change.min() >= -1


@pytest.mark.parametrize("painted", nightly([False, True], True))
def test_the_page_shows_it_as_the_renderer_does(open_page: Any, balls: Scene, tmp_path: Path, painted: bool) -> None:
    plain = balls
    if painted:
        styles = dict.fromkeys(range(len(balls.regions)), "oil")
        plain = balls.painted(cube_paint(balls, 1), styles, {}, "oil")
    scene = plain.with_occlusion(1.0)
    write_html(tmp_path / "page.html", scene, "occlusion")
    opened = open_page(tmp_path / "page.html", size=(400, 300))
    opened.ready()
    camera = scene.rig.orbit(181, 96, frames=[90])[0]
    assert opened.psnr(scene, camera) > max(28.0, opened.psnr(plain, camera) + 1.0)


def test_the_command(cube: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    replace(cube, history=cube.history).save("a.svv")

    def run(*arguments: str) -> list[float]:
        cli.app(["edit", *arguments, "--out", "b.svv"], prog_name="svv", standalone_mode=False)
        return [region.occlusion for region in Scene.load("b.svv").regions]

    assert run("a.svv", "--occlusion", "0.6") == [0.6] * 3
    assert run("b.svv", "--region", "1", "--occlusion", "0") == [0.6, 0.0, 0.6]
    assert run("b.svv", "--undo") == [0.6] * 3


def test_opacity_of_strokes_that_are_not_there_is_no_reason_to_refuse_a_page(cube: Scene) -> None:
    assert html_of(cube.with_occlusion(0.5).with_stroke_opacity(0.4), "plain", "plain")
