"""The shape of a sketch: the volume's own, and nothing else of it changes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from svv.dvr.draw.views import make_views
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet
from svv.train.config import preset
from svv.train.pipeline import train_scene
from svv.train.run.sketches import SKETCHES
from svv.train.sketch_shape import with_shape_of
from tests.stirred_volume import stirred_transfer_function, stirred_volume

LONGEST = 256


@pytest.fixture(scope="module")
def views() -> ViewSet:
    """Views as large as a scene is learned of."""
    return make_views(stirred_volume(48), stirred_transfer_function(), n=12, size=LONGEST, mapper="cpu")[0]


@pytest.fixture(scope="module")
def few(views: ViewSet) -> ViewSet:
    return replace(SKETCHES[0], size=48).few(views)


@pytest.fixture(scope="module")
def sketch(few: ViewSet) -> Scene:
    draft = preset("draft")
    return train_scene(
        few, replace(draft, reconstruct=replace(draft.reconstruct, iterations=30),
                     recolour=replace(draft.recolour, iterations=20)),
    )[0]  # fmt: skip


def test_the_sketch_gets_the_silhouettes_of_the_volume(
    views: ViewSet, few: ViewSet, sketch: Scene, tmp_path: Path
) -> None:
    shaped = with_shape_of(sketch, few, LONGEST, preset("balanced"))
    assert shaped.base.density is not None and sketch.base.density is not None
    assert shaped.base.density.resolutions[-1] >= 2 * sketch.base.density.resolutions[-1]

    def error(scene: Scene) -> float:
        shown = scene.render(views.cameras[0])
        return float(np.abs(shown.rgba[..., 3] - views.images[0, ..., 3] / 255.0).mean())

    assert error(shaped) < 0.85 * error(sketch)
    assert shaped.palette_network is sketch.palette_network and shaped.regions == sketch.regions
    assert not any(parameter.requires_grad for parameter in shaped.base.parameters())
    shaped.save(tmp_path / "shaped.svv")
    again = Scene.load(tmp_path / "shaped.svv")
    assert error(again) == pytest.approx(error(shaped), rel=0.02)


def test_without_a_volume_a_sketch_stays_as_it_is(few: ViewSet, sketch: Scene) -> None:
    balanced = preset("balanced")
    assert with_shape_of(sketch, replace(few, classified=None), LONGEST, balanced) is sketch
    blind = replace(balanced, reconstruct=replace(balanced.reconstruct, use_volume=False))
    assert with_shape_of(sketch, few, LONGEST, blind) is sketch
    coarse = with_shape_of(sketch, few, max(few.images.shape[1:3]), balanced)  # nothing finer can be learned, either
    assert coarse.base.density is not None and sketch.base.density is not None
    assert coarse.base.density.resolutions[-1] >= sketch.base.density.resolutions[-1]
