"""Explicit lights: laws of Blinn-Phong, a sphere whose normals are known, and lights in edits and files."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from svv.cli.app import app
from svv.core.colour.light import RIM_COSINE, Lamp, blinn_phong
from svv.core.colour.shading import Shading
from svv.core.geometry.cameras import Camera, look_at
from svv.dvr.draw.views import make_views
from svv.errors import BadInput, Cancelled, Progress, silent
from svv.fields.radiance.phong import Beams
from svv.fields.radiance.rendering import march
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet
from svv.job.run import run_job
from svv.job.source import ViewSource
from svv.job.stages import Stages
from svv.job.steps import Job, JobSettings
from svv.options.making import TrainOptions
from svv.train.palette.lighting import headlight_of, light_by_trial, light_for
from svv.train.palette.recolour import recolour
from svv.train.pipeline import train_scene
from svv.train.run.checkpoint import Checkpoint
from svv.train.run.config import PRESETS
from svv.train.run.loop import Running
from svv.train.run.report import Report
from svv_bench.stability.scenes import KnownScene, Range
from tests.cube import cube_camera, lit_cube_scene

DRAFT = PRESETS["draft"]
SHORT = replace(
    DRAFT,
    reconstruct=replace(DRAFT.reconstruct, iterations=80, rays=1024, samples=8192, cells=32),
    recolour=replace(DRAFT.recolour, iterations=60, rays=1024, samples=8192),
)
State = dict[str, torch.Tensor]
RADIUS = 0.7
"""Of the sphere, half a side of the volume."""

ANGLES = st.tuples(st.floats(-180, 180), st.floats(-90, 90))
VECTORS = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1)


def sphere() -> KnownScene:
    """An opaque red ball whose values rise inwards."""
    return KnownScene(
        lambda p: np.clip(0.5 + (RADIUS - np.linalg.norm(p, axis=0)) / 0.4, 0.0, 1.0),
        (Range(0.5, 1.1, 0.95, (0.9, 0.2, 0.15)),),
    )


def unit(v: object) -> torch.Tensor:
    return torch.nn.functional.normalize(torch.tensor([v], dtype=torch.float64), dim=1)


@settings(max_examples=60)
@given(VECTORS, VECTORS, VECTORS, st.tuples(*[st.floats(0, 2)] * 4), st.floats(1, 50))
def test_blinn_phong_is_its_equation_on_either_side(
    n: tuple[float, ...],
    v: tuple[float, ...],
    toward_light: tuple[float, ...],
    k: tuple[float, ...],
    p: float,
) -> None:
    normal, facing, toward = unit(n), unit(v), unit(toward_light)
    ambient, diffuse, specular, intensity = k
    coefficients = torch.tensor([[ambient, diffuse, specular, p]], dtype=torch.float64)
    got = blinn_phong(normal, facing, toward, intensity, coefficients)
    rim = RIM_COSINE * min(max(1.0 - float((facing * toward).sum()), 0.0), 1.0)
    if abs(float((normal * facing).sum())) > rim + 1e-6:  # a surface seen edge-on is not turned
        turned = blinn_phong(-normal, facing, toward, intensity, coefficients)
        torch.testing.assert_close(got, turned)
    seen = -normal if float((normal * facing).sum()) < -rim else normal
    cosine = max(float((seen * toward).sum()), 0.0)
    assert float(got[1]) == pytest.approx(ambient + intensity * diffuse * cosine)
    half = toward + facing
    if float(half.norm()) > 1e-3:
        across = max(float((seen * half / half.norm()).sum()), 1e-4)
        expected = intensity * specular * across**p if cosine > 0 else 0.0
        assert float(got[0]) == pytest.approx(expected, abs=1e-9)


def test_a_light_stands_where_its_angles_say() -> None:
    camera = look_at((0, 0, 3), (0, 0, 0))[:3, :3]
    towards = np.array([0.0, 0.0, 1.0])
    np.testing.assert_allclose(Lamp().turn(camera) @ towards, towards, atol=1e-12)
    np.testing.assert_allclose(Lamp(90).turn(camera) @ towards, [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(Lamp(0, 90).turn(camera) @ towards, [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(Lamp(-180).turn(camera) @ towards, -towards, atol=1e-12)
    e, a = np.radians(30), np.radians(40)
    expected = [np.cos(e) * np.sin(a), np.sin(e), np.cos(e) * np.cos(a)]
    np.testing.assert_allclose(Lamp(40, 30).turn(camera) @ towards, expected, atol=1e-12)


@given(ANGLES, VECTORS)
def test_a_turn_is_a_rotation(angles: tuple[float, float], position: tuple[float, float, float]) -> None:
    turn = Lamp(*angles).turn(look_at(position, (0, 0, 0))[:3, :3])
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1.0)


@pytest.mark.parametrize("bad", [
    {"azimuth": 181}, {"elevation": -91}, {"azimuth": float("nan")}, {"intensity": -1}, {"intensity": float("inf")},
    {"direction": (0, 0, 0)}, {"direction": (1, 2)}, {"direction": (1, 0, float("nan"))},
])  # fmt: skip
def test_lights_that_cannot_be_are_one_sentence(bad: dict[str, object]) -> None:
    with pytest.raises(BadInput):
        Lamp(**bad)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def lit_cube() -> Scene:
    """The cube under an explicit light."""
    return lit_cube_scene()


EDITS = [
    lambda s: s,
    lambda s: s.with_light(50, 20, intensity=1.5),
    lambda s: s.with_light(direction=(1, 2, -1)),
    lambda s: s.with_light(-120).edited(1, ambient=0.5, diffuse=0.1, specular=0.8, shininess=3.0, lighting=1.4),
    lambda s: s.edited(0, colour=(0.2, 0.9, 0.9), opacity=0.5),
]


@pytest.mark.parametrize("number", range(len(EDITS)))
def test_kernels_light_as_torch_does(lit_cube: Scene, number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = EDITS[number](lit_cube)
    quick = scene.render(cube_camera()).rgba
    monkeypatch.setattr("svv.fields.scene.images.image_kernels_of", lambda _: None)
    np.testing.assert_allclose(quick, scene.render(cube_camera()).rgba, atol=1e-5)
    if number:
        assert np.abs(quick - lit_cube.render(cube_camera()).rgba).max() > 0.02


def test_summed_normals_are_the_same(lit_cube: Scene) -> None:
    palette = lit_cube.palette_network
    assert palette is not None and palette.phong is not None
    again = Scene.from_arrays(*lit_cube.to_arrays(packed=False))
    assert again.palette_network is not None and again.palette_network.phong is not None
    again.palette_network.phong.settle(again.occupancy)
    assert again.palette_network.phong.normals.levels == 1
    at = torch.rand(200, 3, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(again.palette_network.phong.normal(at), palette.phong.normal(at), atol=1e-4, rtol=0)
    assert palette.phong.normal(at[:0]).shape == (0, 3)  # a step whose rays met nothing stopped a training
    kept = Scene.from_bytes(again.to_bytes())
    np.testing.assert_allclose(kept.render(cube_camera()).rgba, lit_cube.render(cube_camera()).rgba, atol=0.03)


def test_files_keep_the_light_and_undo_takes_it_back(lit_cube: Scene) -> None:
    scene = lit_cube.with_light(30, -10, intensity=0.7).edited(2, specular=0.4).with_light(direction=(0, 1, 0))
    back = Scene.from_bytes(scene.to_bytes())
    assert back.lamp == Lamp(direction=(0, 1, 0), intensity=0.7) and back.regions[2].specular == 0.4
    assert back.history == scene.history
    once = back.undone()
    assert once.lamp == Lamp(30, -10, intensity=0.7)
    assert once.redone().lamp == back.lamp
    assert back.undone().undone().undone().regions == lit_cube.regions
    assert back.reset().lamp == Lamp() and back.reset().regions == lit_cube.regions
    assert back.reset(2).lamp == back.lamp
    assert "light from 0, 1, 0, intensity 0.7" in back.info()["light"]
    assert "30 degrees right, 10 down" in once.info()["light"]
    assert back.info()["reflects"][2]["specular"] == pytest.approx(0.4)


@pytest.mark.parametrize("lit", [True, False])
def test_scenes_of_before_there_was_a_light_are_read(cube: Scene, lit: bool) -> None:
    plain = replace(cube, settings=replace(cube.settings, lighting="network" if lit else "none"))
    header, tensors = plain.to_arrays(packed=False)
    if not lit:
        tensors = {name: value for name, value in tensors.items() if "lighting_mlp" not in name}
    old = {name: value for name, value in header.items() if name not in ("lamp", "normal_resolutions")}
    settings = {name: value for name, value in header["settings"].items() if name not in ("lighting", "headlight")}
    back = Scene.from_arrays({**old, "settings": {**settings, "lit": lit}}, tensors)
    assert back.settings.lighting == plain.settings.lighting and back.lamp == Lamp()
    assert back.palette_network is not None and (back.palette_network.lighting_mlp is not None) == lit


def test_a_light_that_a_network_learned_says_why_it_cannot_be_moved(cube: Scene, lit_cube: Scene) -> None:
    for change in (lambda s: s.with_light(30), lambda s: s.edited(0, ambient=0.3)):
        with pytest.raises(BadInput, match=r"network learned it .* --lighting phong"):
            change(cube)
        with pytest.raises(BadInput, match="no light to change"):
            change(replace(cube, settings=replace(cube.settings, lighting="none")))
    with pytest.raises(BadInput, match="not both"):
        lit_cube.with_light(30, direction=(1, 0, 0))
    with pytest.raises(BadInput, match="shininess"):
        lit_cube.edited(0, shininess=0.5)
    with pytest.raises(TypeError):
        lit_cube.edited(0, gloss=1.0)


def test_the_command_moves_the_light(lit_cube: Scene, cube: Scene, tmp_path: Path) -> None:
    lit_cube.save(tmp_path / "a.svv")
    cube.save(tmp_path / "network.svv")
    run = CliRunner().invoke
    source, out = str(tmp_path / "a.svv"), str(tmp_path / "b.svv")
    assert run(app, ["edit", source, "--light", "50,-20", "--intensity", "2", "-o", out]).exit_code == 0
    assert Scene.load(out).lamp == Lamp(50, -20, intensity=2)
    assert run(app, ["edit", out, "--intensity", "0.5", "--region", "1", "--shininess", "9", "-o", out]).exit_code == 0
    moved = Scene.load(out)
    assert moved.lamp == Lamp(50, -20, intensity=0.5) and moved.regions[1].shininess == 9
    assert run(app, ["edit", out, "--light", "headlight", "-o", out]).exit_code == 0
    assert Scene.load(out).lamp == Lamp(intensity=0.5)
    assert run(app, ["edit", out, "--undo", "-o", out]).exit_code == 0
    assert Scene.load(out).lamp == Lamp(50, -20, intensity=0.5)
    for bad in (["--light", "side"], ["--light", "200,0"], ["--light", "0,0,0"], ["--shininess", "4"]):
        result = run(app, ["edit", source, *bad, "-o", str(tmp_path / "none.svv")])
        assert isinstance(result.exception, BadInput), bad
    result = run(app, ["edit", str(tmp_path / "network.svv"), "--light", "9,9", "-o", str(tmp_path / "none.svv")])
    assert isinstance(result.exception, BadInput) and not (tmp_path / "none.svv").exists()


# --- a sphere, whose normals are known --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def views() -> ViewSet:
    known = sphere()
    return make_views(
        known.volume(32), known.transfer_function(), n=24, size=72, test=0, mapper="cpu", shading=Shading()
    )[0]


@pytest.fixture(scope="module")
def ball(views: ViewSet) -> tuple[Scene, Report]:
    return train_scene(views, SHORT, lighting="phong")


def front(size: int = 64) -> Camera:
    return Camera(look_at((0.0, 0.0, 6.0), (0.0, 0.0, 0.0)), 0.35, size, size)


def surface(scene: Scene, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (H, W) that show the sphere well within its outline, and the normals there (N, 3)."""
    half = 0.5 * 2.0  # the volume is 2 units wide
    origins, directions = camera.rays()
    along = (origins * directions).sum(-1)
    inside = along**2 - (origins**2).sum(-1) + (RADIUS * half) ** 2
    hit = inside > 0
    point = origins[hit] - (along[hit] + np.sqrt(inside[hit]))[:, None] * directions[hit]
    normal = point / (RADIUS * half)
    well = normal[:, 2] > 0.4
    hit[hit] = well
    return hit, normal[well]


def test_learned_normals_are_the_spheres(ball: tuple[Scene, Report]) -> None:
    scene, _ = ball
    assert scene.palette_network is not None and scene.palette_network.phong is not None
    rng = np.random.default_rng(0)
    true = rng.normal(size=(2000, 3))
    true /= np.linalg.norm(true, axis=1, keepdims=True)
    box = scene.occupancy.box
    at = torch.from_numpy(box.to_box(true * RADIUS).astype(np.float32))
    learned = torch.nn.functional.normalize(scene.palette_network.phong.normal(at), dim=1).numpy()
    away = np.degrees(np.arccos(np.abs((learned * true).sum(1)).clip(0, 1)))
    assert np.median(away) < 3.0 and np.percentile(away, 99) < 8.0  # 3.5 and 11 at the features' learning rate


def test_a_light_from_aside_lights_as_its_cosine_says(ball: tuple[Scene, Report]) -> None:
    scene, camera = ball[0], front()
    where, normal = surface(scene, camera)
    plain = replace(scene, regions=tuple(replace(r, ambient=0.0, specular=0.0) for r in scene.regions))
    head = plain.render(camera, "pcn").rgba[where][:, 0]
    for azimuth in (-50.0, 50.0):
        side = plain.with_light(azimuth).render(camera, "pcn").rgba[where][:, 0]
        a = np.radians(azimuth)
        expected = np.maximum(normal @ [np.sin(a), 0.0, np.cos(a)], 0.0) / normal[:, 2]
        usual = head * expected < 0.95  # what is not clamped
        assert np.abs(side - head * expected)[usual].mean() < 0.06
    world = plain.with_light(direction=(np.sin(a), 0.0, np.cos(a))).render(camera, "pcn").rgba[where][:, 0]
    np.testing.assert_allclose(world, side, atol=1e-5)
    darker = plain.with_light(intensity=0.5).render(camera, "pcn").rgba[where][:, 0]
    np.testing.assert_allclose(darker, 0.5 * head, atol=1e-4)


def test_a_headlight_draws_what_was_trained(ball: tuple[Scene, Report], views: ViewSet) -> None:
    scene, report = ball
    assert scene.settings.lighting == "phong" and scene.settings.headlight == "axis"
    assert any("explicit light" in note for note in report["notes"])  # type: ignore[attr-defined]
    assert scene.lamp == Lamp()
    truth = views.images[5].astype(np.float32) / 255.0
    drawn = scene.render(views.cameras[5], "pcn").rgba
    error = np.square(drawn[..., :3] * drawn[..., 3:] - truth[..., :3] * truth[..., 3:]).mean()
    assert -10 * np.log10(error) > 25.0
    rays = scene.caster([views.cameras[5]]).view(0)
    beams = Beams.of(Lamp(), views.cameras[5], rays)
    np.testing.assert_allclose(beams.facing[0].numpy(), views.cameras[5].camera_to_world[:3, 2], atol=1e-6)


def test_networks_take_the_headlight_for_the_direction_of_view(views: ViewSet) -> None:
    scene, _ = train_scene(views, SHORT, lighting="network")
    assert (scene.settings.lighting, scene.settings.headlight) == ("network", "axis")
    camera = views.cameras[5]
    rays = scene.caster([camera]).view(0)
    assert rays.axes is not None
    np.testing.assert_allclose(rays.lit_along, np.tile(-camera.camera_to_world[:3, 2], (len(rays), 1)), atol=1e-6)
    samples = march(rays, scene.occupancy, scene.base.density, scene.marching)
    for network in ("base", "pcn"):
        across = scene.shade(samples, replace(rays, directions=rays.directions.flip(0)), network)[0]
        torch.testing.assert_close(across, scene.shade(samples, rays, network)[0])
        point = scene.shade(samples, replace(rays, axes=None), network)[0]
        assert float((point - across).abs().max()) > 0.01
    of = {"gpu": "point", "cpu": "axis", "bricks": "axis"}
    assert {name: headlight_of(replace(views, meta=replace(views.meta, mapper=name))) for name in of} == of


def test_few_views_of_a_volume_choose_their_light(views: ViewSet) -> None:
    few, lattice = views.take(range(8)), SHORT.field
    assert light_for(few, lattice) == "auto"
    assert light_for(replace(few, meta=replace(few.meta, shading=None)), lattice) == "network"  # a foreign light
    assert light_for(few, PRESETS["paper"].field) == "network"
    many = ViewSet(few.cameras * 4, np.tile(few.images, (4, 1, 1, 1)), tuple(map(str, range(32))), few.meta)
    assert light_for(many, lattice) == "network"
    scene, report = train_scene(few, SHORT)
    assert scene.settings.lighting == "phong"  # an opaque ball is all that this light can be
    assert any("renders the 8 views with" in note for note in report["notes"])


def recoloured(scene: Scene, views: ViewSet, progress: Progress = silent, saved: Checkpoint | None = None) -> State:
    field, _, _ = recolour(
        views, scene, np.array([[0.9, 0.2, 0.15]]), replace(SHORT.recolour, iterations=8),
        Running(3, None, progress, saved),
    )  # fmt: skip
    return field.state_dict()


def test_same_seed_same_light_also_after_a_stop(
    ball: tuple[Scene, Report], views: ViewSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = recoloured(ball[0], views)
    # A clock that goes on by a second whenever somebody looks: every step is told and saved.
    monkeypatch.setattr("svv.train.run.loop.time", SimpleNamespace(monotonic=itertools.count().__next__))
    monkeypatch.setattr("svv.train.run.loop.SAVE_EVERY", 0.0)

    def stop(fraction: float, _: str) -> None:
        if fraction > 0.5:
            raise Cancelled

    with pytest.raises(Cancelled):
        recoloured(ball[0], views, stop, Checkpoint(tmp_path / "c", {}))
    seen: list[float] = []
    resumed = recoloured(ball[0], views, lambda f, _: seen.append(f), Checkpoint(tmp_path / "c", {}))
    assert min(seen) >= 0.5 and "phong.raw" in whole
    for name, value in whole.items():
        assert torch.equal(value, resumed[name]), name


def test_held_out_views_choose(views: ViewSet, ball: tuple[Scene, Report], monkeypatch: pytest.MonkeyPatch) -> None:
    scene = replace(ball[0], palette_network=None, regions=())
    monkeypatch.setattr("svv.train.palette.lighting.FEW_VIEWS", 24)
    for margin in (-100.0, 100.0):  # the network is taken, whatever the views say; and the explicit light
        monkeypatch.setattr("svv.train.palette.lighting.MARGIN", margin)
        chosen, said = light_by_trial(scene, views, np.array([[0.9, 0.2, 0.15]]), SHORT.recolour, Running(0))
        assert chosen.settings.lighting == ("phong" if margin > 0 else "network")
        assert "3 held-out views" in said and ("explicit light is chosen" in said) == (margin > 0)


def test_lights_that_cannot_be_trained_are_one_sentence(views: ViewSet) -> None:
    with pytest.raises(BadInput, match="needs the lattice"):
        train_scene(views, "paper", lighting="phong")
    with pytest.raises(BadInput, match="no lighting 'sun'"):
        train_scene(views, SHORT, lighting="sun")


@pytest.mark.slow
def test_a_whole_job_has_the_light_that_is_asked_for(views: ViewSet, tmp_path: Path) -> None:
    views.write(tmp_path / "views", "train")
    source, out = ViewSource(tmp_path / "views"), tmp_path / "out"
    few = ("reconstruct.iterations=30", "recolour.iterations=20")

    def trained(lighting: str) -> tuple[bool, str]:
        """Whether the job trained now, and what its report says."""
        before = (out / "scene.svv").stat().st_mtime_ns if (out / "scene.svv").exists() else 0
        job = Job(source, [], out, JobSettings(train=TrainOptions("draft", lighting=lighting, change=few)), Stages(out))
        job.make_views()
        job.train()
        said = json.loads((out / "train.json").read_text())["lighting"]
        assert said == Scene.load(out / "scene.svv").settings.lighting
        return (out / "scene.svv").stat().st_mtime_ns > before, said

    assert [trained(lighting) for lighting in ("phong", "phong", "network")] == [
        (True, "phong"), (False, "phong"), (True, "network"),
    ]  # fmt: skip
    with pytest.raises(BadInput, match="needs the lattice"):
        run_job(source, [], tmp_path / "none", JobSettings(train=TrainOptions("paper", lighting="phong")))
    assert not (tmp_path / "none").exists()
