"""The rules that choose what a scene needs, each tested on scenes for which different choices are right.

Other choices have tests elsewhere: the lighting network (test_lighting.py), the palette from views (test_palette.py),
ranges that are not visible (test_ranges.py), and the samples per image and the finest resolution (test_training.py).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
import torch

from svv.core.colour.shading import Shading
from svv.core.geometry.box import Box
from svv.core.geometry.cameras import sphere_cameras
from svv.dvr.draw.views import make_views
from svv.errors import silent
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.networks import BaseField, FieldSettings
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.rendering import Marching
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet
from svv.styles.gallery.textures import style_picture
from svv.train.base.feature_levels import with_fewest_levels, without_finer
from svv.train.base.first_extinction import first_occupancy
from svv.train.base.resolutions import fitted_field, paint_pixel
from svv.train.paint.painting import paint_cells
from svv.train.pipeline import stylize_scene, train_scene
from svv.train.run.config import PRESETS
from svv.train.run.loop import Loop
from svv_bench.stability.scenes import NESTED, SCENES, Array, KnownScene, Range, shells
from tests.nightly import nightly

DRAFT = PRESETS["draft"]
SHORT = replace(
    DRAFT,
    reconstruct=replace(DRAFT.reconstruct, iterations=120, rays=512, samples=4096, cells=64),
    recolour=replace(DRAFT.recolour, iterations=10, rays=256, samples=2048),
    stylize=replace(DRAFT.stylize, style_size=48),
)

HUES = ((0.9, 0.1, 0.1), (0.9, 0.8, 0.1), (0.1, 0.8, 0.2), (0.1, 0.8, 0.9), (0.1, 0.2, 0.9), (0.9, 0.1, 0.8))


def small_ring(point: Array) -> Array:
    """The ring at a quarter of its size, in a volume that is empty otherwise."""
    return np.asarray(SCENES["one-region"].field(4.0 * point))


def stripes(point: Array) -> Array:
    """A ball in stripes, each hardly wider than a cell of the coarsest level."""
    radius = np.sqrt((point**2).sum(axis=0))
    return np.asarray(np.where(radius < 0.9, 0.5 + 0.5 * np.sign(np.sin(30.0 * point[0])), 0.5))


def solid(point: Array) -> Array:
    """A ball that fills its box as far as a ball can."""
    return np.asarray(0.75 + 0.25 * np.sign(0.9 - np.sqrt((point**2).sum(axis=0))))


def corners(point: Array) -> Array:
    """Two small balls in opposite corners."""
    distance = [np.sqrt(((point - side * 0.65) ** 2).sum(axis=0)) for side in (-1.0, 1.0)]
    return np.asarray(0.75 + 0.25 * np.sign(0.25 - np.min(distance, axis=0)))


@dataclass(frozen=True)
class Made:
    """A scene that is made so that its choices are known."""

    known: KnownScene
    shaded: bool = True
    resolution: int = 32
    size: int = 64


MADE = {
    "opaque, one region": Made(SCENES["one-region"], shaded=False, size=168),
    "striped": Made(KnownScene(stripes, SCENES["easy"].ranges), shaded=False, size=168),
    "nested translucent": Made(NESTED),
    "many hues": Made(
        KnownScene(shells, tuple(Range(0.1 + 0.14 * k, 0.22 + 0.14 * k, 0.1 + 0.1 * k, c) for k, c in enumerate(HUES)))
    ),
    "two corners": Made(KnownScene(corners, (Range(0.8, 1.2, 0.9, HUES[0]),))),
    "solid": Made(KnownScene(solid, (Range(0.8, 1.2, 0.9, HUES[0]),))),
    "huge empty box": Made(KnownScene(small_ring, SCENES["one-region"].ranges), resolution=96, size=168),
}


@cache
def views_of(name: str) -> ViewSet:
    """Training views of a scene."""
    made = MADE[name]
    return make_views(
        made.known.volume(made.resolution), made.known.transfer_function(), n=16, size=made.size, mapper="cpu",
        rescale=False, shading=Shading(on=made.shaded),
    )[0]  # fmt: skip


@cache
def trained(name: str) -> tuple[Scene, str]:
    """The scene and its notes."""
    scene, report = train_scene(views_of(name), SHORT)
    return scene, "\n".join(report["notes"])


def before_training(name: str, alone: bool = False) -> tuple[Occupancy, FieldSettings, str]:
    """Box and occupancy, the levels that pixels can tell apart, and why; from views ``alone`` or with the volume."""
    views = views_of(name)
    views = replace(views, classified=None) if alone else views
    occupancy, why = first_occupancy(views, SHORT.reconstruct, SHORT.field, silent)
    field, reason = fitted_field(SHORT.field, views.cameras, occupancy.box)
    return occupancy, field, f"{why}\n{reason}"


@pytest.mark.parametrize(
    ("name", "count"),
    nightly(
        [("opaque, one region", 1), ("nested translucent", 3), ("many hues", 6)],
        ("nested translucent", 3),
        ("many hues", 6),
    ),
)
def test_a_palette_has_as_many_colours_as_there_are(name: str, count: int) -> None:
    scene, notes = trained(name)
    assert len(scene.regions) == count
    assert f"{count} visible range" in notes


@pytest.mark.parametrize("name", ["opaque, one region", "nested translucent"])
def test_light_is_learned_where_there_is_some(name: str) -> None:
    scene, notes = trained(name)
    assert (scene.settings.lighting != "none") == MADE[name].shaded
    assert "with shading" in notes or "without shading" in notes


@pytest.mark.parametrize("alone", [False, True], ids=["with the volume", "from views alone"])
def test_a_huge_empty_box_costs_nothing(alone: bool) -> None:
    """A scene in a small part of its volume gets the box, the resolution and the occupancy of one that fills it."""
    fills, lost = (before_training(name, alone) for name in ("opaque, one region", "huge empty box"))
    assert lost[0].box.size / fills[0].box.size == pytest.approx(0.25, rel=0.1)
    assert lost[1].resolutions == fills[1].resolutions
    assert lost[0].fraction == pytest.approx(fills[0].fraction, rel=0.35)


@pytest.mark.parametrize("alone", [False, True], ids=["with the volume", "from views alone"])
def test_occupied_is_what_is_visible(alone: bool) -> None:
    """A ball is 0.52 of its box; two small ones in opposite corners are a fiftieth of theirs."""
    (few, _, said), (ball, _, _) = (before_training(name, alone) for name in ("two corners", "solid"))
    assert few.fraction < 0.1 < 0.45 < ball.fraction < 0.75
    assert f"{few.fraction:.1%} of the box" in said


def test_one_flat_colour_needs_no_fine_levels() -> None:
    scene, notes = trained("opaque, one region")
    assert len(scene.settings.resolutions) == 1 and len(scene.settings.finer) >= 1
    assert "would add" in notes and "left out" in notes
    assert scene.palette_network is not None
    assert scene.base.encoding.levels == scene.palette_network.encoding.levels == 1  # type: ignore[union-attr]


def test_fine_stripes_need_all_levels() -> None:
    scene, notes = trained("striped")
    count = len(scene.settings.resolutions)
    assert count > 1 and f"all {count} levels of features stay, for the borders" in notes
    same, reason = with_fewest_levels(replace(scene, palette_network=None), views_of("striped"), 0)
    assert same.settings == scene.settings and not same.settings.finer
    assert "adds" in reason and f"all {count} levels of features stay" in reason


def test_features_that_follow_from_coarser_ones_go_without_a_trace() -> None:
    """A finer level that is an affine map of the coarser one at every point says nothing new."""
    occupancy = Occupancy.full(Box((0.0, 0.0, 0.0), 1.0, (1.0, 1.0, 1.0)), 8)
    settings = FieldSettings(resolutions=(4, 8), width=16)
    base, random = BaseField(settings, occupancy), torch.Generator().manual_seed(0)
    lattice = base.encoding
    assert isinstance(lattice, SparseLattice) and base.density is not None
    lattice.randomize(8.0, random)
    fine = torch.from_numpy(lattice.places_of_level(1, occupancy.occupied, 8))
    with torch.no_grad():
        base.density.table.fill_(0.5)
        coarser = lattice.look_up(fine)[:, :4]
        lattice.table[lattice.rows_of_level(1)] = coarser @ torch.randn(4, 4, generator=random) + torch.randn(4)
    scene = Scene(settings, occupancy, Marching(1 / 16), base.requires_grad_(False))
    cameras = sphere_cameras(4, (0.5, 0.5, 0.5), 3.0, 0.5, 24)
    images = np.random.default_rng(0).integers(0, 256, (4, 24, 24, 4)).astype(np.uint8)
    less = without_finer(scene, 1, ViewSet(tuple(cameras), images, ("a", "b", "c", "d")), 0)
    assert (less.settings.resolutions, less.settings.finer) == ((4,), (8,))
    before, after = (one.render(cameras[1], "base").rgba for one in (scene, less))
    assert np.ptp(before[..., :3][before[..., 3] > 0.5]) > 0.05
    np.testing.assert_allclose(after, before, atol=1e-3)


@pytest.mark.slow
def test_paint_has_cells_of_its_own() -> None:
    """Colours do without the finer levels that this scene could have; what is painted on it does not."""
    scene = trained("opaque, one region")[0]
    painted, _ = stylize_scene(scene, [style_picture("brush strokes", 48).astype(np.float32)], SHORT, stroke_size=2.0)
    assert painted.styled is not None and isinstance(painted.styled.encoding, SparseLattice)
    cells = paint_cells(scene.occupancy, paint_pixel(scene, SHORT.stylize))
    (finest,) = painted.styled.encoding.resolutions
    assert painted.styled.direct and finest >= cells  # strokes may need finer cells than pixels of the views
    assert cells > scene.settings.resolutions[-1]
    again, camera = Scene.from_bytes(painted.to_bytes()), views_of("opaque, one region").cameras[2].resized(48, 48)
    assert again.settings == painted.settings
    # Extinctions are stored in fewer bits, so at the border of two strokes a pixel may show the other one.
    away = np.abs(again.render(camera).rgba - painted.render(camera).rgba).max(-1)
    assert away.mean() < 2e-3 and (away > 0.05).mean() < 2e-3


def test_why_a_training_stopped_there_and_whether_more_would_help() -> None:
    for factor, gain in ((1.0, 0.0), (10.0**-0.1, 1.0)):
        losses = [torch.tensor(factor ** (number // 10)) for number in range(100)]
        loop = Loop(100, None, silent, "")
        loop.run(lambda number, fraction: losses[number])  # noqa: B023
        assert loop.last_gain() == pytest.approx(gain, abs=1e-4)
        assert loop.last_gain(0.8) == pytest.approx(gain, abs=1e-4)
    falling = Loop(100, None, silent, "")  # what only the fall of the rates gains tells nothing about more steps
    falling.run(lambda number, fraction: torch.tensor(1.0 if number < 80 else 0.1))
    assert falling.last_gain(0.8) == pytest.approx(0.0, abs=1e-4)
    assert falling.last_gain(0.1) is None
    stopped = Loop(100, None, silent, "", done=95)
    stopped.run(lambda number, fraction: torch.tensor(1.0))
    assert stopped.last_gain() is None
    reason = "stage 1 stopped after 120 steps, as in the preset; the last tenth of them at full rates gained"
    assert reason in trained("striped")[1]
