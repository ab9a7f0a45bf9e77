"""Checks of a set of kernels against plain torch, in value and gradient: whether a GPU computes what it should.

Each check makes its inputs from a seed, runs both, and raises AssertionError if they differ by more than rounding can
make of it (:mod:`svv.core.rounding`). Tests call them with a few samples in Triton's interpreter, ``svv bench gpu`` and
the check on a GPU's first use with enough to fill a GPU. Letters: S samples, R rays, F features.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.core.geometry.box import Box
from svv.core.rays.encodings import hash_corners, lattice_corners
from svv.core.rays.networks import relu_layers
from svv.core.rounding import KERNELS, NETWORKS, sums_apart
from svv.fields.radiance.encodings import Encoding, HashGrid, SparseLattice
from svv.fields.radiance.occupancy import Occupancy
from svv.kernels import reference
from svv.kernels.types import UNSURE, Context, Kernels, Left, Limits, Samples

CPU = torch.device("cpu")
EXTENT = 1.0, 0.75, 1.0
"""Sides of the box in which rays are marched; a quarter of it is cut off."""

MARCHES = {
    "training": (Limits(1 / 8, 1e-3, 0.1, 3.0, 1.0, False), 7),
    "image": (Limits(1 / 8, 0.05, 0.0, 7.0, 1.0, True), 0),
    "image of fainter regions": (Limits(1 / 8, 0.05, 0.0, 3.0, 0.4, True), 0),
    "image of hidden regions": (Limits(1 / 8, 0.05, 0.0, 3.0, 0.0, True), 0),
    "everything": (Limits(1 / 8, -1.0, 0.0, 0.0, 0.0, False), 3),
}
"""Limits and seed of the kinds of marches."""

NETWORK_SHAPES = (
    (32, 64, 2, 3),
    (31, 64, 2, 3),
    (36, 32, 2, 2),
    (20, 64, 1, 9),
    (32, 64, 1, 16),
    (8, 16, 1, 1),
    (5, 24, 2, 60),
)
"""Inputs, width, hidden layers and outputs of colour, lighting, palette and density networks, and of odd ones."""


PRODUCTS = 4
"""Roundings of a term of such a sum: three products of weights, and one by the number that they weigh."""


def random_lattice(
    seed: int, features: int, resolutions: Sequence[int] = (4, 8), cells: int = 4
) -> tuple[SparseLattice, NDArray[np.uint8]]:
    """Return a lattice of random features on random cells, and the cells."""
    rng = np.random.default_rng(seed)
    occupied = (rng.random((cells, 3 * cells // 4, cells)) < 0.4).astype(np.uint8)
    occupied[1, 1, 1] = 1
    lattice = SparseLattice(occupied, cells, resolutions, features)
    lattice.randomize(1.0, torch.Generator().manual_seed(seed))
    return lattice, occupied


FINEST = 1 << 12
"""Box coordinates of look-ups are multiples of its inverse, so their places among at most as many cells are exact."""


def points_in(occupied: NDArray[np.uint8], count: int, seed: int) -> Tensor:
    """Return random box coordinates in occupied cells, multiples of 1 / :data:`FINEST`. (S, 3)"""
    rng, where = np.random.default_rng(seed), np.argwhere(occupied)
    points = (where[rng.integers(0, len(where), count)] + rng.random((count, 3))) / len(occupied)
    return torch.from_numpy((np.floor(points * FINEST) / FINEST).astype(np.float32))


def rays_through(count: int, seed: int) -> tuple[Tensor, Tensor]:
    """Return rays from all around, some beside the box, the last three along the axes. (R, 3) each"""
    rng = np.random.default_rng(seed)
    origins = rng.uniform(-1.0, 2.0, (count, 3))
    directions = rng.uniform(0.0, 1.0, (count, 3)) - origins
    directions[-3:] = np.eye(3) * [[1.0], [-1.0], [1.0]]
    origins[-3:] = [(-1.0, 0.4, 0.6), (0.3, 2.0, 0.2), (0.2, 0.7, -1.0)]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return torch.from_numpy(origins.astype(np.float32)), torch.from_numpy(directions.astype(np.float32))


def check_lattice(kernels: Kernels, device: torch.device, seed: int, features: int, count: int, cells: int = 4) -> None:
    """Compare look-ups of a sparse lattice, the gradient of its table, and the marks of the rows used."""
    lattice, occupied = random_lattice(seed, features, (cells, 2 * cells), cells)
    _check_table(kernels, device, lattice, points_in(occupied, count, seed), seed)


def check_hash_grid(
    kernels: Kernels, device: torch.device, seed: int, features: int, count: int, log2_entries: int = 8
) -> None:
    """Compare those of a hash grid, whose coarse level is stored whole and whose fine one is hashed."""
    coarsest = max(4, round(2 ** (log2_entries / 3)) - 2)
    grid = HashGrid(levels=2, features=features, log2_entries=log2_entries, coarsest=coarsest, finest=100)
    grid.randomize(1.0, torch.Generator().manual_seed(seed))
    x = (FINEST * torch.rand(count, 3, generator=torch.Generator().manual_seed(seed))).floor() / FINEST
    x[0] = torch.tensor([0.0, 1.0, 1.0])
    _check_table(kernels, device, grid, x, seed)


def _check_table(kernels: Kernels, device: torch.device, encoding: Encoding, x: Tensor, seed: int) -> None:
    """Each result is a sum of products of exact weights: it may differ by as much as its order of summation makes."""
    upstream = torch.randn(len(x), encoding.width, generator=torch.Generator().manual_seed(seed))
    expected, right, marks = _looked_up(reference, CPU, encoding, x, upstream)
    _, magnitude, _ = _looked_up(reference, CPU, encoding, x, upstream.abs())
    out, gradient, used = _looked_up(kernels, device, encoding, x, upstream)
    bound = sums_apart(8 + PRODUCTS) * float(encoding.table.detach().abs().max())
    torch.testing.assert_close(out, expected, atol=bound, rtol=0.0)
    apart, allowed = (gradient - right).abs(), sums_apart(_most_terms(encoding, x) + PRODUCTS) * magnitude
    assert bool((apart <= allowed).all()), (
        f"gradients differ by {float((apart / allowed).nan_to_num().max())} x rounding"
    )
    assert torch.equal(used, marks), "other rows are marked as used"


def _looked_up(
    kernels: Kernels, device: torch.device, encoding: Encoding, x: Tensor, g: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Return features (S, width), the table's gradient for ``g`` (S, width), and the marks of its rows, on the CPU."""
    encoding.to(device)
    x, g = x.to(device), g.to(device)
    gradient = torch.zeros_like(encoding.table, requires_grad=False)
    used = torch.zeros(len(gradient), dtype=torch.uint8, device=device)
    if isinstance(encoding, HashGrid):
        out = kernels.hash_encode(x, encoding.resolutions, encoding.offsets, encoding.table)
        kernels.hash_backward(x, g, encoding.resolutions, encoding.offsets, gradient, used)
    else:
        assert isinstance(encoding, SparseLattice)
        out = kernels.lattice_encode(x, encoding.layout, encoding.table)
        kernels.lattice_backward(x, g, encoding.layout, gradient, used)
    encoding.to(CPU)
    return out.cpu(), gradient.cpu(), used.cpu()


def _most_terms(encoding: Encoding, x: Tensor) -> int:
    """Return how many corners of samples' cells share one row at most."""
    if isinstance(encoding, HashGrid):
        ends = encoding.offsets.tolist()
        levels = zip(encoding.resolutions.tolist(), ends, ends[1:])
        rows = [hash_corners(x, resolution, first, end - first)[0] for resolution, first, end in levels]
    else:
        assert isinstance(encoding, SparseLattice)
        where = encoding.layout
        each = zip(where.shapes, where.scales, where.bases[:-1], strict=True)
        rows = [lattice_corners(x, *level, where.index)[0].clamp(max=len(encoding.table) - 1) for level in each]
    return max(int(torch.bincount(level.flatten()).max()) for level in rows)


def check_adam(kernels: Kernels, device: torch.device, seed: int, features: int, rows: int, pull: float = 0.5) -> None:
    """Compare three steps; rows join and leave from step to step, and what is not marked stays as it is."""
    ends = []
    for own, where in ((reference, CPU), (kernels, device)):
        generator = torch.Generator().manual_seed(seed)
        table = torch.randn(rows, features, generator=generator).to(where)
        moments = torch.zeros(2, rows, features, device=where)
        age = torch.zeros(rows, dtype=torch.int32, device=where)
        for _ in range(3):
            gradient = torch.randn(rows, features, generator=generator).to(where)
            used = (torch.rand(rows, generator=generator) < 0.6).to(torch.uint8).to(where)
            unmarked = torch.where(used[:, None] > 0, 0.0, gradient)
            own.adam(table, gradient, used, moments, age, 0.01, (0.9, 0.99, 1e-12), pull, rows // 2)
            assert not used.any(), "marks are left"
            assert torch.equal(gradient, unmarked), "gradients of other rows have changed"
        ends.append((table.cpu(), moments.cpu(), age.cpu()))
    for theirs, mine in zip(*ends, strict=True):
        torch.testing.assert_close(mine, theirs, atol=KERNELS["value"], rtol=1e-5)


def march_rays(
    kernels: Kernels, device: torch.device, how: Limits, jitter: int, seed: int, count: int, pieces: int | None = None
) -> Samples:  # fmt: skip
    """March random rays, or this many random pieces of each, through a random lattice of extinctions."""
    lattice, occupied = random_lattice(seed, 1)
    with torch.no_grad():
        lattice.table.mul_(2.0)
    lattice.to(device)
    occupancy = Occupancy(Box((0.0, 0.0, 0.0), 1.0, EXTENT), 4, occupied)
    origins, directions = (a.to(device) for a in rays_through(count, seed))
    return kernels.march(
        origins, directions, occupancy.distance_on(device), 4, EXTENT, lattice.layout, lattice.table, 9.0, how, jitter,
        16, 0, None if pieces is None else random_pieces(count, pieces, occupancy, seed, device),
    )[0]  # fmt: skip


def random_pieces(rays: int, pieces: int, occupancy: Occupancy, seed: int, device: torch.device) -> Left:
    """Return random pieces of rays, some of which are none; whether random cells are shown is unsure."""
    generator = torch.Generator().manual_seed(seed)
    edges = (2.5 * torch.rand(rays, 2 * pieces, generator=generator)).sort(dim=1).values
    edges[::3, :1], edges[::2, -1:] = 0.0, torch.inf
    begin, end = edges.view(rays, pieces, 2).unbind(2)
    touching = torch.cat([begin[:, 1:], end[:, -1:]], 1)
    end = torch.where(torch.rand(rays, pieces, generator=generator) < 0.5, end, touching)
    end = torch.where(torch.rand(rays, pieces, generator=generator) < 0.1, begin, end)
    distance = occupancy.distance_on(CPU).clamp(max=UNSURE - 1)
    distance[:, (distance[0] == 0) & (torch.rand(distance[0].shape, generator=generator) < 0.4)] = UNSURE
    return Left(begin.contiguous().to(device), end.contiguous().to(device), distance.to(device))


def check_march(
    kernels: Kernels, device: torch.device, seed: int, how: Limits, jitter: int, count: int = 40,
    against: Kernels = reference, pieces: int | None = None,
) -> None:  # fmt: skip
    """Compare samples; one that rounding puts into the neighbouring cell may be kept or not, but such rays are few.

    One ray may have another number of samples, or one in a hundred of many.
    """
    expected, got = (
        march_rays(against, CPU, how, jitter, seed, count, pieces),
        march_rays(kernels, device, how, jitter, seed, count, pieces),
    )
    assert len(expected) > count // 2, "too few samples to compare"
    got = got.to(CPU)
    same = got.count == expected.count
    assert int((~same).sum()) <= max(1, count // 100), f"{int((~same).sum())} of {count} rays have other samples"
    assert torch.equal(got.start, got.count.cumsum(0) - got.count), "rays do not follow each other"
    mine, theirs = (same[s.ray.long()] for s in (got, expected))
    for name, atol, rtol in (("position", 1e-6, 0.0), ("sigma", 0.0, KERNELS["sigma"]), ("skipped", 1e-5, 1e-5)):
        torch.testing.assert_close(getattr(got, name)[mine], getattr(expected, name)[theirs], atol=atol, rtol=rtol)
    assert torch.equal(got.ray[mine], expected.ray[theirs]), "samples belong to other rays"
    torch.testing.assert_close(got.tail[same], expected.tail[same], atol=1e-5, rtol=1e-5)


def random_samples(counts: Sequence[int], seed: int) -> Samples:
    """Return rays of a few samples each, many of them faint and some behind optical depth that was left out."""
    generator = torch.Generator().manual_seed(seed)
    count, total = torch.tensor(counts), sum(counts)
    sigma = 6.0 * torch.rand(total, generator=generator) ** 4
    skipped = torch.rand(total, generator=generator) * (torch.rand(total, generator=generator) < 0.2)
    ray = torch.arange(len(counts), dtype=torch.int32).repeat_interleave(count)
    tail = torch.rand(len(counts), generator=generator)
    return Samples(torch.zeros(total, 3), sigma, skipped, ray, count.cumsum(0) - count, count, tail, 0.1)


def check_composite(kernels: Kernels, device: torch.device, seed: int, counts: Sequence[int], channels: int) -> None:
    """Compare value and gradient, for rays of any number of samples, with and without optical depth between them."""
    samples, generator = random_samples(counts, seed), torch.Generator().manual_seed(seed)
    rays, total = len(counts), len(samples)
    sigma, values = 20.0 * torch.rand(total, generator=generator), torch.rand(total, channels, generator=generator)
    upstream = torch.rand(rays, channels, generator=generator) - 0.5, torch.rand(rays, generator=generator) - 0.5
    ends = []
    for own, where in ((reference, CPU), (kernels, device)):
        s, v, a, b = (t.to(where) for t in (sigma, values, *upstream))
        here = samples.to(where)
        out, transmittance, weights = own.composite(s, v, here)
        gradients = own.composite_backward(s, v, weights, here, out, transmittance, a, b)
        ends.append([t.detach().cpu() for t in (out, transmittance, weights, *gradients)])
    for theirs, mine in zip(*ends, strict=True):
        torch.testing.assert_close(mine, theirs, atol=KERNELS["value"], rtol=1e-5)


def check_representatives(
    kernels: Kernels, device: torch.device, seed: int, counts: Sequence[int], every: float
) -> None:
    """Compare which samples stand for which; a cut within rounding of a sample's end may fall to its neighbour."""
    samples = random_samples(counts, seed)
    shift = torch.rand(len(counts), generator=torch.Generator().manual_seed(seed))
    rows, place = (t.cpu() for t in kernels.representatives(samples.to(device), every, shift.to(device)))
    assert rows.dtype == place.dtype == torch.int64
    assert len(place) == len(samples) and bool((rows[1:] > rows[:-1]).all()), "rows are not ascending"
    if len(samples):
        expected, at = reference.representatives(samples, every, shift)
        others = torch.unique(samples.ray[rows[place] != expected[at]])
        assert len(others) <= max(1, len(counts) // 100), f"{len(others)} of {len(counts)} rays differ"


def check_leaps(kernels: Kernels, device: torch.device, seed: int, shape: tuple[int, int, int], share: float) -> None:
    """Compare how far rays may leap over empty cells."""
    occupied = torch.from_numpy((np.random.default_rng(seed).random(shape) < share).astype(np.uint8))
    assert torch.equal(kernels.leaps(occupied.to(device)).cpu(), reference.leaps(occupied)), "leaps differ"


def check_directions(kernels: Kernels, device: torch.device, seed: int, rays: int, count: int) -> None:
    """Compare the spherical harmonics of samples' rays."""
    generator = torch.Generator().manual_seed(seed)
    directions = torch.nn.functional.normalize(torch.randn(rays, 3, generator=generator), dim=1)
    ray = torch.randint(rays, (count,), generator=generator, dtype=torch.int32)
    got = kernels.directions_of_samples(directions.to(device), ray.to(device)).cpu()
    torch.testing.assert_close(got, reference.directions_of_samples(directions, ray), atol=1e-6, rtol=1e-6)


def weights_of(shape: tuple[int, int, int, int], seed: int, scale: float = 1.0) -> list[Tensor]:
    """Return random weights of a network: inputs, width, hidden layers and outputs. (to, from) each"""
    inputs, width, hidden, outputs = shape
    sizes, generator = [inputs, *[width] * hidden, outputs], torch.Generator().manual_seed(seed)
    return [
        scale * torch.randn(to, source, generator=generator) * (2.0 / source) ** 0.5 for source, to in pairwise(sizes)
    ]


class _Rounded(torch.autograd.Function):
    """float16 and back; the gradient passes."""

    @staticmethod
    def forward(ctx: Context, x: Tensor) -> Tensor:
        return x.half().float()

    @staticmethod
    def backward(ctx: Context, g: Tensor) -> Tensor:
        return g


def rounded_layers(x: Tensor, weights: Sequence[Tensor]) -> Tensor:
    """:func:`svv.core.rays.networks.relu_layers` with operands of the accuracy of float16; gradients are of float32."""
    for weight in weights[:-1]:
        x = torch.relu(_Rounded.apply(x) @ _Rounded.apply(weight).T)
    return _Rounded.apply(x) @ _Rounded.apply(weights[-1]).T


def value_and_gradients(
    run: Callable[[Tensor, Sequence[Tensor]], Tensor], x: Tensor, weights: Sequence[Tensor], g: Tensor,
    device: torch.device,
) -> list[Tensor]:  # fmt: skip
    """Return a network's value and gradients with respect to inputs and weights, on the CPU."""
    leaves = [t.detach().clone().to(device).requires_grad_() for t in (x, *weights)]
    out = run(leaves[0], leaves[1:])
    return [t.detach().cpu() for t in (out, *torch.autograd.grad(out, leaves, g.to(device)))]


def relative_error(mine: Tensor, theirs: Tensor) -> float:
    """Return the root of the mean squared difference, as a part of that of ``theirs``."""
    return float((mine - theirs).square().mean().sqrt() / theirs.square().mean().sqrt().clamp(min=1e-30))


def check_network(
    kernels: Kernels, device: torch.device, seed: int, shape: tuple[int, int, int, int], count: int, exponent: int = 0
) -> None:
    """Compare a network whose precision does not matter with plain torch, in value and gradient.

    It may be exact, or as exact as plain torch with operands of float16. The loss has gradients of 2 ** ``exponent``.
    """
    generator, weights = torch.Generator().manual_seed(seed), weights_of(shape, seed)
    x = torch.randn(count, shape[0], generator=generator)
    g = 2.0**exponent * torch.randn(count, shape[-1], generator=generator)
    got = value_and_gradients(lambda x, w: kernels.network(x, w, True), x, weights, g, device)
    apart = []
    for like in (rounded_layers, relu_layers):
        expected = value_and_gradients(like, x, weights, g, CPU)
        assert [t.shape for t in got] == [t.shape for t in expected]
        apart.append([relative_error(mine, theirs) for mine, theirs in zip(got, expected, strict=True)])
    least = min(value for value, *_ in apart)
    assert least < NETWORKS[torch.float32], f"values differ by {least:.1e} of themselves"
    most = min(max(gradients) for _, *gradients in apart)
    assert most < NETWORKS[torch.float16], f"gradients differ by {most:.1e} of themselves"


def check_exact_network(kernels: Kernels, device: torch.device, seed: int, count: int) -> None:
    """Compare a network in full precision with plain torch."""
    weights, x = weights_of((32, 64, 2, 3), seed), torch.randn(count, 32, generator=torch.Generator().manual_seed(seed))
    got = kernels.network(x.to(device), [w.to(device) for w in weights], False).cpu()
    assert relative_error(got, relu_layers(x, weights)) < NETWORKS[torch.float32]


Check = Callable[[Kernels, torch.device, int], None]


def checks(samples: int = 150) -> Mapping[str, Check]:
    """Return all checks by name, to be called with kernels, their device and a seed.

    ``samples``: how many each has; 1 << 17 fill a large GPU.

    >>> checks()["adam"](reference, CPU, 0)
    """
    rays = max(40, samples // 8)
    counts = tuple(np.random.default_rng(0).integers(0, 9, rays).tolist())
    cells, log2 = (32, 15) if samples > 1 << 12 else (4, 8)
    few = min(samples, 1 << 15)
    found: dict[str, Check] = {}
    for features in (1, 4):
        name = f"lattice, {features} features"
        found[name] = partial(check_lattice, features=features, count=samples, cells=cells)
    found["hash grid"] = partial(check_hash_grid, features=2, count=samples, log2_entries=log2)
    found["adam"] = partial(check_adam, features=4, rows=samples)
    for name, (how, jitter) in MARCHES.items():
        found[f"march, {name}"] = partial(check_march, how=how, jitter=jitter, count=rays)
    for pieces in (0, 2):
        image = MARCHES["image"][0]
        found[f"march, {pieces} pieces"] = partial(check_march, how=image, jitter=0, count=rays, pieces=pieces)
    for channels in (3, 8):
        found[f"composite, {channels} channels"] = partial(check_composite, counts=counts, channels=channels)
    found["representatives"] = partial(check_representatives, counts=counts, every=1 / 16)
    found["leaps"] = partial(check_leaps, shape=(cells, cells - 1, cells), share=0.02)
    found["directions"] = partial(check_directions, rays=rays, count=samples)
    for shape in NETWORK_SHAPES:
        found[f"network {shape}"] = partial(check_network, shape=shape, count=few)
    found["network, full precision"] = partial(check_exact_network, count=few)
    return found
