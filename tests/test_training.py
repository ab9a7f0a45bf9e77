"""The three stages on a small generated scene: what they learn, keep and refuse, and how they resume."""

from __future__ import annotations

import copy
import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from svv.core.geometry.cameras import Camera, sphere_cameras
from svv.errors import BadInput, Cancelled, silent
from svv.fields.radiance.networks import FieldSettings, PaletteField, UnrestrictedField
from svv.fields.radiance.occupancy import carve
from svv.fields.scene.image import image_kernels_of
from svv.fields.scene.model import JOINED_WEIGHT
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet
from svv.train import pipeline
from svv.train.base.resolutions import fitted_field
from svv.train.base.sampling import with_fewest_samples
from svv.train.paint.styled_views import visible_from
from svv.train.pipeline import stylize_scene, train_scene
from svv.train.run.checkpoint import Checkpoint
from svv.train.run.config import PRESETS, Preset, RecolourSettings, ReconstructSettings, StylizeSettings
from svv.train.run.loop import Loop
from svv.train.run.report import Report

SIZE = 64
RED, BLUE = np.array([0.9, 0.1, 0.1]), np.array([0.1, 0.2, 0.9])
RED_CENTRE, BLUE_CENTRE, RADIUS = np.array([-0.35, 0.0, 0.0]), np.array([0.35, 0.0, 0.0]), 0.3


def two_balls(camera: Camera) -> np.ndarray:
    """Exact view of an opaque red and an opaque blue ball under a headlight, straight alpha. (H, W, 4) uint8"""
    origins, directions = camera.rays()
    nearest = np.full(directions.shape[:2], np.inf)
    image = np.zeros((*directions.shape[:2], 4))
    for centre, colour in ((RED_CENTRE, RED), (BLUE_CENTRE, BLUE)):
        towards = centre - origins
        along = (towards * directions).sum(-1)
        inside = RADIUS**2 - ((towards - along[..., None] * directions) ** 2).sum(-1)
        t = along - np.sqrt(np.maximum(inside, 0.0))
        hit = (inside > 0) & (t < nearest)
        cosine = np.sqrt(np.maximum(inside, 0.0)) / RADIUS
        image[hit, :3] = (colour * (0.2 + 0.8 * cosine[..., None]))[hit]
        image[hit, 3] = 1.0
        nearest = np.where(hit, t, nearest)
    return (image * 255.0).round().astype(np.uint8)


def views_of(cameras: list[Camera]) -> ViewSet:
    images = np.stack([two_balls(c) for c in cameras])
    return ViewSet(tuple(cameras), images, tuple(f"r_{k:04d}" for k in range(len(cameras))))


@pytest.fixture(scope="module")
def views() -> ViewSet:
    return views_of(sphere_cameras(42, (0.0, 0.0, 0.0), 4.0, np.radians(30), SIZE))


@pytest.fixture(scope="module")
def unseen() -> ViewSet:
    return views_of(sphere_cameras(5, (0.0, 0.0, 0.0), 4.0, np.radians(30), SIZE))


TINY = Preset(
    "tiny",
    FieldSettings(width=32),
    ReconstructSettings(iterations=300, rays=2048, samples=16384, cells=32),
    RecolourSettings(iterations=400, rays=2048),
    StylizeSettings(style_views=12, style_size=64),
)


@pytest.fixture(scope="module")
def trained(views: ViewSet) -> tuple[Scene, Report]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(PRESETS, "tiny", TINY)
        return train_scene(views, "tiny")


@pytest.fixture
def tiny(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(PRESETS, "tiny", TINY)


def test_hull_holds_the_balls_and_little_else(views: ViewSet) -> None:
    hull = carve(views.images[..., 3] > 0, views.cameras, 32)
    low, high = hull.box.bounds
    np.testing.assert_allclose(low, [-0.65, -0.3, -0.3], atol=0.06)
    np.testing.assert_allclose(high, [0.65, 0.3, 0.3], atol=0.06)
    rng = np.random.default_rng(0)
    on = rng.normal(size=(500, 3))
    on *= 0.98 * RADIUS / np.linalg.norm(on, axis=1, keepdims=True)
    for centre in (RED_CENTRE, BLUE_CENTRE):
        cell = (hull.box.to_box(on + centre) * hull.cells).astype(int)
        assert hull.occupied[tuple(cell.T)].all()
    balls = 2 * 4 / 3 * np.pi * RADIUS**3
    assert hull.occupied.sum() * (hull.box.size / hull.cells) ** 3 < 2.5 * balls


def test_images_take_as_few_samples_as_they_allow(
    trained: tuple[Scene, Report], views: ViewSet, unseen: ViewSet
) -> None:
    """Fog needs few samples, a surface all of training's; either way unseen images stay what they were."""
    opaque = trained[0]
    fog = replace(opaque, base=copy.deepcopy(opaque.base))
    assert fog.base.density is not None
    with torch.no_grad():
        fog.base.density.table.fill_(-2.0)
    for scene in (opaque, fog):
        found, reason = with_fewest_samples(scene, views.cameras)
        camera = unseen.cameras[0].resized(200, 200)
        fine, few = (s.render(camera).rgba for s in (replace(scene, stride=1.0, joined=JOINED_WEIGHT), found))
        error = np.square((fine[..., :3] - 1) * fine[..., 3:] - (few[..., :3] - 1) * few[..., 3:]).mean()
        assert -10 * np.log10(error + 1e-12) > 47
    assert (found.stride, found.joined) == (2.0, 1 / 32), reason
    again = Scene.from_bytes(found.to_bytes())
    assert (again.stride, again.joined) == (2.0, 1 / 32)


def test_an_image_shows_what_was_learned_since_the_last(trained: tuple[Scene, Report], unseen: ViewSet) -> None:
    """Tables that were drawn while they learned are not kept for the images of the scene once it is frozen."""
    scene = replace(trained[0], palette_network=copy.deepcopy(trained[0].palette_network))
    assert scene.palette_network is not None
    table = scene.palette_network.encoding.table
    table.requires_grad_(True)
    before = scene.render(unseen.cameras[0], "pcn").rgba
    with torch.no_grad():
        table.zero_()
    table.requires_grad_(False)
    assert np.abs(scene.render(unseen.cameras[0], "pcn").rgba - before).max() > 0.01


def test_hull_of_nothing_is_refused(views: ViewSet) -> None:
    with pytest.raises(BadInput, match="No point is visible"):
        carve(np.zeros(views.images.shape[:3], bool), views.cameras, 32)


def test_stages_learn_unseen_views(trained: tuple[Scene, Report], unseen: ViewSet) -> None:
    scene, report = trained
    base = pipeline.evaluate_scene(scene, unseen, "base")
    palette = pipeline.evaluate_scene(scene, unseen, "pcn")
    assert base.psnr > 24.0
    assert palette.psnr > base.psnr - 2.0
    assert base.views == 5
    assert report["preset"] == "tiny"
    assert set(report["seconds"]) >= {"check", "hull", "base", "palette", "pcn", "total"}  # type: ignore[call-overload]
    assert int(report["peak_rss_bytes"]) > 0  # type: ignore[call-overload]


def region_at(scene: Scene, colour: np.ndarray) -> int:
    hues = [np.array(r.colour) / max(r.colour) for r in scene.regions]
    return int(np.argmin([np.abs(h - colour / colour.max()).sum() for h in hues]))


def front() -> Camera:
    """Both balls side by side: red left, blue right."""
    pose = np.eye(4)
    pose[2, 3] = 4.0
    return Camera(pose, np.radians(30), SIZE, SIZE)


def test_regions_are_the_balls(trained: tuple[Scene, Report]) -> None:
    scene, _ = trained
    assert len(scene.regions) == 2
    shown = scene.render(front(), "pcn")
    truth = two_balls(front())
    ball = np.where(truth[..., 0] > truth[..., 2], region_at(scene, RED), region_at(scene, BLUE))
    seen = (truth[..., 3] > 0) & (shown.region >= 0)
    assert (shown.region == ball)[seen].mean() > 0.95
    assert (shown.region[shown.rgba[..., 3] == 0] == -1).all()
    assert np.isnan(shown.depth[shown.region == -1]).all()
    middle = shown.depth[SIZE // 2, SIZE // 2 - 10]
    assert middle == pytest.approx(4.0 - RADIUS, abs=0.12)


def test_edits_change_their_region_alone(trained: tuple[Scene, Report]) -> None:
    scene, _ = trained
    red = region_at(scene, RED)
    before = scene.render(front(), "pcn")
    opaque = before.rgba[..., 3] > 0.9  # outlines belong to either region
    left, right = opaque & (before.region == red), opaque & (before.region == region_at(scene, BLUE))
    green = scene.edited(red, colour=(0.1, 0.9, 0.1)).render(front(), "pcn").rgba
    assert (green[left][:, 1] > green[left][:, 0]).mean() > 0.9
    bleeding = np.abs(green[right] - before.rgba[right])
    assert bleeding.mean() < 0.03 < np.abs(green[left] - before.rgba[left]).mean()
    assert np.quantile(bleeding, 0.99) < 0.12
    hidden = scene.edited(red, opacity=0.0).render(front(), "pcn").rgba
    assert hidden[left][:, 3].mean() < 0.1
    assert hidden[right][:, 3].mean() > 0.9
    assert before.rgba[left][:, 3].mean() > 0.9
    flat = scene.edited(red, lighting=0.0).render(front(), "pcn").rgba
    assert np.std(flat[left][:, 0]) < np.std(before.rgba[left][:, 0])
    same = scene.edited(red, colour=scene.regions[red].colour).render(front(), "pcn").rgba
    np.testing.assert_allclose(same, before.rgba, atol=1e-3)


@pytest.mark.parametrize("network", ["pcn", "styled"])
def test_images_of_the_kernels_are_those_of_plain_torch(
    trained: tuple[Scene, Report], monkeypatch: pytest.MonkeyPatch, network: str
) -> None:
    """Every edit at once, in kernels and in plain torch."""
    scene = trained[0].edited(0, colour=(0.2, 0.8, 0.3), opacity=0.4).edited(1, lighting=1.7)
    if network == "styled":
        styled = UnrestrictedField(scene.settings, scene.occupancy).requires_grad_(False)
        styled.encoding.randomize(1.0, torch.Generator().manual_seed(1))
        regions = (scene.regions[0], replace(scene.regions[1], style="noise", strength=0.6))
        scene = replace(scene, styled=styled, regions=regions)
    assert image_kernels_of(scene) is not None
    one = scene.render(front(), network)
    monkeypatch.setattr("svv.fields.scene.images.image_kernels_of", lambda _: None)
    other = scene.render(front(), network)
    np.testing.assert_allclose(one.rgba, other.rgba, atol=2e-5)
    np.testing.assert_allclose(one.depth, other.depth, rtol=1e-5)
    assert (one.region == other.region).mean() > 0.999  # shares that are equal to the last bit may fall either way


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"region": 7}, "no region 7"),
        ({"region": 0, "colour": (2.0, 0.0, 0.0)}, "red, green and blue"),
        ({"region": 0, "opacity": -1.0}, "at least 0"),
        ({"region": 0, "lighting": float("nan")}, "at least 0"),
    ],
)
def test_edits_that_cannot_be(trained: tuple[Scene, Report], changes: dict[str, object], words: str) -> None:
    with pytest.raises(BadInput, match=words):
        trained[0].edited(**changes)  # type: ignore[arg-type]


def test_scene_file_gives_the_same_images(trained: tuple[Scene, Report], tmp_path: Path) -> None:
    scene = trained[0].edited(0, colour=(0.2, 0.8, 0.3), lighting=1.5)
    scene.save(tmp_path / "a.svv")
    again = Scene.load(tmp_path / "a.svv")
    one, two = scene.render(front()), again.render(front())
    difference = np.abs(two.rgba - one.rgba)  # tables are stored in bytes
    assert difference.mean() < 2e-3
    assert np.quantile(difference, 0.99) < 0.02
    assert again.regions == scene.regions
    assert again.camera_rig == scene.camera_rig
    again.save(tmp_path / "b.svv")
    assert (tmp_path / "a.svv").stat().st_size == (tmp_path / "b.svv").stat().st_size


@pytest.mark.slow
def test_same_seed_same_scene(views: ViewSet, tiny: None, trained: tuple[Scene, Report]) -> None:
    again, _ = train_scene(views, "tiny")
    np.testing.assert_array_equal(again.render(front()).rgba, trained[0].render(front()).rgba)


# Before the lattice is refined, after that, and in stage 2.
@pytest.mark.parametrize("stop_at", [0.8, *(pytest.param(f, marks=pytest.mark.slow) for f in (0.3, 0.6))])
def test_a_stopped_training_goes_on_to_the_same_scene(
    views: ViewSet, tiny: None, trained: tuple[Scene, Report], tmp_path: Path, stop_at: float,
    every_step: None,
) -> None:  # fmt: skip
    path = tmp_path / "scene.svv.checkpoint"

    def stop(fraction: float, label: str) -> None:
        if fraction > stop_at and "loss" in label:
            raise Cancelled

    with pytest.raises(Cancelled):
        train_scene(views, "tiny", progress=stop, checkpoint=path)
    assert path.exists()
    seen: list[float] = []
    resumed, _ = train_scene(views, "tiny", progress=lambda f, _: seen.append(f), checkpoint=path)
    # Stage 1 hands stage 2 a base in half precision when it comes from the file.
    assert np.abs(resumed.render(front()).rgba - trained[0].render(front()).rgba).mean() < 5e-3
    assert min(seen) >= 0.0 and seen[-1] == 1.0


def test_checkpoint_of_another_run_is_not_used(views: ViewSet, tmp_path: Path) -> None:
    path = tmp_path / "x.checkpoint"
    Checkpoint(path, {"seed": 0}).finish("base", {"seconds": 1.0}, {"a": np.ones(3)})
    assert "base" in Checkpoint(path, {"seed": 0}).finished
    assert not Checkpoint(path, {"seed": 1}).finished
    path.write_bytes(b"rubbish")
    assert not Checkpoint(path, {"seed": 0}).finished


def test_time_limit_ends_a_training_and_still_gives_a_scene(views: ViewSet, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("svv.train.run.loop.time.monotonic", itertools.count(0.0, 0.1).__next__)  # a look, 0.1 s
    scene, report = train_scene(views, "balanced", time_limit=2.0)
    assert any(note.startswith("stage 1 stopped") and "at its limit of" in note for note in report["notes"])
    assert scene.networks == ("base", "pcn")


def test_a_loop_spends_its_limit_and_its_schedule_ends_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = itertools.count()  # each look at it is a tenth of a second later
    monkeypatch.setattr("svv.train.run.loop.time.monotonic", lambda: 0.1 * next(clock))
    fractions: list[float] = []

    def step(number: int, fraction: float) -> Tensor:
        fractions.append(fraction)
        return torch.zeros(())

    loop = Loop(1000, 4.0, silent, "")
    assert 4.0 <= loop.run(step) <= 4.2
    assert loop.done == len(fractions) < 1000
    assert fractions == sorted(fractions) and 0.9 < fractions[-1] < 1.0


@pytest.mark.parametrize(("preset", "limit", "words"), [("finest", None, "no preset"), ("draft", 0.0, "time limit")])
def test_training_that_cannot_be(views: ViewSet, preset: str, limit: float | None, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        train_scene(views, preset, time_limit=limit)


def test_too_few_views(views: ViewSet) -> None:
    few = ViewSet(views.cameras[:2], views.images[:2], views.names[:2])
    with pytest.raises(BadInput, match="2 views are too few"):
        train_scene(few, "draft")


def test_lattice_is_no_finer_than_pixels(views: ViewSet) -> None:
    hull = carve(views.images[..., 3] > 0, views.cameras, 32)
    coarse, reason = fitted_field(FieldSettings(), views.cameras, hull.box)
    fine, _ = fitted_field(FieldSettings(), [c.resized(800, 800) for c in views.cameras], hull.box)
    assert coarse.resolutions[-1] < fine.resolutions[-1]
    assert "pixel" in reason


# --- stage 3 -------------------------------------------------------------------------------------------------------


def test_one_region_styled_the_other_kept(trained: tuple[Scene, Report], tiny: None) -> None:
    scene, _ = trained
    red, blue = region_at(scene, RED), region_at(scene, BLUE)
    rng = np.random.default_rng(0)
    style = np.repeat(rng.random((32, 32, 1)), 3, 2).repeat(4, 0).repeat(4, 1).astype(np.float32) * [0.2, 1.0, 0.3]
    styled, report = stylize_scene(scene, [style], "tiny", keep=(blue,), manner="pieces")
    assert styled.networks == ("base", "pcn", "styled")
    assert styled.regions[red].style is not None
    assert styled.regions[blue].style is None
    before, after = scene.render(front(), "pcn"), styled.render(front(), "styled")
    left, right = before.region == red, before.region == blue
    np.testing.assert_allclose(after.rgba[right], before.rgba[right], atol=0.06)
    assert after.rgba[left][:, 1].mean() > after.rgba[left][:, 0].mean()
    np.testing.assert_array_equal(after.rgba[..., 3], before.rgba[..., 3])
    with pytest.raises(BadInput, match="is styled"):
        styled.edited(red, colour=(1.0, 0.0, 0.0))
    assert styled.edited(red, opacity=0.0).render(front()).rgba[left][:, 3].mean() < 0.1
    assert set(report["seconds"]) == {"paint", "contrast", "total"}


def test_region_images_keep_their_occluders(trained: tuple[Scene, Report]) -> None:
    """Seen along x, the nearer ball hides the farther: the hidden region's image shows only background."""
    scene, _ = trained
    pose = np.eye(4)
    pose[:3, :3] = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    pose[0, 3] = 4.0
    (view,) = visible_from(scene, [Camera(pose, np.radians(30), SIZE, SIZE)], silent)
    colours = torch.ones(len(view.position), 3)
    _, near = view.image(colours, region_at(scene, BLUE), 0.25)
    hidden, far = view.image(colours, region_at(scene, RED), 0.25)
    assert near.max() > 0.9
    assert float(far.mean()) < 0.15 * float(near.mean())
    assert float((hidden - 0.25).abs().mean()) < 0.15


@pytest.mark.parametrize("colours", [1, 2, 8])
def test_palette_network_with_any_number_of_colours(views: ViewSet, colours: int) -> None:
    """Weights sum to 1, nothing is negative that may not be, also for a palette of one."""
    hull = carve(views.images[..., 3] > 0, views.cameras, 32)
    field = PaletteField(FieldSettings(resolutions=(16, 32)), hull, 8, torch.rand(colours, 3))
    x = torch.from_numpy((np.argwhere(hull.occupied)[:50] / hull.cells).astype(np.float32))
    with torch.no_grad():
        parts = field(x, torch.randn(len(x), 8), torch.randn(len(x), 16))
    torch.testing.assert_close(parts.weights.sum(1), torch.ones(len(x)))
    assert (parts.specular >= 0).all()
    assert (parts.intensity >= 0).all()
    assert (parts.shade > 0).all()
    assert (parts.shade < 2).all()
    assert parts.diffuse(field.colours + parts.offsets).shape == (len(x), 3)


def test_the_papers_preset_runs(views: ViewSet, monkeypatch: pytest.MonkeyPatch, unseen: ViewSet) -> None:
    paper = PRESETS["paper"]
    short = replace(
        paper,
        field=replace(paper.field, levels=4, log2_entries=12, resolutions=(16, 64)),
        reconstruct=replace(paper.reconstruct, iterations=60, rays=256, samples=1 << 13, cells=32),
        recolour=replace(paper.recolour, iterations=10, rays=256),
    )
    monkeypatch.setitem(PRESETS, "paper", short)
    scene, report = train_scene(views, "paper")
    assert scene.base.density is None
    assert not scene.palette_network.shading  # type: ignore[union-attr]
    assert pipeline.evaluate_scene(scene, unseen, "base").psnr > 15.0
    assert report["preset"] == "paper" and scene.settings.lighting == "network"
    assert report["notes"][-1] == "images use all samples, because the density is a network"
