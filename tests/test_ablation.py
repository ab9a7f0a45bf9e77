"""The measures of `svv bench ablate` for palette networks: their laws, on a network whose offsets are known."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from svv.core.colour import palette_shading
from svv.core.geometry.cameras import sphere_cameras
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet
from svv_bench.ablation.palette import offset_size
from tests.cube import cube_scene

CAMERAS = sphere_cameras(4, (0.0, 0.0, 0.0), 3.0, 0.5, 24)
VIEWS = ViewSet(tuple(CAMERAS), np.full((4, 24, 24, 4), 255, np.uint8), tuple("abcd"))
OFFSETS = st.tuples(*[st.floats(-1, 1, width=32)] * 3)


class Constant(torch.nn.Module):
    """A palette MLP that says the same everywhere."""

    def __init__(self, says: torch.Tensor) -> None:
        super().__init__()
        self.says = says

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return self.says.expand(len(x), -1)


@pytest.fixture(scope="module")
def scene() -> Scene:
    """A scene whose palette MLP these tests replace."""
    return cube_scene()


def size_of(scene: Scene, logits: list[float], offsets: list[tuple[float, ...]]) -> tuple[float, np.ndarray]:
    """What is measured, and the palette weights, of a network with these offsets in all places."""
    palette = scene.palette_network
    assert palette is not None
    count = len(palette.colours)
    says = torch.tensor([0.5, *logits[:count], *np.ravel(offsets[:count])], dtype=torch.float32)
    palette.palette_mlp = Constant(says)  # type: ignore[assignment]
    _, weights, _ = palette_shading.material(says[None])
    return offset_size(scene, VIEWS, 0), weights[0].numpy()


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(-4, 4), min_size=8, max_size=8), st.lists(OFFSETS, min_size=8, max_size=8))
def test_the_size_is_that_of_the_mixed_offset(
    scene: Scene, logits: list[float], offsets: list[tuple[float, ...]]
) -> None:
    size, weights = size_of(scene, logits, offsets)
    mixed = weights @ np.array(offsets[: len(weights)])
    assert size == pytest.approx(np.sqrt(np.square(mixed).mean()), rel=1e-3, abs=1e-5)


def test_no_offsets_have_no_size(scene: Scene) -> None:
    assert size_of(scene, [0.0] * 8, [(0.0, 0.0, 0.0)] * 8)[0] == 0.0
