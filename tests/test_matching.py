"""The paper's way to paint: matching brings unseen views closer to the style's features.

The test uses the real weights of VGG-16 on a ball that fills its views.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from svv.core.nnfm import cell_weights, nnfm_loss
from svv.errors import silent
from svv.fields.scene import Scene
from svv.styles.features import load_features
from svv.train.pipeline import stylize_scene
from svv.train.stylize import StyledView, stylization_cameras, visible_from
from tests.balls import MATCHED, STEPS
from tests.solid_ball import solid_ball

if TYPE_CHECKING:
    from svv.styles.weight_files import State

SIZE, STYLE = 64, 96
SCENE = solid_ball()


def stripes() -> np.ndarray:
    row, column = np.mgrid[0:STYLE, 0:STYLE]
    wave = 0.5 + 0.5 * np.sin((column + 0.5 * row) * 0.9)
    return np.stack([wave, 0.6 * wave + 0.2, 1 - wave], axis=-1).astype(np.float32)


@pytest.fixture(scope="module")
def weights(published: Callable[[str], State], tmp_path_factory: pytest.TempPathFactory) -> str:
    """A file of VGG-16's."""
    file: Path = tmp_path_factory.mktemp("vgg") / "vgg16.safetensors"
    save_file(dict(published("vgg16")), file)
    return str(file)


@pytest.fixture(scope="module")
def unseen() -> list[StyledView]:
    """Views from where the matching never looked."""
    rig = SCENE.rig
    cameras = rig.sphere(5, SIZE)
    looked = np.array([c.position for c in stylization_cameras(SCENE, STEPS)])
    away = [c for c in cameras if np.linalg.norm(looked - c.position, axis=1).min() > 0.2 * rig.radius]
    assert len(away) >= 3
    return visible_from(SCENE, away, silent)


def painted(features: str, steps: int) -> Scene:
    preset = replace(MATCHED, stylize=replace(STEPS, style_iterations=steps, style_size=SIZE))
    return stylize_scene(SCENE, [stripes()], preset, mapping={0: 0}, features=features, stroke_size=STYLE / 400)[0]


@torch.no_grad()
def from_style(scene: Scene, views: list[StyledView], features: str) -> float:
    """NNFM of views against the style, taken apart from the loss that trains."""
    network = load_features(features)
    vectors = network(torch.from_numpy(stripes()).permute(2, 0, 1)[None])[0, :, 1:-1, 1:-1].flatten(1).T
    mean, found = vectors.mean(0), []
    assert scene.styled is not None
    for view in views:
        image, mask = view.image(scene.styled(view.position), 0, 0.5)
        whole = cell_weights(mask) > 0.9
        found.append(float(nnfm_loss(network(image[None])[0].flatten(1).T[whole] - mean, vectors - mean)))
    return float(np.mean(found))


@pytest.mark.slow
def test_matching_brings_unseen_views_nearer_to_the_style(unseen: list[StyledView], weights: str) -> None:
    """By a part of their distance that colours, smoothness and chance do not give."""
    before, after = (from_style(painted(weights, steps), unseen, weights) for steps in (0, 20))
    assert after < 0.95 * before
