"""Sketches of a known volume: as smooth as the volume itself, and close to its own rendering."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from svv.core.colour.shading import Shading
from svv.dvr.draw.views import make_views
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet
from svv.options.making import TrainOptions
from svv.train import value_sketch
from svv.train.value_sketch import sketch_from_values, sketches_of
from tests.stirred_volume import stirred_transfer_function, stirred_volume

BALANCED = TrainOptions("balanced")


@pytest.fixture(scope="module")
def drawn() -> tuple[ViewSet, ViewSet]:
    """Few small views, and larger ones from elsewhere that tell how good a sketch is."""
    train, test = make_views(stirred_volume(48), stirred_transfer_function(), n=12, test=3, size=128, mapper="cpu")
    assert test is not None
    return train, test


@pytest.fixture(scope="module")
def sketch(drawn: tuple[ViewSet, ViewSet]) -> Scene:
    found = sketch_from_values(drawn[0], 256, BALANCED)
    assert found is not None
    return found


def psnr(scene: Scene, views: ViewSet) -> float:
    """Peak signal-to-noise ratio on white, dB."""

    def on_white(rgba: np.ndarray) -> np.ndarray:
        return rgba[..., :3] * rgba[..., 3:] + 1.0 - rgba[..., 3:]

    errors = [
        np.square(on_white(scene.render(camera).rgba) - on_white(image / 255.0)).mean()
        for camera, image in zip(views.cameras, views.images, strict=True)
    ]
    return float(-10.0 * np.log10(np.mean(errors)))


def test_it_looks_like_the_volume_where_it_was_not_drawn(
    drawn: tuple[ViewSet, ViewSet], sketch: Scene, tmp_path: Path
) -> None:
    assert psnr(sketch, drawn[1]) > 31.0
    assert len(sketch.regions) == 3 and all(region.ranges for region in sketch.regions)
    assert not any(parameter.requires_grad for parameter in sketch.base.parameters())
    sketch.save(tmp_path / "sketch.svv")
    assert psnr(Scene.load(tmp_path / "sketch.svv"), drawn[1]) == pytest.approx(psnr(sketch, drawn[1]), abs=0.5)


def test_its_shape_is_as_fine_as_the_scene_will_be(drawn: tuple[ViewSet, ViewSet], sketch: Scene) -> None:
    coarse = sketch_from_values(drawn[0], 64, BALANCED)
    assert coarse is not None and coarse.base.density is not None and sketch.base.density is not None
    assert coarse.base.density.resolutions[-1] < sketch.base.density.resolutions[-1]


def test_without_shading_nothing_shines() -> None:
    volume, function = stirred_volume(32), stirred_transfer_function()
    flat, _ = make_views(volume, function, n=6, size=48, mapper="cpu", shading=Shading(on=False))
    found = sketch_from_values(flat, 48, BALANCED)
    assert found is not None and found.settings.lighting == "none"


def test_a_fog_gets_coarser_values(drawn: tuple[ViewSet, ViewSet], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(value_sketch, "MOST_VERTICES", 2000)
    found = sketch_from_values(drawn[0], 64, BALANCED)
    assert found is not None and found.settings.resolutions[0] < 48
    assert psnr(found, drawn[1]) > 25.0


def test_where_the_volume_is_not_to_be_used_views_tell(drawn: tuple[ViewSet, ViewSet]) -> None:
    views = drawn[0]
    assert sketch_from_values(replace(views, classified=None), 128, BALANCED) is None
    assert sketch_from_values(views, 128, replace(BALANCED, views_only=True)) is None
    assert sketch_from_values(views, 128, replace(BALANCED, change=("reconstruct.use_volume=false",))) is None
    assert sketch_from_values(views, 128, TrainOptions("paper")) is None
    told: list[float] = []
    assert len(list(sketches_of(views, BALANCED, lambda fraction, label: told.append(fraction)))) == 1
    assert told and max(told) <= 1.0
