"""Translucent shells are painted as with glazes: they keep their profile and silhouette, and strokes are seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt, gaussian_filter

from svv.fields.scene.scene import Scene
from svv.styles.gallery import gallery_picture
from svv.train.pipeline import stylize_scene
from svv.train.run.config import StylizeSettings
from tests.balls import SHORT
from tests.solid_ball import RADIUS, solid_ball

SIZE, THICK, DENSE = 160, 0.06, float(np.log(4.0))
"""Pixels along a picture's side; thickness of the shell, and logarithm of its extinction: it is .22 opaque in front."""


@pytest.fixture(scope="module")
def shell() -> Scene:
    return solid_ball(DENSE, RADIUS - THICK)


@pytest.fixture(scope="module", params=["oil", pytest.param("impasto", marks=pytest.mark.slow)])
def painted(request: pytest.FixtureRequest, shell: Scene) -> Scene:
    picture = gallery_picture(request.param, 200)
    short = replace(SHORT, stylize=StylizeSettings(style_views=12, style_size=100))
    scene, report = stylize_scene(shell, [picture], short, manner="strokes", stroke_size=3.0)
    assert any("clearer than they are" in note for note in report["notes"])
    assert scene.regions[0].stroke_opacity > 0.5
    return scene


def seen(scene: Scene) -> np.ndarray:
    return np.asarray(scene.render(scene.rig.orbit(9, SIZE, [2])[0]).rgba, np.float64)


def from_rim(plain: np.ndarray) -> np.ndarray:
    """Distance of pixels from the silhouette, 0 outside."""
    return np.asarray(distance_transform_edt(plain[..., 3] > 0.03))


def contrast(image: np.ndarray, core: np.ndarray, paper: float) -> float:
    """Deviation of colours over paper from their mean within a stroke's width, where ``core`` is."""
    shown = image[..., :3] * image[..., 3:] + paper * (1.0 - image[..., 3:])
    around = gaussian_filter(core.astype(float), 3.0)
    smooth = [gaussian_filter(channel * core, 3.0) / np.maximum(around, 1e-6) for channel in np.moveaxis(shown, -1, 0)]
    return float(np.sqrt(np.square(shown - np.stack(smooth, -1)).sum(-1)[core].mean()))


@pytest.mark.parametrize("moving", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["still", "moving"])
def test_a_shell_keeps_its_profile_and_its_silhouette(shell: Scene, painted: Scene, moving: bool) -> None:
    """Strokes are as opaque as the shell: more made it ragged where it turns away, and clear ground made holes."""
    plain, glazed = (seen(s.while_moving() if moving else s) for s in (shell, painted))
    lost, away = plain[..., 3] - glazed[..., 3], from_rim(plain)
    thing, rim = away > 0.0, (away > 0.0) & (away <= 3.0)
    assert lost.min() > -0.01
    assert lost[rim].mean() < 0.2 * plain[rim, 3].mean() and lost[thing].mean() < 0.25 * plain[thing, 3].mean()
    assert not (lost[rim] > 0.25).any() and (lost[thing] > 0.25).mean() < 0.01


@pytest.mark.parametrize("paper", [0.0, 1.0], ids=["black", "white"])
def test_strokes_are_seen_on_a_shell(shell: Scene, painted: Scene, paper: float) -> None:
    plain = seen(shell)
    core = from_rim(plain) > 12.0
    found = contrast(seen(painted), core, paper)
    assert found > 0.05 and found > 3.0 * contrast(plain, core, paper)
