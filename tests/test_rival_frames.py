"""Modes that stylize frames: the terms of the video's temporal loss, and the effect of AdaIN on statistics."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import nn

from svv.core.geometry.cameras import sphere_cameras
from svv.styles.features import PatchFeatures
from svv.train.match.style_loss import StyleLossSettings, StyleTarget
from svv_bench.styles.flow import camera_flow, is_consistent, splatted
from svv_bench.styles.rival_frames import (
    LEAST_VARIANCE,
    Before,
    StatisticsLoss,
    frame_after,
    frame_alone,
    frame_of_statistics,
    statistics_of,
    with_style_colours,
)
from tests.untrained import untrained

SIZE, STEPS = 64, 12
CAMERAS = sphere_cameras(300, (0.0, 0.0, 0.0), 4.0, np.radians(25), SIZE)
NETWORK = untrained()
LOSS = StyleLossSettings(style_size=SIZE)


def ball(number: int) -> tuple[np.ndarray, np.ndarray]:
    """A ball with a soft gradient on it: straight RGBA (h, w, 4) in [0, 1], and distances (h, w)."""
    origins, directions = CAMERAS[number].rays()
    along = -(origins * directions).sum(-1)
    inside = 0.75**2 - ((origins + along[..., None] * directions) ** 2).sum(-1)
    depth = np.where(inside > 0, along - np.sqrt(np.maximum(inside, 0)), np.nan)
    point = np.nan_to_num(origins + depth[..., None] * directions)
    colour = 0.5 + 0.3 * point
    return np.concatenate([colour, (inside > 0)[..., None]], -1).astype(np.float32), depth


def nearest_pair() -> tuple[int, int]:
    """Two cameras beside each other."""
    places = np.array([c.position for c in CAMERAS])
    return 0, int(np.linalg.norm(places[1:] - places[0], axis=1).argmin()) + 1


def warped(first: int, second: int, colours: np.ndarray) -> Before:
    """Colours of one view, seen from the other."""
    (_, depth), (_, other) = ball(first), ball(second)
    flow = camera_flow(CAMERAS[first], CAMERAS[second], depth)
    back = camera_flow(CAMERAS[second], CAMERAS[first], other)
    moved, arrived = splatted(colours[..., :3], flow, -np.nan_to_num(depth))
    return Before(moved, is_consistent(back, flow) & (arrived >= 0.5))


@pytest.fixture(scope="module")
def stripes() -> torch.Tensor:
    row, column = np.mgrid[0:SIZE, 0:SIZE]
    wave = 0.5 + 0.5 * np.sin((column + 0.5 * row) * 0.7)
    return torch.from_numpy(np.stack([wave, 0.6 * wave + 0.2, 1 - wave]).astype(np.float32))


def test_from_one_camera_the_next_frame_is_the_same(stripes: torch.Tensor) -> None:
    rgba = ball(0)[0]
    first = frame_alone(rgba, NETWORK, stripes, LOSS, STEPS, 0)
    before = warped(0, 0, first)
    seen = before.valid & (rgba[..., 3] > 0)
    assert seen.sum() > 0.9 * (rgba[..., 3] > 0).sum()
    again = frame_after(rgba, before, NETWORK, stripes, LOSS, STEPS, 0)
    np.testing.assert_array_equal(again[..., 3], rgba[..., 3])

    def apart(a: np.ndarray, b: np.ndarray) -> float:
        return float(np.sqrt(np.square(a - b)[seen][:, :3].mean()))

    assert apart(again, first) < 0.2 * apart(first, rgba)


def test_the_temporal_loss_holds_frames_together(stripes: torch.Tensor) -> None:
    one, two = nearest_pair()
    first, second = ball(one)[0], ball(two)[0]
    start = frame_alone(first, NETWORK, stripes, LOSS, STEPS, 0)
    before = warped(one, two, start)
    seen = before.valid & (second[..., 3] > 0)
    assert seen.sum() > 300

    def differs(frame: np.ndarray) -> float:
        return float(np.sqrt(np.square(frame[..., :3] - before.colours)[seen].mean()))

    alone = differs(frame_alone(second, NETWORK, stripes, LOSS, STEPS, 0))
    free, held = (
        differs(frame_after(second, before, NETWORK, stripes, LOSS, STEPS, 0, **h)) for h in ({"held": 0.0}, {})
    )
    assert held < 0.7 * free and held < 0.7 * alone


def test_where_nothing_arrives_a_frame_is_painted_too(stripes: torch.Tensor) -> None:
    rgba = ball(0)[0]
    nothing = Before(np.full((SIZE, SIZE, 3), np.nan), np.zeros((SIZE, SIZE), bool))
    made = frame_after(rgba, nothing, NETWORK, stripes, LOSS, STEPS, 0)
    assert np.isfinite(made).all()
    assert np.abs(made - rgba)[rgba[..., 3] > 0].max() > 0.1


@pytest.mark.parametrize("network", [NETWORK, PatchFeatures()])
def test_adain_gives_features_the_style_s_statistics(stripes: torch.Tensor, network: nn.Module) -> None:
    rgba = ball(0)[0]
    target = StyleTarget(network, stripes, LOSS)
    colours, mask = (torch.from_numpy(rgba).permute(2, 0, 1)[k] for k in (slice(3), 3))
    measure = StatisticsLoss(target, colours, mask)

    def away(picture: torch.Tensor) -> float:
        found = statistics_of(*measure.features(picture, mask))
        return sum(float((a - b).square().sum()) for a, b in zip(found, measure.statistics, strict=True))

    made = frame_of_statistics(rgba, network, stripes, LOSS, 3 * STEPS, 0)
    np.testing.assert_array_equal(made[..., 3], rgba[..., 3])
    after = away(torch.from_numpy(made).permute(2, 0, 1)[:3])
    assert after < 0.5 * away(with_style_colours(colours, mask, target)) and after < 0.5 * away(colours)


def test_adain_s_target_has_the_style_s_statistics_and_the_frame_s_places(stripes: torch.Tensor) -> None:
    rgba = torch.from_numpy(ball(0)[0]).permute(2, 0, 1)
    measure = StatisticsLoss(StyleTarget(NETWORK, stripes, LOSS), rgba[:3], rgba[3])
    features, weights = measure.features(rgba[:3], rgba[3])
    mean, deviation = statistics_of(measure.features_wanted, weights)
    wanted, spread = measure.statistics
    torch.testing.assert_close(mean, wanted, atol=1e-3, rtol=1e-3)
    lively = statistics_of(features, weights)[1] > 10 * LEAST_VARIANCE**0.5
    assert lively.sum() > 5
    torch.testing.assert_close(deviation[lively], spread[lively], atol=0.01, rtol=0.03)


@given(st.integers(0, 2**31), st.integers(2, 40), st.integers(1, 5))
def test_statistics_count_by_weight(seed: int, count: int, channels: int) -> None:
    """A vector of weight 2 is as good as two of weight 1; one of weight 0 is not there."""
    drawn = partial(torch.randn, generator=torch.Generator().manual_seed(seed))
    features = drawn(count, channels)
    times = torch.arange(count) % 3
    weighted = statistics_of(features, times.float())
    repeated = features.repeat_interleave(times, 0)
    torch.testing.assert_close(weighted[0], repeated.mean(0), atol=1e-5, rtol=1e-4)
    variance = repeated.var(0, unbiased=False) + LEAST_VARIANCE
    torch.testing.assert_close(weighted[1], variance.sqrt(), atol=1e-4, rtol=1e-3)


def test_adain_gives_early_layers_the_style_s_statistics(stripes: torch.Tensor) -> None:
    """They carry the hue, about which the later ones say little; features that are not VGG-16's have none."""
    rgba = ball(0)[0]
    colours, mask = (torch.from_numpy(rgba).permute(2, 0, 1)[k] for k in (slice(3), 3))
    measure = StatisticsLoss(StyleTarget(NETWORK, stripes, LOSS), colours, mask)
    assert [len(mean) for mean, _ in measure.early] == [64, 128]
    made = torch.from_numpy(frame_of_statistics(rgba, NETWORK, stripes, LOSS, 2 * STEPS, 0)).permute(2, 0, 1)
    assert measure.early_loss(made[:3], mask) < 0.5 * measure.early_loss(colours, mask)
    assert (
        float(StatisticsLoss(StyleTarget(PatchFeatures(), stripes, LOSS), colours, mask).early_loss(colours, mask)) == 0
    )
