"""Splats fitted to a scene: they look as it does from sides that were not fitted, whatever its edits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from svv.core.geometry.cuts import Cut
from svv.core.images.metrics import psnr
from svv.errors import BadInput
from svv.fields.scene.joined import joined
from svv.fields.scene.scene import Scene
from svv.fields.splats.splats import Splats
from svv.options.splats import SplatOptions
from svv.train.splats import fit, starting
from svv.train.splats.fit import fit_splats
from svv.train.splats.raster import Eye, Gaussians, draw
from svv.train.splats.starting import cameras_around, quaternions_of, turns_of
from tests.cube import cube_scene, faint, hash_cube_scene
from tests.nightly import nightly
from tests.solid_ball import solid_ball
from tests.test_web import lit

SIDE = 64


@pytest.fixture(autouse=True)
def few_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    for module, views, pixels in ((fit, 12, SIDE), (starting, 12, 48)):
        monkeypatch.setattr(module, "VIEWS", views)
        monkeypatch.setattr(module, "PIXELS", pixels)


def pictures_of(
    splats: Splats, scene: Scene, camera: int, network: str | None
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """A picture of splats, and that of the scene, both on white, from a side that was not fitted. (H, W, 3)"""
    bounds = scene.bounds
    own = cameras_around(bounds.mean(axis=0), 0.5 * float(np.ptp(bounds, axis=0).max()), 7, SIDE, 0.3)[camera]
    gaussians = Gaussians(splats.centres, splats.scales, splats.rotations, splats.opacities, splats.harmonics)
    image = draw(gaussians, Eye.of(own, np.zeros(3), 1.0)).image
    shown = (image[:3] + 1.0 - image[3]).clip(0.0, 1.0).transpose(1, 2, 0)
    return shown, scene.render(own, network, (1.0, 1.0, 1.0)).rgba[..., :3]


def likeness(splats: Splats, scene: Scene, network: str | None = None) -> float:
    """Mean PSNR over sides that were not fitted, dB."""
    return float(np.mean([psnr(*pictures_of(splats, scene, camera, network)) for camera in range(7)]))


def test_a_ball_of_splats_looks_like_the_ball() -> None:
    scene = solid_ball()
    few = likeness(fit_splats(scene, SplatOptions(count=150, steps=60)), scene)
    splats = fit_splats(scene, SplatOptions(count=1500, steps=60))
    assert likeness(splats, scene) > max(33.0, few + 2.0)
    assert len(splats) <= 1500
    assert splats.harmonics.shape[1] == 1, "a ball without light looks alike from all sides"
    away = np.linalg.norm(splats.centres, axis=1)
    assert np.mean(away < 0.3) < 0.02, "nothing is spent inside"
    shown = splats.opacities > 0.3
    thin = np.take_along_axis(
        turns_of(splats.rotations.astype(np.float64)), splats.scales.argmin(axis=1)[:, None, None], axis=2
    )[..., 0]
    along = np.abs((thin * splats.centres).sum(axis=1)) / away
    assert np.median(along[shown]) > 0.9, "splats lie flat on the surface"
    assert np.abs(np.linalg.norm(splats.rotations, axis=1) - 1.0).max() < 1e-5
    assert (splats.scales > 0.0).all() and (splats.opacities >= 0.0).all() and (splats.opacities <= 1.0).all()


def test_fog_of_splats_is_as_thick_as_the_fog() -> None:
    scene = solid_ball(densest=0.5)
    assert likeness(fit_splats(scene, SplatOptions(count=1500, steps=80)), scene) > 33.0


def test_the_same_seed_gives_the_same_bytes() -> None:
    scene, options = solid_ball(), SplatOptions(count=400, steps=25)
    one, two, other = (fit_splats(scene, o) for o in (options, options, replace(options, seed=1)))
    for name in ("centres", "scales", "rotations", "opacities", "harmonics", "regions"):
        assert getattr(one, name).tobytes() == getattr(two, name).tobytes()
    assert one.centres.tobytes() != other.centres.tobytes()


def test_regions_and_their_edits_are_in_the_splats(balls: Scene) -> None:
    """Of two balls, each has its splats; one that is hidden has none, and one of another colour has that."""
    scene = balls
    both = fit_splats(scene, SplatOptions(count=600, steps=30, degree="0"))
    assert set(both.regions.tolist()) == {0, 1} and both.names == ("region 0", "region 1")
    alone = fit_splats(scene.hidden(0), SplatOptions(count=600, steps=30, degree="0"))
    assert set(alone.regions.tolist()) == {1}
    green = fit_splats(scene.edited(1, colour=(0.1, 0.8, 0.2)), SplatOptions(count=600, steps=30, degree="0"))
    colour = (0.5 + 0.28209479 * green.harmonics[green.regions == 1, 0]).mean(axis=0)
    assert colour[1] > colour[0] + 0.2 and colour[1] > colour[2] + 0.2


@pytest.mark.parametrize("kind", nightly(["joined", "hash grid", "cut", "base network"], "joined", "cut"))
def test_scenes_of_every_kind_become_splats(kind: str) -> None:
    """Members of a joined scene add up; a scene without a lattice, a cut one, and one without regions look the same."""
    scene, network = faint(cube_scene(), 3.0), None
    if kind == "joined":
        scene = joined([faint(scene, 0.5), faint(cube_scene(1), 0.5)])
    elif kind == "hash grid":
        scene = hash_cube_scene()
    elif kind == "cut":
        scene = scene.cut(Cut(planes=((1.0, 0.0, 0.0, 0.1),)))
    else:
        network = "base"
    splats = fit_splats(scene, SplatOptions(count=3000, steps=80, network=network))  # type: ignore[arg-type]
    assert likeness(splats, scene, network) > 30.0
    assert len(splats.names) == (1 if network else len(scene.regions))
    assert splats.regions.max() < len(splats.names)


def test_light_and_shadows_are_in_the_splats() -> None:
    """A light that stays in the world, and shadows: the splats are like no other light's pictures."""
    lamp = lit(solid_ball()).with_light(direction=(0.0, 1.0, 0.0))
    scene = lamp.with_shadow(1.0, (1.0, 0.2, 0.0))
    splats = fit_splats(scene, SplatOptions(count=600, steps=40, degree="1"))
    own = likeness(splats, scene)
    assert own > 30.0
    assert likeness(splats, scene.with_light(direction=(0.0, -1.0, 0.0))) < own - 6.0
    assert likeness(splats, lamp) < own - 6.0


def test_a_light_that_follows_the_viewer_follows_in_the_splats() -> None:
    """Harmonics hold it: without them, splats are less like it."""
    scene = lit(solid_ball()).with_light(60.0, 20.0)
    best, flat = (
        likeness(fit_splats(scene, SplatOptions(count=600, steps=40, degree=degree)), scene) for degree in ("2", "0")
    )
    assert best > max(28.0, flat + 4.0)


@pytest.mark.parametrize("times", [1e-9, 1e6])
def test_where_a_scene_lies_and_how_large_it_is_changes_nothing(times: float) -> None:
    scene = solid_ball()
    box = replace(scene.occupancy.box, low=(99.5, -0.5, -0.5))
    moved = replace(scene, occupancy=replace(scene.occupancy, box=box))
    options = SplatOptions(count=300, steps=10)
    here, there = fit_splats(scene, options), fit_splats(moved, options)
    assert np.abs(there.centres - here.centres - np.array((100.0, 0.0, 0.0), np.float32)).max() < 1e-2
    other = replace(scene.occupancy.box, low=(-0.5 * times,) * 3, size=times)
    large = fit_splats(replace(scene, occupancy=replace(scene.occupancy, box=other)), options)
    assert np.abs(large.centres / np.float32(times) - here.centres).max() < 1e-2
    far = replace(scene.occupancy.box, low=(1e7, 0.0, 0.0))
    with pytest.raises(BadInput, match="so far from the origin"):
        fit_splats(replace(scene, occupancy=replace(scene.occupancy, box=far)), options)


def test_what_splats_cannot_hold_is_refused() -> None:
    scene = solid_ball()
    for refused, said in (
        (scene.hidden(0), "shows nothing"),
        (scene.with_outline(1.0), "Outlines"),
        (scene.with_shadow(0.5), "shadows only from a direction"),
    ):
        with pytest.raises(BadInput, match=said):
            fit_splats(refused, SplatOptions(steps=5))
    for options, said in (
        (SplatOptions(count=5), "between 100 and"),
        (SplatOptions(steps=0), "at least 1"),
        (SplatOptions(degree="4"), "auto, 0, 1, 2 or 3"),  # type: ignore[arg-type]
        (SplatOptions(network="styled"), "no network 'styled'"),
    ):
        with pytest.raises(BadInput, match=said):
            fit_splats(scene, options)


def test_progress_grows_and_stops_the_work() -> None:
    told: list[float] = []

    def stop(fraction: float, label: str) -> None:
        told.append(fraction)
        if label.startswith("drawing") and fraction > 0.2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fit_splats(solid_ball(), SplatOptions(count=300), stop)
    assert told == sorted(told) and told[-1] < 0.31


def test_a_short_fit_drops_nothing_that_it_did_not_look_at() -> None:
    """Two steps look from two sides: what these do not see stays."""
    splats = fit_splats(solid_ball(), SplatOptions(count=300, steps=2))
    octants = (splats.centres > 0.0) @ np.array([1, 2, 4])
    assert (np.bincount(octants, minlength=8) > 0.06 * len(splats)).all()


def test_a_time_limit_ends_the_fit() -> None:
    last: list[float] = []
    fit_splats(
        solid_ball(), SplatOptions(count=300, steps=10**9, time_limit=1.0), lambda fraction, _: last.append(fraction)
    )
    assert last[-1] == 1.0


def test_quaternions_are_of_the_matrices() -> None:
    random = np.random.default_rng(0)
    some = np.concatenate([random.normal(size=(200, 4)), np.eye(4)])
    turns = turns_of(some)
    assert np.abs(turns_of(quaternions_of(turns)) - turns).max() < 1e-12


def test_a_gaussian_has_its_gradient_where_pictures_differ() -> None:
    """The loss's gradient by a picture is its difference quotient."""
    random = np.random.default_rng(3)
    image, picture, way = (random.uniform(0.0, 1.0, (4, 5, 6)).astype(np.float32) for _ in range(3))
    _, slope, _ = fit.loss_of(image, picture)
    ahead, behind = (fit.loss_of(image + sign * np.float32(1e-2) * way, picture)[0] for sign in (1.0, -1.0))
    assert (ahead - behind) / 2e-2 == pytest.approx(float((slope * way).sum()), rel=1e-2)
    assert fit.loss_of(picture, picture)[0] == pytest.approx(0.0, abs=1e-6)
