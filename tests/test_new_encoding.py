"""A new encoding takes a class and one line: here a dense grid, which trains, renders and is read from its file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor
from torch.nn.functional import grid_sample

from svv.core.geometry.cameras import sphere_cameras
from svv.fields.radiance.encodings import Encoding
from svv.fields.radiance.networks import ENCODINGS
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet
from svv.train.pipeline import train_scene
from svv.train.run.config import preset
from tests.balls import SHORT, two_balls

SIDE, FEATURES = 24, 4


class DenseGrid(Encoding):
    """Features on all vertices of one grid, interpolated by PyTorch."""

    def __init__(self) -> None:
        super().__init__(SIDE**3, FEATURES, 1)

    def interpolated(self, x: Tensor, table: Tensor) -> Tensor:
        grid = table.T.reshape(1, FEATURES, SIDE, SIDE, SIDE)
        found = grid_sample(grid, (2.0 * x - 1.0)[None, None, None], align_corners=True)
        return found[0, :, 0, 0].T.contiguous()

    def look_up(self, x: Tensor) -> Tensor:
        return self.interpolated(x, self.table.detach())

    def add_gradient(self, x: Tensor, gradient: Tensor) -> None:
        own, used = self.buffers_for_gradient()
        with torch.enable_grad():
            table = self.table.detach().requires_grad_()
            own += torch.autograd.grad(self.interpolated(x, table), table, gradient)[0]
        used.fill_(1)


@pytest.fixture(autouse=True)
def dense(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(ENCODINGS, "dense", lambda settings, occupancy: DenseGrid())


def test_a_preset_takes_it_with_the_paper_s_rates() -> None:
    chosen, paper = preset("fast", "dense"), preset("paper")
    assert chosen.field.encoding == "dense" and chosen.reconstruct.feature_rate == paper.reconstruct.feature_rate
    assert chosen.reconstruct.iterations == preset("fast").reconstruct.iterations


@pytest.mark.slow
def test_a_scene_of_it_trains_and_is_the_same_after_its_file(tmp_path: Path) -> None:
    cameras = sphere_cameras(12, (0.0, 0.0, 0.0), 4.0, np.radians(30), 40)
    images = np.stack([two_balls(camera) for camera in cameras])
    views = ViewSet(tuple(cameras), images, tuple(f"r_{k:04d}" for k in range(len(cameras))))
    own = preset("draft", "dense")
    quick = replace(
        own,
        reconstruct=replace(SHORT.reconstruct, feature_rate=0.02, iterations=120),
        recolour=replace(SHORT.recolour, iterations=60),
    )
    scene, report = train_scene(views, quick)
    assert report["encoding"] == "dense" and isinstance(scene.base.encoding, DenseGrid)
    shown = scene.render(cameras[5]).rgba
    truth = images[5] / 255.0
    error = np.square(shown[..., :3] * shown[..., 3:] - truth[..., :3] * truth[..., 3:]).mean()
    assert -10.0 * np.log10(error) > 14.0  # two balls on nothing, and not fog
    scene.save(tmp_path / "dense.svv")
    again = Scene.load(tmp_path / "dense.svv")
    assert isinstance(again.base.encoding, DenseGrid)
    np.testing.assert_allclose(again.render(cameras[5]).rgba, shown, atol=0.02)  # half precision
