"""Visible contrast of paint: how it is measured, that it is matched to the style's, and cases where it cannot be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from svv.errors import silent
from svv.fields.radiance.networks import UnrestrictedField
from svv.fields.scene.scene import Scene
from svv.train.base.resolutions import paint_pixel
from svv.train.paint.contrast import LEAST, MOST, contrasts, match_contrast, stroke_scales, surroundings
from svv.train.paint.painting import painted_field
from svv.train.paint.pieces import PieceSettings, PieceStyle, piece_style
from svv.train.paint.styled_views import visible_from
from svv.train.pipeline import stylize_scene
from tests.balls import SHORT
from tests.nightly import nightly
from tests.solid_ball import solid_ball

SIZE = 64
SETTINGS = replace(SHORT.stylize, style_size=SIZE)
BALL, FOG = solid_ball(), solid_ball(0.5)


def speckled(deviation: float) -> torch.Tensor:
    """A picture of blurred noise about grey. (3, SIZE, SIZE)"""
    noise = torch.randn(1, 3, SIZE, SIZE, generator=torch.Generator().manual_seed(0))
    noise = torch.nn.functional.avg_pool2d(noise, 3, 1, 1)[0]
    return 0.5 + deviation * noise / noise.std()


def target(picture: torch.Tensor) -> PieceStyle:
    return piece_style(picture.permute(1, 2, 0).numpy(), None, PieceSettings(size=SIZE))


def waves(scene: Scene, height: float, length: float) -> UnrestrictedField:
    """Paint of waves of colour, ``length`` pixels long."""
    field = painted_field(scene, paint_pixel(scene, SETTINGS))
    place = field.encoding.places_of_level(0, scene.occupancy.occupied, scene.occupancy.cells)  # type: ignore[operator, union-attr]
    phase = torch.from_numpy(place) * (2 * torch.pi / (length * paint_pixel(scene, SETTINGS)))
    with torch.no_grad():
        field.encoding.table.copy_(0.5 + height * torch.sin(phase))  # type: ignore[operator, union-attr]
    return field


@torch.no_grad()
def seen(scene: Scene, field: Callable[[torch.Tensor], torch.Tensor]) -> tuple[float, float]:
    """Contrast in views other than those that gains are solved in."""
    pictures = []
    for view in visible_from(scene, scene.rig.sphere(5, SIZE), silent):
        image, mask = view.image(field(view.position), 0, 0.0)
        pictures.append((image / mask.clamp_min(1e-3), (mask > 0.9 * mask.median().clamp_min(0.5)).to(mask)))
    found = contrasts(pictures)
    assert found is not None
    return found


# --- what is measured ------------------------------------------------------------------------------------------------


@given(st.floats(0.01, 0.2), st.integers(2, 12))
def test_contrast_of_a_board_of_squares(height: float, side: int) -> None:
    row, column = np.mgrid[0:60, 0:60] // side
    board = torch.from_numpy(np.broadcast_to(0.5 + height * (-1.0) ** (row + column), (3, 60, 60)).copy())
    found = contrasts([(board, torch.ones(60, 60, dtype=board.dtype))])
    assert found is not None
    assert found[0] == pytest.approx(height * 3**0.5, rel=0.05)
    assert 0.0 < found[1] <= found[0] * 1.05
    if side == 12:  # most patches lie in one square
        assert found[1] < 0.7 * found[0]


def test_contrast_counts_only_where_a_region_is() -> None:
    picture, mask = speckled(0.1), torch.zeros(SIZE, SIZE)
    mask[10:50, 10:50] = 1.0
    beside = picture.clone()
    beside[:, mask == 0] = 1.0
    assert contrasts([(picture, mask)]) == contrasts([(beside, mask)])
    assert contrasts([(picture, torch.zeros(SIZE, SIZE))]) is None
    assert contrasts([(picture[:, :3], mask[:3])]) is None


@given(st.tuples(*[st.floats(0, 1)] * 3), st.floats(0.01, 0.5), st.integers(1, 200))
def test_surroundings_of_one_colour_are_that_colour(colour: tuple[float, ...], reach: float, count: int) -> None:
    place = np.random.default_rng(count).uniform(0, 1, (count, 3)).astype(np.float32)
    colours = np.tile(np.float32(colour), (count, 1))
    np.testing.assert_allclose(surroundings(place, colours, reach), colours, atol=1e-4)


def test_surroundings_keep_slopes_and_lose_specks() -> None:
    place = np.random.default_rng(0).uniform(0, 1, (40000, 3)).astype(np.float32)
    noise = np.random.default_rng(1).normal(0, 0.1, place.shape)
    found = surroundings(place, (place + noise).astype(np.float32), 0.1)
    within = np.all((place > 0.15) & (place < 0.85), axis=1)
    assert np.abs(found - place)[within].mean() < 0.02


# --- what is solved --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("height", nightly([0.08, 0.15, 0.3], 0.08))
def test_paint_of_any_contrast_is_seen_with_that_of_its_style(height: float) -> None:
    style = speckled(0.15)
    field = waves(BALL, height, 8.0)
    wanted, before = contrasts([(style, torch.ones(SIZE, SIZE))]), seen(BALL, field)
    assert wanted is not None
    gains = match_contrast(BALL, field, {0: target(style)}, SETTINGS)[0]
    after = seen(BALL, field)
    assert all(LEAST <= g <= MOST for g in gains)
    if LEAST < gains[1] < MOST:
        assert after[1] == pytest.approx(wanted[1], rel=0.1)
    else:  # as near as the bounds let it
        assert abs(np.log(after[1] / wanted[1])) < abs(np.log(before[1] / wanted[1]))
    table = field.encoding.table.detach()  # type: ignore[operator, union-attr]
    assert float(table.min()) >= 0.0
    assert float(table.max()) <= 1.0


def test_paint_that_has_its_styles_contrast_is_left_alone() -> None:
    field = waves(BALL, 0.2, 8.0)
    found = seen(BALL, field)
    noise = speckled(0.2)
    own = contrasts([(noise, torch.ones(SIZE, SIZE))])
    assert own is not None
    style = 0.5 + (noise - 0.5) * found[1] / own[1]
    assert match_contrast(BALL, field, {0: target(style)}, SETTINGS)[0][1] == pytest.approx(1.0, abs=0.1)


def test_other_regions_than_those_painted_keep_their_colours() -> None:
    field = waves(BALL, 0.1, 8.0)
    before = field.encoding.table.clone()  # type: ignore[union-attr, operator]
    assert match_contrast(BALL, field, {}, SETTINGS) == {}
    assert torch.equal(before, field.encoding.table)  # type: ignore[union-attr, arg-type]


# --- strokes of what one looks into ----------------------------------------------------------------------------------


def test_strokes_are_larger_where_one_sees_deep() -> None:
    pixel = paint_pixel(BALL, SETTINGS) * SIZE / 100  # the ball fades in over two cells of 32
    assert stroke_scales(BALL, [0], pixel, 3.0) == {0: 1.0}
    assert stroke_scales(FOG, [0], pixel, 3.0) == {0: 3.0}
    assert stroke_scales(FOG, [0], pixel, 1.0) == {0: 1.0}
    assert stroke_scales(FOG, [0, 1], pixel, 3.0)[1] == 1.0  # nothing of it is seen


@pytest.mark.slow
def test_fog_is_painted_with_the_contrast_of_its_style() -> None:
    """Most of it: of strokes that lie behind each other less is seen, and what is solved makes up for it."""
    row, column = np.mgrid[0:96, 0:96]
    wave = 0.5 + 0.4 * np.sin((column + 0.5 * row) * 0.4)
    style = np.stack([wave, 0.6 * wave + 0.2, 1 - wave], axis=-1).astype(np.float32)
    wanted = contrasts([(torch.from_numpy(style).permute(2, 0, 1), torch.ones(96, 96))])
    assert wanted is not None
    preset = replace(SHORT, stylize=SETTINGS)
    painted = stylize_scene(FOG, [style], preset, mapping={0: 0}, manner="pieces", pieces=PieceSettings(size=96))[0]
    assert painted.styled is not None
    assert seen(FOG, painted.styled)[0] > 0.7 * wanted[0]
