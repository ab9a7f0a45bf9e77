"""The laying of paint: form, pieces of the style on surfaces, and what a scene is painted with."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from svv.core.geometry.box import Box
from svv.errors import silent
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.scene.scene import Scene
from svv.train.base.resolutions import paint_pixel
from svv.train.paint.painting import MOST_CELLS, MOST_VERTICES, Remarks, Start, paint_cells, painted_start
from svv.train.paint.pieces import PieceSettings, PieceStyle, piece_style
from svv.train.paint.quilt import Guides, Manner, Quilt, spread
from svv.train.paint.quilt_kernels import mirrored, misfits, places
from svv.train.paint.styled_views import stylization_cameras, visible_from
from svv.train.paint.surface_form import Form, form_of_opacity, tangents
from tests.balls import SHORT

CELLS = 64
UP = (0.0, 1.0, 0.0)
GRID = np.stack(np.meshgrid(*[(np.arange(CELLS) + 0.5) / CELLS - 0.5] * 3, indexing="ij"), -1)


def tube(axis: np.ndarray, radius: float) -> Form:
    """Form of a straight tube through the middle of the box."""
    axis = axis / np.linalg.norm(axis)
    away = np.linalg.norm(GRID - (GRID @ axis)[..., None] * axis, axis=-1)
    return form_of_opacity(np.clip((radius - away) * CELLS + 0.5, 0, 1).astype(np.float32), CELLS, UP)


def on_tube(axis: np.ndarray, radius: float, count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points of its surface that are not near its ends, their outward normals, and where along it they lie."""
    axis = axis / np.linalg.norm(axis)
    rng = np.random.default_rng(seed)
    first = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    first /= np.linalg.norm(first)
    angle, along = rng.uniform(0, 2 * np.pi, count), rng.uniform(-0.25, 0.25, count)
    normal = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * np.cross(axis, first)
    return (0.5 + along[:, None] * axis + radius * normal).astype(np.float32), normal, along


# --- form ------------------------------------------------------------------------------------------------------------


@given(st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.3), st.floats(0.1, 0.2))
@pytest.mark.slow
def test_strokes_run_along_a_tube_whatever_its_direction(axis: tuple[float, ...], radius: float) -> None:
    direction = np.array(axis) / np.linalg.norm(axis)
    points, outward, _ = on_tube(direction, radius, 200)
    normal, tangent, decided = tube(direction, radius).frames(points)
    assert (normal * outward).sum(1).min() > 0.97
    assert np.abs(tangent @ direction).min() > 0.95
    assert decided.min() > 0.4
    np.testing.assert_allclose((normal * tangent).sum(1), 0.0, atol=1e-5)


def test_a_ball_has_no_direction_and_strokes_on_it_lie_level() -> None:
    opacity = np.clip((0.3 - np.linalg.norm(GRID, axis=-1)) * CELLS + 0.5, 0, 1).astype(np.float32)
    outward = np.random.default_rng(0).normal(size=(300, 3))
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    outward = outward[np.abs(outward[:, 1]) < 0.9]
    normal, tangent, decided = form_of_opacity(opacity, CELLS, UP).frames((0.5 + 0.3 * outward).astype(np.float32))
    assert (normal * outward).sum(1).min() > 0.99
    assert decided.max() < 0.1
    assert np.abs(tangent[:, 1]).max() < 0.35  # up has hardly a part in it


@given(st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1))
def test_right_and_up_are_those_of_someone_who_looks_at_the_surface(direction: tuple[float, ...]) -> None:
    normal = np.array([direction]) / np.linalg.norm(direction)
    right, up = tangents(normal, np.array(UP))
    np.testing.assert_allclose(np.cross(right, up), normal, atol=1e-9)
    assert up[0, 1] > -1e-9 or abs(normal[0, 1]) > 0.97


# --- pieces ----------------------------------------------------------------------------------------------------------


@given(st.integers(-1000, 1000), st.integers(1, 50))
def test_a_mirrored_picture_has_no_jump(i: int, n: int) -> None:
    assert 0 <= mirrored(i, n) < n
    assert abs(mirrored(i, n) - mirrored(i + 1, n)) <= 1
    assert mirrored(i, n) == mirrored(-i, n)


@given(st.integers(0, 2**31), st.integers(1, 30), st.integers(1, 9))
def test_misfit_is_the_weighted_mean_of_squared_differences(seed: int, points: int, candidates: int) -> None:
    rng = np.random.default_rng(seed)
    picture = rng.random((23, 31, 3)).astype(np.float32)
    at, weight = rng.uniform(-40, 40, (points, 2)).astype(np.float32), rng.random(points).astype(np.float32) + 0.1
    colours = rng.random((points, 3)).astype(np.float32)
    centre = (rng.random((candidates, 2)) * (31, 23)).astype(np.float32)
    turn, found = rng.uniform(-1.5, 1.5, candidates).astype(np.float32), np.empty(candidates, np.float32)
    misfits(picture, at, weight, colours, centre, turn, found)
    padded = np.pad(picture, ((200, 200), (200, 200), (0, 0)), mode="reflect")
    for k in range(candidates):
        c, s = np.cos(turn[k]), np.sin(turn[k])
        u = centre[k, 0] + c * at[:, 0] + s * at[:, 1]
        v = centre[k, 1] + s * at[:, 0] - c * at[:, 1]
        if np.abs(np.concatenate([u, v]) % 1 - 0.5).min() < 1e-3:
            continue  # between two pixels either is right
        seen = padded[np.rint(v).astype(int) + 200, np.rint(u).astype(int) + 200]
        expected = (weight * np.square(seen - colours).sum(1)).sum() / weight.sum()
        assert found[k] == pytest.approx(expected, rel=1e-4)


def test_on_a_plane_a_pixel_is_a_pixel_and_on_a_tube_the_arc_counts() -> None:
    right, up, outward = np.eye(3, dtype=np.float32)
    middle, radius = np.zeros(3, np.float32), np.float32(0.5)
    position = np.array([[0.1, 0.2, 0.0], [0.1, 0.2, 0.05], [0.0, 0.45, 0.0]], np.float32)
    at, suits = np.empty((3, 2), np.float32), np.empty(3, np.float32)
    places(position, np.tile(outward, (3, 1)), middle, right, up, outward, radius, False, at, suits)
    np.testing.assert_allclose(at, position[:, :2] / radius, atol=1e-6)  # the depth does not count
    assert suits[0] > suits[2] > 0
    angle = np.linspace(0.1, 1.2, 8)
    normal = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], 1).astype(np.float32)
    tube_radius = 0.3
    bent = (tube_radius * normal - tube_radius * outward + [0.0, 0.05, 0.0]).astype(np.float32)
    at, suits = np.empty((8, 2), np.float32), np.empty(8, np.float32)
    places(bent, normal, middle, right, up, outward, radius, False, at, suits)
    np.testing.assert_allclose(at[:, 0], tube_radius * angle / radius, rtol=1e-3)
    np.testing.assert_allclose(at[:, 1], 0.1, rtol=1e-3)
    # Not the other side of a sheet, nor what lies far away.
    places(position, np.tile(-outward, (3, 1)), middle, right, up, outward, radius, False, at[:3], suits[:3])
    assert (suits[:3] < 0).all()


@given(st.integers(0, 2**31), st.floats(0.05, 0.5))
def test_seeds_keep_their_distance_and_leave_no_gap(seed: int, distance: float) -> None:
    points = np.random.default_rng(seed).random((300, 3)).astype(np.float32)
    chosen = points[spread(points, distance)]
    between = np.linalg.norm(chosen[:, None] - chosen, axis=2)
    assert (between + np.eye(len(chosen)) > distance * (1 - 1e-5)).all()
    assert np.linalg.norm(points[:, None] - chosen, axis=2).min(1).max() <= distance * (1 + 1e-5)


def lines(size: int = 120, width: int = 4, red: bool = True) -> np.ndarray:
    """Level lines, black on white, here and there with some red."""
    rows = (np.arange(size) // width % 2).astype(np.float32)
    picture = np.repeat(rows[:, None, None], size, 1).repeat(3, 2)
    if red:
        picture[:, ::17] = (0.8, 0.1, 0.1)
    return picture


def test_lines_follow_a_tube_and_no_colour_is_invented() -> None:
    axis = np.array([1.0, 0.7, 0.4])
    axis /= np.linalg.norm(axis)
    form, pixel = tube(axis, 0.15), 1 / 250
    surface = on_tube(axis, 0.15, 6000)[0]
    picture = lines(red=False)
    quilt = Quilt(Manner(picture), form, surface, pixel, 0, silent)
    points, normal, _ = on_tube(axis, 0.15, 3000, 1)
    around = np.cross(normal, axis).astype(np.float32)
    here = quilt(points)
    step = 4 * pixel
    moved = [quilt((points + step * d).astype(np.float32)) for d in (np.float32(axis), around)]
    along, across = (np.square(m - here).mean() for m in moved)
    assert along < 0.5 * across  # a line's width further on is the same line, and across it the next
    assert 0.0 <= here.min() and here.max() <= 1.0
    assert np.abs(here - np.round(here)).mean() < 0.15  # black and white but for the edges between
    assert quilt(points).std() > 0.9 * picture.std()


def test_pieces_take_all_of_the_picture_and_a_seed_decides_which() -> None:
    axis = np.array([0.0, 0.0, 1.0])
    form, surface = tube(axis, 0.2), on_tube(axis, 0.2, 6000)[0]
    picture = np.zeros((100, 100, 3), np.float32)
    picture[:50, :50, 0] = picture[50:, :50, 1] = picture[:50, 50:, 2] = 1.0
    made = [Quilt(Manner(picture), form, surface, 1 / 400, seed, silent)(surface) for seed in (0, 0, 1)]
    np.testing.assert_array_equal(made[0], made[1])
    assert np.abs(made[0] - made[2]).mean() > 0.05
    share = [(made[0][:, k] > 0.5).mean() for k in range(3)]
    assert min(share) > 0.05 and max(share) < 0.6


def test_what_pieces_are_chosen_by_can_be_left_out() -> None:
    """Not along the form, all stand upright; without tone, how light a piece is has nothing to do with the light."""
    axis = np.array([1.0, 0.3, 0.2])
    form, surface = tube(axis, 0.2), on_tube(axis, 0.2, 6000)[0]
    picture = lines(red=False) * np.linspace(0.2, 1.0, 120, dtype=np.float32)[:, None]
    manner = Manner(picture)

    def laid(guides: Guides) -> tuple[float, float]:
        """How far pieces are turned, and how their brightness goes with the light."""
        quilt = Quilt(manner, form, surface, 1 / 300, 0, silent, guides)
        column, row = quilt.centre.T.astype(int)
        return float(np.abs(quilt.turn).mean()), float(np.corrcoef(manner.rank[row, column], quilt._wanted)[0, 1])

    turned, toned = laid(Guides())
    assert turned > 0.1 and toned > 0.5
    assert laid(Guides(along_form=False))[0] == 0.0
    assert abs(laid(Guides(tone=0.0))[1]) < 0.5 * toned


@pytest.mark.parametrize("shape", [(24, 24), (24, 300), (16, 16)])
@pytest.mark.parametrize("flat", [True, False])
def test_tiny_and_flat_pictures_are_laid_too(shape: tuple[int, int], flat: bool) -> None:
    axis = np.array([0.0, 1.0, 0.0])
    rng = np.random.default_rng(0)
    picture = np.full((*shape, 3), 0.4, np.float32) if flat else rng.random((*shape, 3), np.float32)
    surface = on_tube(axis, 0.15, 500)[0]
    made = Quilt(Manner(picture), tube(axis, 0.15), surface, 1 / 200, 0, silent)(surface)
    assert np.isfinite(made).all() and abs(made.mean() - picture.mean()) < 0.1


def test_a_piece_has_its_middle_where_the_mask_is() -> None:
    axis = np.array([0.0, 0.0, 1.0])
    picture = lines(100)
    mask = np.zeros((100, 100), bool)
    mask[20:80, 40:90] = True
    surface = on_tube(axis, 0.2, 3000)[0]
    quilt = Quilt(Manner(picture, mask), tube(axis, 0.2), surface, 1 / 300, 0, silent)
    column, row = quilt.centre.T.astype(int)
    assert mask[row, column].all()


# --- a scene's paint -------------------------------------------------------------------------------------------------


@given(st.integers(0, 2**31), st.floats(0.0, 1.0), st.floats(1e-4, 1.0))
def test_cells_of_paint_are_pixels_as_far_as_the_limits_go(seed: int, filled: float, pixel: float) -> None:
    occupied = (np.random.default_rng(seed).random((32, 32, 32)) < filled).astype(np.uint8)
    occupancy = Occupancy(Box((0.0,) * 3, 1.0, (1.0,) * 3), 32, occupied)
    cells = paint_cells(occupancy, pixel)
    assert cells % 32 == 0 and cells <= MOST_CELLS
    vertices = len(SparseLattice(occupied, 32, (cells,), 1).table)
    assert cells == 32 or (2 / cells > pixel and vertices <= 1.2 * MOST_VERTICES)


@pytest.fixture(scope="module")
def target() -> PieceStyle:
    return piece_style(lines(), None, PieceSettings(size=120))


def started(scene: Scene, targets: dict[int, PieceStyle], seed: int = 0, before=None):  # type: ignore[no-untyped-def]
    assert scene.palette_network is not None
    views = visible_from(scene, stylization_cameras(scene, SHORT.stylize), silent)
    colours = scene.palette_network.colours.detach().clone()
    for region, wanted in targets.items():
        colours[region] = wanted.mean
    pixel = paint_pixel(scene, SHORT.stylize)
    return views, painted_start(
        scene, Start(colours, targets, before=before), pixel, seed, silent, lambda field: None, Remarks()
    )


def seen(field, views, region: int) -> np.ndarray:  # type: ignore[no-untyped-def]
    """Colours of what is seen of a region in the first view."""
    own = views[0].region == region
    with torch.no_grad():
        return field(views[0].position[own]).numpy()


def test_what_has_a_style_is_painted_and_what_has_none_is_the_palette_s(balls: Scene, target: PieceStyle) -> None:
    views, field = started(balls, {0: target})
    flat = started(balls, {1: target})[1]
    deviation = target.picture.flatten(1).T.numpy().std(0).mean()
    assert seen(field, views, 0).std(0).mean() > 0.7 * deviation
    assert seen(flat, views, 0).std(0).mean() < 0.3 * deviation
    assert balls.palette_network is not None
    own = views[0].region == 1
    with torch.no_grad():
        intensity, weights, offsets = balls.palette_network.material(views[0].position[own])
        colours = intensity[:, None] * (weights[:, :, None] * (balls.palette_network.colours + offsets)).sum(1)
    assert np.abs(seen(field, views, 1) - colours.clamp(0, 1).numpy()).mean() < 0.05
    assert field.encoding.table.min() >= 0 and field.encoding.table.max() <= 1


def test_a_painting_that_goes_on_keeps_what_was_painted(balls: Scene, target: PieceStyle) -> None:
    views, first = started(balls, {0: target})
    painted = balls.painted(first.requires_grad_(False), {0: "lines"}, {})
    both = started(painted, {1: target}, before=first)[1]
    np.testing.assert_allclose(seen(both, views, 0), seen(first, views, 0), atol=0.02)
    assert seen(both, views, 1).std(0).mean() > 1.5 * seen(first, views, 1).std(0).mean()
