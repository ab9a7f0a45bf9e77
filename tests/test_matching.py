"""The two halves of painting: if either is left out, a law fails.

The tests use the real weights of VGG-16 on a ball that fills its views. Matching brings unseen views closer to the
style's features. The strokes come from the painted start, because matching creates none from a single colour.
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
from svv.train.style_loss import StyleLossSettings
from svv.train.stylize import StyledView, stylization_cameras, visible_from
from tests.balls import SHORT
from tests.solid_ball import solid_ball

if TYPE_CHECKING:
    from svv.styles.weight_files import State

SIZE, STYLE = 64, 96
STEPS = replace(SHORT, stylize=replace(SHORT.stylize, style_iterations=10, style_views=4, style_size=SIZE))
LAID = replace(STEPS, stylize=replace(STEPS.stylize, style_iterations=0))
LOSS = replace(StyleLossSettings(), style_size=STYLE, anchor=0.0, rate=0.1)
"""Free to move far in a few steps."""

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
    looked = np.array([c.position for c in stylization_cameras(SCENE, STEPS.stylize)])
    away = [c for c in cameras if np.linalg.norm(looked - c.position, axis=1).min() > 0.2 * rig.radius]
    assert len(away) >= 3
    return visible_from(SCENE, away, silent)


def painted(features: str, preset=STEPS, loss: StyleLossSettings = LOSS) -> Scene:  # type: ignore[no-untyped-def]
    return stylize_scene(SCENE, [stripes()], preset, mapping={0: 0}, features=features, loss=loss)[0]


@pytest.fixture(scope="module")
def laid(weights: str) -> Scene:
    return painted(weights, LAID)


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


@torch.no_grad()
def detail(scene: Scene, views: list[StyledView]) -> float:
    """Deviation of what is seen, as a part of the style's."""
    assert scene.styled is not None
    colours = torch.cat([scene.styled(view.position) for view in views])
    return float(colours.std(0).mean()) / float(stripes().std((0, 1)).mean())


@pytest.mark.slow
def test_matching_brings_unseen_views_nearer_to_the_style(laid: Scene, unseen: list[StyledView], weights: str) -> None:
    """By a part of their distance that colours, smoothness and chance do not give."""
    before, after = (from_style(scene, unseen, weights) for scene in (laid, painted(weights)))
    assert after < 0.98 * before


def test_strokes_come_from_the_painted_start_alone(laid: Scene, unseen: list[StyledView], weights: str) -> None:
    flat = painted(weights, loss=replace(LOSS, seeded=False))
    assert detail(laid, unseen) > 0.7
    assert detail(flat, unseen) < 0.3
