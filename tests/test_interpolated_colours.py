"""Images whose colours are interpolated between vertices: as those of all samples, where that is what they show."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from svv.core.colour.colour import WHITE, over
from svv.core.geometry.cameras import Camera, look_at
from svv.core.geometry.cuts import Cut
from svv.errors import BadInput
from svv.fields.devices.kernel_checks import random_samples
from svv.fields.scene.images import MOVING_JOINED, render_pixels, while_moving
from svv.fields.scene.scene import Rendering, Scene
from svv.fields.scene.vertices import is_plain
from svv.io.views.viewset import ViewSet
from svv.kernels.numba import image, vertices
from svv.kernels.types import Surface
from svv.render.frames import orbit
from svv.train.base.sampling import with_vertices
from tests.cube import cube_camera, cube_paint, cube_scene, lit_cube_scene

SHAPE, SCALE = (5, 7, 6), 6.0


def positions(seed: int, count: int) -> torch.Tensor:
    """Places in the box of the grid, some on its vertices and at its end."""
    generator = torch.Generator().manual_seed(seed)
    end = (torch.tensor(SHAPE) - 1) / SCALE
    found = torch.rand(count, 3, generator=generator) * end
    snapped = torch.rand(count, generator=generator) < 0.2
    return torch.where(snapped[:, None], torch.round(found * SCALE) / SCALE, found)


@given(st.integers(0, 1 << 30), st.lists(st.integers(0, 40), min_size=1, max_size=3))
def test_vertices_are_those_of_the_cells_of_samples(seed: int, counts: list[int]) -> None:
    sets = [positions(seed + k, count) for k, count in enumerate(counts)]
    found = vertices.touched(sets, SHAPE, SCALE, np.inf)
    assert found is not None
    places, place = found
    cells = np.minimum((torch.cat(sets).numpy() * np.float32(SCALE)).astype(int), np.array(SHAPE) - 2)
    own = np.unique((cells[:, None] + np.indices((2, 2, 2)).reshape(3, 8).T).reshape(-1, 3), axis=0)
    np.testing.assert_allclose(place.numpy() * SCALE, own, atol=1e-5)
    np.testing.assert_array_equal(places.numpy(), np.ravel_multi_index(tuple(own.T), SHAPE))
    if len(cells):
        assert vertices.touched(sets, SHAPE, SCALE, 0.99 * len(own) / sum(counts)) is None


@given(st.integers(0, 1 << 30), st.lists(st.integers(0, 9), min_size=1, max_size=200), st.sampled_from([0.6, 1.0]))
def test_colours_that_vary_linearly_are_those_of_samples(seed: int, counts: list[int], opaque: float) -> None:
    """Colours of vertices are whole levels, so none is rounded."""
    samples = random_samples(counts, seed)
    samples = replace(samples, position=positions(seed, len(samples)), sigma=4.0 * samples.sigma)
    generator = torch.Generator().manual_seed(seed)
    levels = 2 * torch.randint(0, 60, (3, 3), generator=generator)  # a level of blue is two of the others
    slope, origins = levels * SCALE / vertices.LEVELS, torch.rand(len(counts), 3, generator=generator)
    opacity = torch.tensor([opaque])

    def images() -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        return torch.empty(len(counts), 4), torch.empty(len(counts)), torch.empty(len(counts), dtype=torch.int16)

    def surface(position: torch.Tensor) -> Surface:
        colour = 400 / vertices.LEVELS + position @ slope
        return Surface(colour, torch.zeros(len(position), dtype=torch.int64), colour)

    found = vertices.touched([samples.position], SHAPE, SCALE, np.inf)
    assert found is not None
    places, place = found
    at, drawn, exact = surface(place), images(), images()
    colours = at.colour, None if opaque == 1.0 else opacity.expand(len(place)), at.region
    vertices.composite([(samples, origins, drawn)], places, SHAPE, SCALE, colours, 1, 2.0)
    image.composite(samples, samples.sigma, surface(samples.position), opacity, origins, 2.0, exact)
    for one, other in zip(drawn, exact, strict=True):
        np.testing.assert_allclose(one.numpy(), other.numpy(), rtol=1e-4, atol=2e-6)


@given(st.integers(0, 1 << 30), st.integers(0, 200), st.integers(0, 2), st.integers(1, 40))
def test_what_networks_say_is_interpolated_trilinearly(seed: int, count: int, lights: int, numbers: int) -> None:
    """A product of three linear functions is its own trilinear interpolation."""
    place, generator = positions(seed, count), torch.Generator().manual_seed(seed)
    found = vertices.touched([place], SHAPE, SCALE, np.inf)
    assert found is not None
    slopes, shifts = torch.rand(2, 3, lights + numbers, generator=generator)

    def said(at: torch.Tensor) -> torch.Tensor:
        return (at[:, :, None] * slopes + shifts).prod(dim=1)

    given_, expected = (said(at).split([lights, numbers], dim=1) for at in (found[1], place))
    for own, exact in zip(vertices.interpolate(place, found[0], SHAPE, SCALE, *given_), expected, strict=True):
        np.testing.assert_allclose(own.numpy(), exact.numpy(), rtol=1e-4, atol=1e-5)


def drawn_at_vertex(colour: list[float]) -> np.ndarray:
    """The pixel of an opaque sample at a vertex of this colour, among black ones."""
    position = torch.tensor([[1.0 / SCALE] * 3])
    samples = replace(random_samples([1], 0), position=position, sigma=torch.tensor([1e4]), skipped=torch.zeros(1))
    found = vertices.touched([position], SHAPE, SCALE, np.inf)
    assert found is not None
    colours = torch.zeros(8, 3)
    colours[int((found[1] - position).norm(dim=1).argmin())] = torch.tensor(colour)
    drawn = torch.empty(1, 4), torch.empty(1), torch.empty(1, dtype=torch.int16)
    every = colours, torch.ones(8), torch.zeros(8, dtype=torch.int64)
    vertices.composite([(samples, torch.zeros(1, 3), drawn)], found[0], SHAPE, SCALE, every, 1, 1.0)
    return drawn[0][0, :3].numpy()


@given(st.lists(st.floats(0.0, 1.0, width=32), min_size=3, max_size=3))
def test_colours_of_vertices_are_rounded_to_a_quarter_of_a_level_of_a_screen(colour: list[float]) -> None:
    off = np.abs(drawn_at_vertex(colour) - colour)
    assert off[:2].max() <= 0.5 / 2046 + 1e-6 and off[2] <= 1.0 / 2046 + 1e-6


def test_colours_beyond_white_and_black_count_with_what_they_are_mixed_with() -> None:
    """A sample between a bright vertex and a black one is as bright as their mean; pixels end at white."""
    np.testing.assert_allclose(drawn_at_vertex([3.0, -0.5, 0.5]), [1.0, 0.0, 0.5], atol=2e-3)
    position = torch.tensor([[0.5 / SCALE] * 3])
    samples = replace(random_samples([1], 0), position=position, sigma=torch.tensor([1e4]), skipped=torch.zeros(1))
    found = vertices.touched([position], SHAPE, SCALE, np.inf)
    assert found is not None
    colours = torch.zeros(8, 3)
    colours[:2] = torch.tensor([2.0, -0.4, 9.0])  # a quarter of the weight; 9 counts as 4
    colours[2:4, 1] = 0.8
    drawn = torch.empty(1, 4), torch.empty(1), torch.empty(1, dtype=torch.int16)
    every = colours, torch.ones(8), torch.zeros(8, dtype=torch.int64)
    vertices.composite([(samples, torch.zeros(1, 3), drawn)], found[0], SHAPE, SCALE, every, 1, 1.0)
    np.testing.assert_allclose(drawn[0][0, :3].numpy(), [0.5, 0.1, 1.0], atol=2e-3)


def test_what_is_nearly_transparent_does_not_tint_its_neighbours() -> None:
    """Half the vertices are red and faint, the others blue: between them, it is as blue as they are."""
    position = torch.tensor([[0.5 / SCALE] * 3])
    samples = replace(random_samples([1], 0), position=position, sigma=torch.tensor([1e4]), skipped=torch.zeros(1))
    found = vertices.touched([position], SHAPE, SCALE, np.inf)
    assert found is not None
    red = torch.arange(8) < 4
    colour = torch.where(red[:, None], torch.tensor([1.0, 0.0, 0.0]), torch.tensor([0.0, 0.0, 1.0]))
    drawn = torch.empty(1, 4), torch.empty(1), torch.empty(1, dtype=torch.int16)
    opacity = torch.where(red, 1e-3, 1.0)
    colours = colour, opacity, (~red).long()
    vertices.composite([(samples, torch.zeros(1, 3), drawn)], found[0], SHAPE, SCALE, colours, 2, 1.0)
    np.testing.assert_allclose(drawn[0][0].numpy(), [1e-3 / 1.001, 0.0, 1.0 / 1.001, 1.0], atol=1e-5)


def smooth_cube(vertices_a_cell: int = 0) -> Scene:
    """The cube with colours that vary little within a cell, and one direction of light for all or each."""
    scene = cube_scene()
    assert scene.palette_network is not None
    with torch.no_grad():
        scene.palette_network.encoding.table.mul_(0.1)
    return replace(scene, vertices_a_cell=vertices_a_cell)


def on_white(image: Rendering) -> np.ndarray:
    return over(image.rgba, WHITE)


@pytest.mark.parametrize("headlight", ["axis", "point"])
def test_more_vertices_come_nearer_to_the_image_of_all_samples(headlight: str) -> None:
    scene = smooth_cube()
    scene = replace(scene, settings=replace(scene.settings, headlight=headlight)).edited(1, opacity=0.3)
    camera = orbit(scene, 9, 200, 200)[2]
    exact, errors = scene.render(camera), []
    for count in (1, 2, 4):
        found = replace(scene, vertices_a_cell=count).render(camera)
        errors.append(float(np.sqrt(np.square(on_white(found) - on_white(exact)).mean())))
    assert 0.0 < errors[2] < errors[1] < errors[0] < 0.03
    assert errors[2] < 0.4 * errors[0]


def test_extinction_and_depth_stay_those_of_samples_without_edits_of_opacity() -> None:
    camera = cube_camera(200)
    exact, found = (smooth_cube(count).render(camera) for count in (0, 2))
    np.testing.assert_allclose(found.rgba[..., 3], exact.rgba[..., 3], atol=1e-5)
    np.testing.assert_allclose(found.depth, exact.depth, rtol=1e-5)
    assert (found.region != exact.region).mean() < 0.12  # a random one in every cell


def painted(scene: Scene) -> Scene:
    regions = (replace(scene.regions[0], style="noise", strength=0.7), *scene.regions[1:])
    return replace(scene, styled=cube_paint(scene, 3), regions=regions)


SHARP: dict[str, Callable[[Scene], Scene]] = {
    "paint": painted,
    "a region cut open": lambda scene: scene.cut("0=x>50%"),
    "a hidden region": lambda scene: scene.hidden(0),
    "a face of a section": lambda scene: scene.cut("x>50%").with_section("flat"),
    "a MatCap": lambda scene: scene.edited(0, matcap="clay"),
    "a shadow": lambda scene: replace(scene, lamp=replace(scene.lamp, shadow=0.5)),
    "an explicit light": lambda _: replace(lit_cube_scene(), vertices_a_cell=2),
}


@pytest.mark.parametrize("what", SHARP)
def test_edges_in_space_stay_as_sharp_as_samples_are(what: str) -> None:
    """Only what networks say is interpolated: errors are those of smooth colours, wherever regions begin."""
    plain, scene = smooth_cube(2), SHARP[what](smooth_cube(2))
    camera, network = cube_camera(200), scene.networks[-1]
    assert is_plain(plain, "pcn") and not is_plain(scene, network)
    exact, found = (
        one.render(camera) for one in (replace(scene, vertices_a_cell=0, still=False), replace(scene, still=False))
    )
    error = np.abs(on_white(found) - on_white(exact))
    assert 0.0 < error.mean() < 0.004 and (error > 0.1).mean() < 0.01


@pytest.mark.parametrize("what", ["plain", *SHARP])
def test_small_pictures_have_what_networks_say_of_every_sample(what: str) -> None:
    scene = SHARP.get(what, lambda scene: scene)(smooth_cube(2))
    camera = cube_camera(24)
    exact, found = replace(scene, vertices_a_cell=0).render(camera), scene.render(camera)
    np.testing.assert_array_equal(found.rgba, exact.rgba)


def test_a_kept_view_does_not_stay_plain_when_an_edit_has_edges() -> None:
    scene, camera = frozen(smooth_cube(1)), cube_camera(200)
    for _ in range(3):
        scene.render(camera)
    clay = scene.edited(0, matcap="clay")
    np.testing.assert_array_equal(clay.render(camera).rgba, anew(clay).render(camera).rgba)


def test_a_still_image_is_not_that_of_a_moving_scene() -> None:
    """While it moves, vertices pay that do not in a still image; everything else of both may be equal."""
    scene, camera = replace(frozen(smooth_cube(1)), joined=MOVING_JOINED), cube_camera(200)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("svv.fields.scene.vertices.PAYS", dict.fromkeys((True, False), 0.0))
        patch.setattr("svv.fields.scene.vertices.PAYS_MOVING", np.inf)
        first, moving = scene.render(camera), while_moving(scene).render(camera)
        assert (first.rgba != moving.rgba).any()
        for _ in range(3):
            while_moving(scene).render(camera)
        np.testing.assert_array_equal(scene.render(camera).rgba, first.rgba)


@pytest.mark.parametrize("away", [0.0, 0.3, 0.5])
def test_light_from_a_camera_in_the_scene_is_that_of_every_sample(away: float) -> None:
    """Beside a light at the camera, its direction turns within a cell, and behind the camera it is opposite."""
    scene = smooth_cube(1)
    scene = replace(scene, settings=replace(scene.settings, headlight="point"))
    middle, size = scene.occupancy.box.bounds.mean(axis=0), scene.occupancy.box.size
    eye = middle + away * size * np.array([1.0, 0.1, 0.2])
    camera = Camera(look_at(eye, middle + size * np.array([0.1, 1.0, 0.3]), (0.0, 0.0, 1.0)), 1.5, 200, 200)
    exact = replace(scene, vertices_a_cell=0).render(camera)
    assert np.isfinite(exact.depth).any()
    np.testing.assert_array_equal(scene.render(camera).rgba, exact.rgba)


def frozen(scene: Scene) -> Scene:
    """The scene, whose views may be kept."""
    for network in (scene.base, scene.palette_network):
        assert network is not None
        network.requires_grad_(False)
    return scene


def anew(scene: Scene) -> Scene:
    """The same scene, of which no view is known."""
    return replace(scene, occupancy=replace(scene.occupancy))


def test_a_view_that_is_kept_shows_edits_as_a_new_one() -> None:
    scene, camera = frozen(smooth_cube(1)), cube_camera(200)
    for number in range(4):
        edited = scene.edited(0, lighting=0.5 + 0.1 * number, colour=(0.1 * number, 0.5, 0.3), opacity=0.5)
        np.testing.assert_array_equal(edited.render(camera).rgba, anew(edited).render(camera).rgba)


def test_a_cut_of_everything_is_drawn_from_vertices_too() -> None:
    camera = cube_camera(200)
    exact, found = (
        replace(smooth_cube(count), cuts=(Cut.parse("x>50%", ((-0.5,) * 3, (0.5,) * 3)),)).render(camera)
        for count in (0, 2)
    )
    np.testing.assert_allclose(found.rgba[..., 3], exact.rgba[..., 3], atol=1e-5)
    assert 0.0 < np.abs(on_white(found) - on_white(exact)).mean() < 0.01


def test_pixels_are_those_of_the_image() -> None:
    scene, camera = smooth_cube(), cube_camera(60)
    pixels = torch.arange(7, 3600, 13)
    whole = scene.render(camera).rgba.reshape(-1, 4)
    np.testing.assert_allclose(render_pixels(scene, camera, pixels, "pcn"), whole[pixels.numpy()], atol=1e-3)


def test_a_scene_file_holds_it_and_refuses_impossible_numbers() -> None:
    scene = smooth_cube(2)
    assert Scene.from_bytes(scene.to_bytes()).vertices_a_cell == 2
    for wrong in (-1, 5):
        with pytest.raises(BadInput):
            Scene.from_bytes(replace(scene, vertices_a_cell=wrong).to_bytes())


def views_of(scene: Scene) -> ViewSet:
    cameras: list[Camera] = list(orbit(scene, 4, 120, 120))
    pictures = np.stack([(255.0 * scene.render(camera).rgba + 0.5).astype(np.uint8) for camera in cameras])
    return ViewSet(cameras, pictures, [str(k) for k in range(4)])


def test_vertices_are_chosen_where_views_stay_as_likely() -> None:
    """Views of interpolated colours need no others; those of colours that vary within cells need all."""
    smooth, rough = smooth_cube(1), cube_scene()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("svv.fields.scene.vertices.PAYS", dict.fromkeys((True, False), np.inf))
        assert with_vertices(replace(smooth, vertices_a_cell=0), views_of(smooth)).vertices_a_cell == 1
    assert with_vertices(rough, views_of(rough)).vertices_a_cell == 0


def test_grids_that_are_too_large_are_not_chosen() -> None:
    smooth = smooth_cube(1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("svv.fields.scene.vertices.MOST_PLACES", 1)
        assert with_vertices(replace(smooth, vertices_a_cell=0), views_of(smooth)).vertices_a_cell == 0
