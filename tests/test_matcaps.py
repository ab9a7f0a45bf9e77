"""MatCaps: looked up by the normal, kept with the region, the same in every kind of picture, and refused if unfit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from svv.cli import app as cli
from svv.core.colour.matcaps import MATCAPS, matcap_colours, matcap_picture
from svv.errors import BadInput
from svv.fields.scene.image import image_kernels_of
from svv.fields.scene.matcap_pictures import picture_of, validate_matcap
from svv.fields.scene.matcaps import SMOOTHING, normals_at
from svv.fields.scene.scene import Scene
from svv.job.looks.file import from_json, to_json
from svv.job.looks.look import Look
from svv.options.baking import BakeOptions
from svv.render.baking.baked import Baker
from svv.render.figures.swatches import swatch
from svv.render.frames import seen_from
from svv.render.web.page import write_html
from tests.cube import cube_camera, cube_scene, hash_cube_scene, lit_cube_scene

HALVES = np.zeros((64, 64, 3), np.float32)
"""Red at the left, blue at the right; the upper half is lighter."""
HALVES[:, :32, 0] = HALVES[:, 32:, 2] = 0.5
HALVES[:32] *= 2.0


@pytest.fixture
def halves(tmp_path: Path) -> Path:
    """The file of such a picture."""
    Image.fromarray((255 * HALVES).astype(np.uint8)).save(tmp_path / "halves.png")
    return tmp_path / "halves.png"


def test_normals_look_up_where_the_picture_faces_their_way() -> None:
    picture, up = torch.from_numpy(HALVES), torch.tensor([0.0, 1.0, 0.0])
    facing = torch.tensor([[0.0, 0.0, 1.0]]).expand(4, 3)
    normal = torch.tensor([[-0.6, 0.6, 0.5], [0.6, 0.6, 0.5], [-0.6, -0.6, 0.5], [0.9, -0.5, -0.2]])
    found = matcap_colours(normal, facing, up, picture)
    expected = torch.tensor([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.5, 0.0, 0.0], [0.0, 0.0, 0.5]])
    torch.testing.assert_close(found, expected)
    # The back of a sheet is seen from inside: its other side faces the viewer.
    torch.testing.assert_close(matcap_colours(-normal[:3], facing[:3], up, picture), found[:3])


def test_a_turned_camera_and_its_ray_turn_the_picture_with_them() -> None:
    picture, facing = torch.from_numpy(matcap_picture("porcelain").copy()), torch.tensor([[0.0, 0.0, 1.0]])
    normal, up = torch.tensor([[0.3, 0.5, 0.8]]), torch.tensor([0.0, 1.0, 0.0])
    normal = normal / normal.norm()
    turn = torch.linalg.qr(torch.randn(3, 3, generator=torch.Generator().manual_seed(1)))[0]
    turn = turn * torch.linalg.det(turn).sign()
    a = matcap_colours(normal, facing, up, picture)
    torch.testing.assert_close(matcap_colours(normal @ turn.T, facing @ turn.T, turn @ up, picture), a)


@pytest.mark.parametrize("name", MATCAPS)
def test_every_matcap_that_ships_is_a_lit_sphere(name: str) -> None:
    picture = matcap_picture(name, 64)
    assert picture.shape == (64, 64, 3) and np.isfinite(picture).all() and 0.0 <= picture.min() <= picture.max() <= 1.0
    assert np.ptp(picture.mean(2)[16:48, 16:48]) > 0.05
    assert np.abs(picture - matcap_picture(name, 64)).max() == 0.0


def test_the_gradient_points_out_of_a_ball(balls: Scene) -> None:
    scene = balls.edited(0, matcap="clay")
    seen = scene.render(seen_from(scene, 0.0, 0.0, 64, 64), "pcn")
    flat = picture_of("clay").reshape(-1, 3).numpy()
    own = seen.rgba[(seen.region == 0) & (seen.rgba[..., 3] > 0.98)][:, :3]
    assert len(own) > 20
    nearest = np.abs(own[:, None] - flat[None, ::7]).sum(2).min(1)
    assert np.median(nearest) < 0.05, "colours of the picture alone, whatever the region's own light"
    assert SMOOTHING >= 1.0


@pytest.mark.parametrize("lit", [False, True])
def test_kernels_and_plain_torch_agree(lit: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = (lit_cube_scene() if lit else cube_scene()).edited(0, matcap="jade").edited(2, matcap="toon")
    assert image_kernels_of(scene) is not None
    fast = scene.render(cube_camera(), "pcn")
    monkeypatch.setattr("svv.fields.scene.images.image_kernels_of", lambda scene: None)
    plain = scene.render(cube_camera(), "pcn")
    np.testing.assert_allclose(fast.rgba, plain.rgba, atol=2e-3)
    before = (lit_cube_scene() if lit else cube_scene()).render(cube_camera(), "pcn").rgba
    assert np.abs(plain.rgba - before).max() > 0.1 and np.abs(plain.rgba[..., 3] - before[..., 3]).max() < 1e-5


def test_normals_follow_a_changed_extinction() -> None:
    scene = cube_scene()
    place = torch.rand(50, 3, generator=torch.Generator().manual_seed(0))
    before = normals_at(scene, place)
    assert torch.equal(normals_at(scene.edited(0, opacity=0.1), place), before)
    assert scene.base.density is not None
    scene.base.density.table.mul_(-1.0)
    assert (normals_at(scene, place) - before).abs().max() > 0.1


def test_a_matcap_is_an_edit_kept_in_file_history_and_look(cube: Scene, halves: Path, tmp_path: Path) -> None:
    scene = cube.edited(0, matcap=str(halves)).edited(1, matcap="X-Ray")
    assert scene.regions[1].matcap == "x-ray"
    said = [step.what for step in scene.history.past]
    assert said == ["region 0: matcap of a picture", "region 1: matcap x-ray"]
    scene.save(tmp_path / "a.svv")
    loaded = Scene.load(tmp_path / "a.svv")
    assert loaded.regions == scene.regions
    camera = cube_camera()
    np.testing.assert_array_equal(loaded.render(camera).rgba, scene.render(camera).rgba)
    look = Look(**vars(from_json(to_json(Look.of(scene)), "it")))
    np.testing.assert_array_equal(look.applied(cube).scene.render(camera).rgba, scene.render(camera).rgba)
    assert scene.undone().undone().regions == cube.regions
    assert scene.edited(0, matcap="none").regions[0].matcap is None
    found = picture_of(str(scene.regions[0].matcap)).numpy()
    assert np.abs(found - HALVES)[4:-4, 4:28].max() < 0.05


def test_what_is_no_matcap_is_refused(cube: Scene, tmp_path: Path) -> None:
    Image.new("RGB", (64, 48)).save(tmp_path / "wide.png")
    Image.new("RGB", (8, 8)).save(tmp_path / "tiny.png")
    (tmp_path / "text.png").write_text("no picture")
    for text, words in (
        ("granite", "no MatCap 'granite': choose one of clay, wax"),
        (str(tmp_path / "wide.png"), "64 x 48 pixels, but a MatCap is square"),
        (str(tmp_path / "tiny.png"), "at least 16 x 16"),
        (str(tmp_path / "text.png"), "not a picture"),
        (str(tmp_path), "no MatCap"),
        ("data:image/png;base64,AAAA", "is broken"),
    ):
        with pytest.raises(BadInput, match=words):
            cube.edited(0, matcap=text)
    with pytest.raises(BadInput, match="hash grid: train it again"):
        hash_cube_scene().edited(0, matcap="jade")
    strange = replace(cube, regions=(replace(cube.regions[0], matcap="granite"), *cube.regions[1:]))
    with pytest.raises(BadInput, match="has no MatCap 'granite'"):
        strange.render(cube_camera())
    look = to_json(Look.of(cube.edited(0, matcap="jade")))
    for path in ("/etc/passwd", "../a.png"):
        look["regions"][0]["edits"]["matcap"] = path
        with pytest.raises(BadInput, match="no MatCap"):
            from_json(look, "it")
    assert validate_matcap("none") is None


def test_a_volume_cannot_hold_it(cube: Scene) -> None:
    scene = cube.edited(1, matcap="wax")
    with pytest.raises(BadInput, match="Region 1 has a MatCap, whose colours follow the viewer"):
        Baker().bake(scene, BakeOptions())
    Baker().bake(scene.hidden(1), BakeOptions(resolution=16))


def test_the_legend_shows_its_sphere(cube: Scene) -> None:
    found = swatch(cube.edited(0, matcap="toon"), 0, cube_camera(64), "pcn", 48, 20.0)
    assert found is not None
    expected = np.asarray(Image.fromarray((255 * matcap_picture("toon")).astype(np.uint8)).resize((48, 48))) / 255.0
    assert np.abs(found[8:40, 8:40, :3] - expected[8:40, 8:40]).mean() < 0.03


@pytest.mark.parametrize("lit", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_the_page_shows_it_as_the_renderer_does(open_page: Any, balls: Scene, tmp_path: Path, lit: bool) -> None:
    scene = (lit_cube_scene() if lit else balls).edited(0, matcap="clay").edited(1, matcap="x-ray")
    write_html(tmp_path / "page.html", scene, "matcaps")
    opened = open_page(tmp_path / "page.html", size=(400, 300))
    opened.ready()
    camera = scene.rig.orbit(181, 96, frames=[90])[0]
    plain = scene.edited(0, matcap="none").edited(1, matcap="none")
    assert opened.psnr(scene, camera) > max(26.0, opened.psnr(plain, camera) + 6.0)


def test_the_command(
    cube: Scene, halves: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    cube.save("a.svv")

    def run(*arguments: str) -> None:
        cli.app(["edit", *arguments], prog_name="svv", standalone_mode=False)

    run("a.svv", "--matcap", "0=jade", "--matcap", f"2={halves.name}", "--name", "0=stone", "--out", "b.svv")
    scene = Scene.load("b.svv")
    assert scene.regions[0].matcap == "jade" and scene.regions[0].name == "stone" and len(scene.history.past) == 1
    assert scene.regions[2].matcap == validate_matcap(str(halves))
    run("b.svv", "--matcap", "0=none", "--out", "c.svv")
    assert Scene.load("c.svv").regions[0].matcap is None
    with pytest.raises(BadInput, match="for example --matcap 0=jade"):
        run("a.svv", "--matcap", "jade", "--out", "d.svv")
    with pytest.raises(BadInput, match="no region 9"):
        run("a.svv", "--matcap", "9=jade", "--out", "d.svv")
