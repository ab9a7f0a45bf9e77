"""Strokes as primitives: their paint has the drawn place, width and length, and the kernel equals the reference."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from svv.core.strokes.stroke_reference import noise, paint_at
from svv.core.strokes.strokes import Brush, Strokes, joined, straight_stroke
from svv.fields.strokes.stroke_paint import GROUND, StrokePaint
from tests.nightly import nightly

PLAIN = Brush(relief=0.0, dry=0.0, mixed=0.0)


def curved(seed: int, count: int = 12) -> Strokes:
    """Random arcs on planes of random directions."""
    generator = np.random.default_rng(seed)
    parts = []
    for _ in range(count):
        points = int(generator.integers(2, 12))
        normal = generator.normal(size=3)
        normal /= np.linalg.norm(normal)
        right = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
        right /= np.linalg.norm(right)
        up = np.cross(normal, right)
        turn = np.linspace(0.0, generator.uniform(0.2, 1.5), points)[:, None]
        where = generator.uniform(0.35, 0.65, 3) + 0.15 * (np.cos(turn) * right + np.sin(turn) * up)
        radius = generator.uniform(0.02, 0.05, points).astype(np.float32)
        colour, second = generator.uniform(0.0, 1.0, (2, 1, 3)).astype(np.float32)
        parts.append(
            Strokes(
                where.astype(np.float32), np.tile(normal.astype(np.float32), (points, 1)), radius,
                0.8 * radius, 0.6 * radius, np.array([0, points]),
                colour, second, generator.uniform(1.0, 4.0, 1).astype(np.float32), generator.integers(0, 1024, 1),
            )
        )  # fmt: skip
    return joined(parts)


def wet(strokes: Strokes, every: int = 1) -> Strokes:
    """The strokes, each ``every``-th one laid by a wet brush."""
    bristles = strokes.bristles.copy()
    bristles[::every] = 0.125
    bristles[len(bristles) // 2 :: every] = 0.25
    return replace(strokes, bristles=bristles)


BRUSHES = (
    Brush(relief=0.5, dry=0.6, mixed=0.7, rim=0.3),
    Brush(0.0, 0.0, 0.5, rim=0.6, body=0.0, grain=0.4, flow=0.4, blunt=1.0, ground=(0.9, 0.8, 0.7)),
    Brush(0.2, 1.5, 0.3, rim=-0.2, body=0.6, grain=0.5, tooth=0.15, flow=0.2, feather=0.4, blunt=0.5),
    Brush(0.0, 0.0, 0.3, grain=0.8, feather=0.3, ground=(0.1, 0.2, 0.3)),
)


@pytest.mark.parametrize("seed", nightly(range(4), 0, 3))
@pytest.mark.parametrize("soft", [0.002, 0.012])
@pytest.mark.parametrize("brush", BRUSHES)
def test_the_kernel_equals_the_reference(seed: int, soft: float, brush: Brush) -> None:
    strokes = wet(curved(seed), 2 + seed)
    place = np.random.default_rng(seed).uniform(0.15, 0.85, (6000, 3)).astype(np.float32)
    place[:3000] = strokes.where[np.arange(3000) % len(strokes.where)] + 0.02 * (place[:3000] - 0.5)
    expected, found = paint_at(strokes, brush, place, soft), StrokePaint(strokes, brush, soft).coverage(place)
    assert (expected[:, 3] > 0.5).sum() > 500
    # Where two points are equally near, rounding decides which counts: a few positions may differ.
    assert (np.abs(expected - found).max(1) < 2e-3).mean() > 0.995


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("soft", [0.004, 0.012])
def test_bins_of_wider_edges_give_the_same_paint(seed: int, soft: float) -> None:
    strokes, place = wet(curved(seed), 2 + seed), np.random.default_rng(seed).uniform(0.1, 0.9, (4000, 3))
    wider = StrokePaint(strokes, BRUSHES[0], 1.15 * soft)
    again, own = StrokePaint(strokes, BRUSHES[0], soft, wider), StrokePaint(strokes, BRUSHES[0], soft)
    assert again.bins is wider.bins and own.bins is not wider.bins
    np.testing.assert_array_equal(again.coverage(place), own.coverage(place))
    for other in (1.3 * wider.bins.soft, 0.5 * soft):  # too wide for the bins, or so narrow that they list too much
        assert StrokePaint(strokes, BRUSHES[0], other, wider).bins is not wider.bins


@pytest.mark.parametrize("soft", [0.002, 0.03])
def test_a_bin_lists_every_point_whose_paint_reaches_it(soft: float) -> None:
    strokes = curved(3)
    paint = StrokePaint(strokes, PLAIN, soft)
    size, (start, points) = paint.bins.size, paint.bins.on(torch.device("cpu"))
    place = np.random.default_rng(0).uniform(0.2, 0.8, (3000, 3))
    away = place[:, None] - strokes.where  # (P, K, 3)
    height, along = (away * strokes.normal).sum(2), (away * strokes.frames[0]).sum(2)
    across = (away * np.cross(strokes.normal, strokes.frames[0])).sum(2) - 0.5 * strokes.frames[2] * along**2
    reach = 1.2 * strokes.radius + soft
    near = (height < strokes.outer) & (height > -strokes.inner) & (abs(along) < 2 * reach) & (abs(across) < reach)
    at = np.ravel_multi_index(tuple((place * size).astype(int).T), (size,) * 3)
    assert near.sum() > 300
    for p, k in np.argwhere(near):
        assert k in points[start[at[p]] : start[at[p] + 1]]


def test_a_stroke_covers_its_width_its_length_and_nothing_else() -> None:
    radius = 0.04
    strokes = straight_stroke((0.3, 0.5, 0.5), (0.7, 0.5, 0.5), radius)
    paint = StrokePaint(strokes, PLAIN, 0.002)
    across = np.linspace(-0.1, 0.1, 401)
    line = np.stack([np.full(401, 0.5), 0.5 + across, np.full(401, 0.5)], 1)
    assert paint.coverage(line)[:, 3].mean() * 0.2 == pytest.approx(2 * radius, rel=0.12)
    along = np.stack([np.linspace(0.0, 1.0, 501), np.full(501, 0.5), np.full(501, 0.5)], 1)
    assert paint.coverage(along)[:, 3].mean() == pytest.approx(0.4 + 2 * radius, abs=0.6 * radius + 0.01)
    depth = np.stack([np.full(401, 0.5), np.full(401, 0.5), 0.5 + across], 1)
    assert paint.coverage(depth)[:, 3].mean() * 0.2 == pytest.approx(2 * radius, rel=0.02)


def test_paint_turns_and_moves_with_its_strokes() -> None:
    strokes, brush = curved(5), Brush(relief=0.0, mixed=0.5)
    place = np.random.default_rng(1).uniform(0.2, 0.8, (2000, 3))
    turned = replace(
        strokes, where=np.roll(strokes.where, 1, 1), normal=np.ascontiguousarray(np.roll(strokes.normal, 1, 1))
    )
    before, after = (paint_at(s, brush, p, 0.01) for s, p in ((strokes, place), (turned, np.roll(place, 1, 1))))
    assert np.abs(before - after).max() < 1e-4


def test_the_last_stroke_lies_on_top() -> None:
    low = straight_stroke((0.3, 0.5, 0.5), (0.7, 0.5, 0.5), 0.04, (1.0, 0.0, 0.0))
    top = straight_stroke((0.5, 0.3, 0.5), (0.5, 0.7, 0.5), 0.04, (0.0, 0.0, 1.0))
    for parts, expected in (([low, top], 2), ([top, low], 0)):
        found = StrokePaint(joined(parts), PLAIN, 0.004).coverage(np.array([[0.5, 0.5, 0.5]]))
        assert found[0, 3] == pytest.approx(1.0) and found[0, expected] == pytest.approx(1.0)


def test_between_the_strokes_the_ground_shows_the_nearest_colour_darker() -> None:
    paint = StrokePaint(straight_stroke((0.3, 0.5, 0.5), (0.7, 0.5, 0.5), 0.02, (0.6, 0.4, 0.2)), PLAIN, 0.004)
    assert paint(np.array([[0.5, 0.8, 0.5]]))[0] == pytest.approx(GROUND * np.array([0.6, 0.4, 0.2]), abs=1e-5)


def test_marks_finer_than_a_cell_fade_instead_of_flickering() -> None:
    strokes = replace(straight_stroke((0.2, 0.5, 0.5), (0.8, 0.5, 0.5), 0.05, (0.5, 0.5, 0.5)),
                      bristles=np.array([6.0], np.float32))  # fmt: skip
    line = np.stack([np.full(200, 0.5), np.linspace(0.47, 0.53, 200), np.full(200, 0.5)], 1)
    sharp, blunt = (StrokePaint(strokes, Brush(relief=0.8, dry=0.0), soft)(line)[:, 0] for soft in (0.001, 0.03))
    assert sharp.std() > 4.0 * blunt.std()


def test_strokes_survive_being_packed() -> None:
    strokes = curved(7, 60)
    again = Strokes.unpacked(strokes.packed())
    place = np.random.default_rng(1).uniform(0.2, 0.8, (4000, 3))
    one, two = (StrokePaint(s, Brush(), 0.01).coverage(place) for s in (strokes, again))
    assert np.abs(one - two).mean() < 0.01
    assert all(np.array_equal(again.packed()[name], table) for name, table in strokes.packed().items())


@pytest.mark.parametrize("name", ["points", "strokes", "scale"])
def test_damaged_arrays_are_refused(name: str) -> None:
    arrays = curved(1).packed()
    for damaged in (arrays[name][:-1], arrays[name][:0]):
        with pytest.raises(ValueError, match=r"fit each other|other shapes"):
            Strokes.unpacked({**arrays, name: damaged})


def test_noise_is_smooth_and_within_bounds() -> None:
    x = np.linspace(-20.0, 20.0, 4001)
    values = noise(x, 5)
    assert np.abs(values).max() <= 1.0
    assert np.abs(np.diff(values)).max() < 0.05
