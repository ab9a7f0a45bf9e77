"""The image kernels, each compared with `svv.core` in plain torch."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from svv.core.colour import palette_shading
from svv.core.colour.colour import hsb_change, shift_colours
from svv.core.colour.light import blinn_phong, normals_of
from svv.core.rays.compositing import LEAST_ALPHA, composite_samples
from svv.core.rays.encodings import lattice_features, spherical_harmonics
from svv.core.rays.networks import relu_layers
from svv.core.rounding import KERNELS, NETWORKS
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.scene.stroke_opacity import paleness
from svv.kernels.numba import kernels as numba_kernels
from svv.kernels.types import ImageKernels, Lattice, Samples, Surface
from tests.interpreted import GPU, triton_kernels

pytestmark = pytest.mark.usefixtures("all_threads")

SEEDS = st.integers(0, 10**6)
CPU = torch.device("cpu")
VERTICES = 5
"""Of a lattice of one level, along an axis."""


DEVICES = {"numba": CPU, "triton": torch.device("cuda") if GPU else CPU}


class There:
    """Image kernels of a device, called with tensors on the CPU."""

    def __init__(self, kernels: ImageKernels, device: torch.device) -> None:
        self.kernels, self.device = kernels, device

    def __getattr__(self, name: str) -> Any:
        def call(*arguments: Any) -> Any:
            moved: dict[int, Any] = {}
            done = getattr(self.kernels, name)(*(self._to(a, self.device, moved) for a in arguments))
            for before, after in list(moved.values()):
                before.copy_(after)  # what was changed in place
            return self._to(done, CPU, {})

        return call

    def _to(self, value: Any, device: torch.device, moved: dict[int, Any]) -> Any:
        if isinstance(value, Tensor):
            return value if value.device == device else moved.setdefault(id(value), (value, value.to(device)))[1]
        if isinstance(value, tuple):
            return tuple(self._to(v, device, moved) for v in value)
        if isinstance(value, Samples | Lattice | Surface):
            return type(value)(**{n: self._to(v, device, moved) for n, v in vars(value).items()})
        return value


@pytest.fixture(scope="module", params=DEVICES)
def kernels(request: pytest.FixtureRequest) -> Any:
    own: Any = {"numba": numba_kernels, "triton": triton_kernels}[request.param]
    return There(own.IMAGE, DEVICES[request.param])


def generator(seed: int) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def one_level() -> Lattice:
    """All vertices of a box of 4 x 4 x 4 cells."""
    cells = VERTICES - 1
    return SparseLattice(np.ones((cells,) * 3, np.uint8), cells, (cells,), 1).layout


def some_samples(seed: int, counts: list[int]) -> Samples:
    """Samples of rays within the unit box, in no order along their rays: these kernels do not ask for one."""
    random, count = generator(seed), torch.tensor(counts)
    total = int(count.sum())
    ray = torch.repeat_interleave(torch.arange(len(count)), count).int()
    position, sigma, skipped = (torch.rand(shape, generator=random) for shape in ((total, 3), total, total))
    tail = 0.3 * torch.rand(len(count), generator=random)
    return Samples(position, 30.0 * sigma, 0.2 * skipped, ray, count.cumsum(0) - count, count, tail, 0.05)


def unit(shape: tuple[int, int], random: torch.Generator) -> Tensor:
    return torch.nn.functional.normalize(torch.randn(shape, generator=random), dim=1)


def lights_of(regions: int, random: torch.Generator) -> Tensor:
    """f, a and b as edits and paint set them: factors up to 2, which may turn a dark shade below 0. (P, 3)"""
    return torch.rand(regions, 3, generator=random) * torch.tensor([2.0, 2.0, 0.3])


def close(got: Tensor, expected: Tensor) -> None:
    torch.testing.assert_close(got, expected, atol=KERNELS["value"], rtol=KERNELS["value"])


@given(SEEDS, st.lists(st.integers(0, 4), min_size=1, max_size=9))
def test_depth_behind_the_last_sample_becomes_a_part_of_it(kernels: ImageKernels, seed: int, counts: list[int]) -> None:
    samples = some_samples(seed, counts)
    before, behind = samples.sigma.clone(), samples.tail.clone()
    kernels.end(samples)
    last = [sum(counts[: r + 1]) - 1 for r, count in enumerate(counts) if count]
    expected, there = before.clone(), samples.count > 0
    expected[last] += behind[there] / samples.step
    close(samples.sigma, expected)
    close(samples.tail, torch.where(there, 0.0, behind))


@given(SEEDS, st.integers(1, 4))
def test_features_are_those_of_both_tables_and_of_the_rays(seed: int, each: int) -> None:
    kernels: Any = There(triton_kernels.IMAGE, DEVICES["triton"])
    random, samples, lattice = generator(seed), some_samples(seed, [3, 0, 5]), one_level()
    tables, along = (torch.randn(shape, generator=random) for shape in ((VERTICES**3, 2 * each), (3, 3)))
    along = torch.nn.functional.normalize(along, dim=1)
    lit, plain = kernels.features(samples, along, lattice, tables)
    layout = lattice.shapes, lattice.scales, lattice.bases, lattice.index
    both = lattice_features(samples.position, *layout, tables)
    close(lit, torch.cat([both[:, :each], spherical_harmonics(along, 4)[samples.ray.long()]], dim=1))
    close(plain, both[:, each:])


@settings(max_examples=30)
@given(SEEDS, st.sampled_from([3, 4]), st.integers(1, 40), st.integers(1, 3), st.booleans())
def test_looks_are_what_both_networks_say_of_features_and_directions(
    kernels: ImageKernels, seed: int, each: int, width: int, colours: int, same: bool
) -> None:
    """Odd widths, blocks that are not full, one direction for all rays and one for each."""
    random, samples, lattice = generator(seed), some_samples(seed, [3, 0, 67]), one_level()
    tables = torch.randn(VERTICES**3, 2 * each, generator=random)
    along = unit((1, 3), random).repeat(3, 1) if same else unit((3, 3), random)
    lighting = [torch.randn(a, b, generator=random) for a, b in ((width, each + 16), (width, width), (2, width))]
    palette = [torch.randn(a, b, generator=random) for a, b in ((width, each), (1 + 4 * colours, width))]
    light, raw = kernels.looks(samples, along, lattice, tables, lighting, palette)
    layout = lattice.shapes, lattice.scales, lattice.bases, lattice.index
    both = lattice_features(samples.position, *layout, tables)
    lit = torch.cat([both[:, :each], spherical_harmonics(along, 4)[samples.ray.long()]], dim=1)
    digits = NETWORKS[torch.float32 if kernels.kernels is numba_kernels.IMAGE else torch.float16]  # type: ignore[attr-defined]
    for got, right in ((light, relu_layers(lit, lighting)), (raw, relu_layers(both[:, each:].contiguous(), palette))):
        assert got.shape == right.shape
        assert float((got - right).norm()) <= digits * float(right.norm())


@given(SEEDS, st.integers(1, 6))
def test_material_is_equation_4_without_light(kernels: ImageKernels, seed: int, colours: int) -> None:
    random = generator(seed)
    raw, palette = 2.0 * torch.randn(9, 1 + 4 * colours, generator=random), torch.rand(colours, 3, generator=random)
    surface = kernels.material(raw, palette)
    intensity, weights, offsets = palette_shading.material(raw)
    close(surface.colour, palette_shading.diffuse(intensity, weights, palette + offsets))
    assert torch.equal(surface.raw, raw)
    assert surface.region.tolist() == weights.argmax(dim=1).tolist()


def surface_of(raw: Tensor, random: torch.Generator) -> Surface:
    return Surface(raw, palette_shading.material(raw)[1].argmax(dim=1), torch.rand(len(raw), 3, generator=random))


@given(SEEDS, st.floats(-1.0, 1.0))
def test_paint_replaces_its_share_of_colours_and_extinction_follows_it(
    kernels: ImageKernels, seed: int, amount: float
) -> None:
    random = generator(seed)
    surface = surface_of(torch.randn(9, 13, generator=random), random)
    paint, share, sigma = 1.4 * torch.rand(9, 3, generator=random) - 0.2, torch.tensor([0.0, 0.4, 1.0]), torch.rand(9)
    strokes = torch.rand(3, 4, generator=random) * torch.tensor([0.5, 9.0 * amount, 1.0, 1.6 * abs(amount)])
    strokes[1] = 0.0
    blended = torch.lerp(surface.colour, paint, share[surface.region][:, None])
    gain, slope, mean, reach = strokes[surface.region].unbind(1)
    change = (slope * (mean - paleness(paint, slope))).clamp(-reach, reach)
    followed = kernels.overpaint(surface, paint, share, strokes, sigma)
    close(surface.colour, blended)
    close(followed, sigma * torch.where(reach > 0.0, (gain + change).exp(), 1.0))


@given(SEEDS, st.sampled_from([1, 2]))
def test_light_is_that_of_the_lighting_network(kernels: ImageKernels, seed: int, outputs: int) -> None:
    random = generator(seed)
    surface, lights = surface_of(torch.randn(9, 13, generator=random), random), lights_of(3, random)
    raw = 3.0 * torch.randn(9, outputs, generator=random)
    expected = palette_shading.lit(
        surface.colour, *palette_shading.network_light(raw), *lights[surface.region].unbind(1)
    )
    kernels.light(surface, raw, lights)
    close(surface.colour, expected)


@given(SEEDS, st.floats(0.0, 2.0), st.booleans())
def test_phong_is_that_of_an_explicit_light(
    kernels: ImageKernels, seed: int, intensity: float, headlight: bool
) -> None:
    random, samples = generator(seed), some_samples(seed, [4, 7])
    surface, lights = surface_of(torch.randn(11, 13, generator=random), random), lights_of(3, random)
    coefficients = torch.rand(3, 4, generator=random) * torch.tensor([1.0, 1.0, 1.0, 20.0])
    facing, toward = unit((2, 3), random), unit((2, 3), random)
    toward = facing if headlight else toward
    lattice, table = one_level(), 0.1 * torch.randn(VERTICES**3, 3, generator=random)
    layout = lattice.shapes, lattice.scales, lattice.bases, lattice.index
    normal, ray = normals_of(lattice_features(samples.position, *layout, table)), samples.ray.long()
    mixed = palette_shading.material(surface.raw)[1] @ coefficients
    specular, shade = blinn_phong(normal, facing[ray], toward[ray], intensity, mixed)
    expected = palette_shading.lit(surface.colour, specular, shade, *lights[surface.region].unbind(1))
    kernels.phong(surface, samples, (facing, toward, intensity), lattice, table, coefficients, lights)
    # A cosine's error grows by the exponent of the highlight, 20 at most.
    torch.testing.assert_close(surface.colour, expected, atol=20 * KERNELS["value"], rtol=KERNELS["value"])


@given(SEEDS, st.lists(st.integers(0, 12), min_size=1, max_size=12))
def test_pixels_are_composited_as_torch_does(kernels: ImageKernels, seed: int, counts: list[int]) -> None:
    random, samples, rays = generator(seed), some_samples(seed, counts), len(counts)
    region = torch.randint(0, 3, (len(samples),), generator=random)
    surface = Surface(torch.empty(0), region, torch.rand(len(samples), 3, generator=random))
    opacity, origins, size = torch.rand(3, generator=random), torch.rand(rays, 3, generator=random) - 2.0, 7.0
    images = torch.full((rays, 4), -1.0), torch.full((rays,), -1.0), torch.full((rays,), -1, dtype=torch.int16)
    kernels.composite(samples, samples.sigma, surface, opacity, origins, size, images)

    distance = (samples.position - origins[samples.ray.long()]).norm(dim=1, keepdim=True)
    values = torch.cat([surface.colour, distance, torch.nn.functional.one_hot(region, 3).float()], dim=1)
    out, transmittance, _ = composite_samples(
        samples.sigma * opacity[region], values, samples.skipped, samples.start, samples.count, samples.tail,
        samples.step,
    )  # fmt: skip
    alpha = 1.0 - transmittance
    seen = (alpha > LEAST_ALPHA + KERNELS["value"]) & (samples.count > 0)
    unseen = alpha < LEAST_ALPHA - KERNELS["value"]
    mean = out[seen] / alpha[seen, None]
    # A mean is a sum divided by alpha, and its error grows as that falls: so the sums are compared.
    close(images[0][seen, :3] * alpha[seen, None], mean[:, :3].clamp(0.0, 1.0) * alpha[seen, None])
    close(images[0][seen, 3], alpha[seen])
    close(images[1][seen] / size * alpha[seen], out[seen, 3])
    assert (images[0][unseen] == -1.0).all() and (images[1][unseen] == -1.0).all()
    assert (images[2][unseen] == -1).all()
    share = mean[:, 4:].gather(1, images[2][seen].long()[:, None])[:, 0]
    close(share, mean[:, 4:].amax(dim=1))  # of shares that are equal to the last bit either may win


@given(SEEDS, st.integers(1, 4), st.sampled_from(["some", "all"]), st.sampled_from(["", "was grey", "is grey", "same"]))
def test_edited_colours_change_as_in_plain_torch(
    kernels: ImageKernels, seed: int, palette: int, which: str, special: str
) -> None:
    random = generator(seed)
    raw, colours = 0.4 * torch.randn(37, 1 + 4 * palette, generator=random), torch.rand(palette, 3, generator=random)
    before, after = torch.rand(2, 3, generator=random)
    before = before.mean().expand(3).clone() if special == "was grey" else before
    after = {"is grey": after.mean().expand(3).clone(), "same": before.clone()}.get(special, after)
    among = torch.rand(37, generator=random) < 0.5 if which == "some" else None
    root = seed % palette
    column = 1 + palette + 3 * root
    offsets = raw[:, column : column + 3]
    shifted = shift_colours((colours[root] + offsets)[:, None], before[None], after[None])[:, 0] - colours[root]
    expected = raw.clone()
    expected[:, column : column + 3] = shifted if among is None else torch.where(among[:, None], shifted, offsets)
    kernels.shift(raw, column, colours[root], hsb_change(before, after), among)
    torch.testing.assert_close(raw, expected, atol=2e-5, rtol=1e-4)
