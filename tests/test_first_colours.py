"""What a field's colours are before its first step: those of the normals and of the transfer function."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from svv.core.colour.shading import Shading
from svv.core.geometry.box import Box
from svv.core.volumes.classified import ClassifiedVolume, ValueRange
from svv.fields.radiance.networks import BaseField, FieldSettings, encode_directions
from svv.fields.radiance.occupancy import Occupancy
from svv.train.base.first_colours import start_colours

CELLS = 16
UNIT = Box((0.0, 0.0, 0.0), 1.0, (1.0, 1.0, 1.0))
ORANGE = np.array([0.9, 0.5, 0.2])
AMBIENT = Shading(ambient=1.0, diffuse=0.001)


def ball_of(colour: np.ndarray) -> ClassifiedVolume:
    """The volume of that ball without its values: what is left tells one colour."""
    shape = (CELLS + 1,) * 3
    exponent, owner = np.zeros(shape, np.float16), np.zeros(shape, np.uint8)
    return ClassifiedVolume(UNIT, CELLS, exponent, owner, (ValueRange(0.0, 1.0, tuple(colour)),))


def ball(resolutions: tuple[int, ...] = (8, 16)) -> tuple[BaseField, Occupancy]:
    """A soft ball in the middle of the box."""
    torch.manual_seed(0)
    occupancy = Occupancy(UNIT, CELLS, np.ones((CELLS,) * 3, np.uint8))
    field = BaseField(FieldSettings(resolutions=resolutions), occupancy, (CELLS,))
    assert field.density is not None
    vertices = field.density.vertices_of_level(0, occupancy.occupied, CELLS) / CELLS
    radius = np.linalg.norm(vertices - 0.5, axis=1)
    with torch.no_grad():
        field.density.table[:, 0] = torch.from_numpy(4.0 - 20.0 * np.maximum(radius - 0.2, 0.0))
    field.encoding.randomize(0.01, torch.Generator().manual_seed(0))
    return field, occupancy


@torch.no_grad()
def colours(field: BaseField, place: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Colours of points (S, 3) seen along directions (S, 3)."""
    features = field.encoding(torch.from_numpy(place.astype(np.float32)))
    rays = torch.arange(len(place), dtype=torch.int32)
    return field(features, encode_directions(torch.from_numpy(direction.astype(np.float32)), rays)).numpy()


def random_directions(count: int, seed: int) -> np.ndarray:
    found = np.random.default_rng(seed).normal(size=(count, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


@pytest.mark.parametrize("shading", [Shading(), Shading(ambient=0.3, diffuse=0.5, specular=0.2, specular_power=8)])
def test_a_ball_is_shaded_by_its_exact_normals(shading: Shading) -> None:
    field, occupancy = ball()
    start_colours(field, occupancy, ball_of(ORANGE), shading)
    normal, along = random_directions(2000, 1), random_directions(2000, 2)
    shown = colours(field, 0.5 + 0.27 * normal, along)
    cosine = np.abs((normal * along).sum(1, keepdims=True))
    lit = ORANGE * (shading.ambient + shading.diffuse * cosine)
    expected = np.clip(lit + shading.specular * cosine**shading.specular_power, 0, 1)
    assert np.sqrt(np.square(shown - expected).mean()) < 0.06


def halves() -> ClassifiedVolume:
    """A volume of one extinction, whose range changes halfway along x."""
    owner = np.zeros((CELLS + 1,) * 3, np.uint8)
    owner[CELLS // 2 :] = 1
    ranges = ValueRange(0.0, 0.4, (0.9, 0.2, 0.1)), ValueRange(0.6, 1.0, (0.1, 0.3, 0.8))
    return ClassifiedVolume(UNIT, CELLS, np.full(owner.shape, 2.0, np.float16), owner, ranges)


def test_each_range_has_its_colour_from_all_sides() -> None:
    field, occupancy = ball()
    start_colours(field, occupancy, halves(), AMBIENT)
    place = np.random.default_rng(3).random((500, 3))
    place = place[np.abs(place[:, 0] - 0.5) > 0.2]
    expected = np.array([[0.9, 0.2, 0.1], [0.1, 0.3, 0.8]])[(place[:, 0] > 0.5).astype(int)]
    for seed in (4, 5):
        shown = colours(field, place, random_directions(len(place), seed))
        assert np.sqrt(np.square(shown - expected).mean()) < 0.06


def test_the_same_seed_starts_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("svv.train.base.first_colours.STEPS", 20)
    found = []
    for seed in (0, 0, 1):
        field, occupancy = ball()
        start_colours(field, occupancy, halves(), Shading(), seed)
        found.append(torch.cat([p.detach().flatten() for p in field.parameters()]))
    assert torch.equal(found[0], found[1])
    assert not torch.equal(found[0], found[2])


@pytest.mark.parametrize(
    ("resolutions", "shading"), [((16,), Shading()), ((8, 16), None), ((8, 16), Shading(on=False))]
)
def test_one_level_or_views_without_light_stay_as_they_are(
    resolutions: tuple[int, ...], shading: Shading | None
) -> None:
    field, occupancy = ball(resolutions)
    before = {name: value.clone() for name, value in field.state_dict().items()}
    start_colours(field, occupancy, halves(), shading)
    assert all(torch.equal(value, before[name]) for name, value in field.state_dict().items())
