"""The least work of the stages of a training step and of an image: bytes that must move, operations, random reads.

It is counted from the arguments of the functions that do the work, which are watched from outside. "Least" assumes
that everything used twice stays in the cache: every input is read once, every output is written once, and only the
distinct rows of a table come from memory. Letters: S samples, R rays, L levels, F features per level, C channels,
V rows of a table, P palette colours.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from torch import Tensor

import svv.train.base.reconstruct
from svv.core.rays.encodings import lattice_corners
from svv.kernels.types import ImageKernels, Kernels, Lattice, TrainingKernels
from svv.train.base.reconstruct import Reconstruction
from svv.train.palette.ranges import Owners
from svv.train.run.batches import RayPool
from svv.train.run.network_adam import NetworkAdam

FLOAT_BYTES = 4
"""Bytes of a float32 value."""

READS_A_CELL = 4
"""Random reads of a cell's eight vertices, which lie in adjacent pairs; locating them takes as many again."""

EXPONENTIAL_OPERATIONS = 15
"""Operations of an exponential in single precision: a polynomial, and the scaling before and after it."""

LOCATE_OPERATIONS = 30
"""Operations that find a position's cell on a level and the weights of its vertices."""


@dataclass(frozen=True)
class Work:
    """The least work of a stage."""

    items: float = 0
    """Samples, rays or rows that it processes."""
    bytes: float = 0
    """Bytes that must move between memory and CPU."""
    operations: float = 0
    """Additions and multiplications in single precision."""
    gathers: float = 0
    """Reads at data-dependent addresses, each of one cache line."""
    products: float = 0
    """Additions and multiplications of matrix products, which may be in half precision."""

    def __add__(self, other: Work) -> Work:
        return Work(*(getattr(self, k) + getattr(other, k) for k in self.__dataclass_fields__))

    def times(self, factor: float) -> Work:
        """Return the work of ``factor`` such stages."""
        return Work(*(getattr(self, k) * factor for k in self.__dataclass_fields__))


@dataclass(frozen=True)
class Watched:
    """A function that is replaced, while a profile is taken, by one that reports when it runs."""

    owner: Any
    name: str
    stage: str
    count: Callable[[Sequence[Any]], Work] | None = None
    """Returns the work of a call from its arguments, before the call; None excludes all functions that it calls."""


def watched(kernels: Kernels) -> list[Watched]:
    """Return the functions to watch: the kernels that run, and the functions of training that do work themselves."""
    march = kernels.march
    return [
        Watched(RayPool, "batch", "draw pixels", lambda a: Work(a[2], 40 * a[2], 0, a[2])),
        Watched(kernels, "pixel_rays", "rays", lambda a: Work(len(a[0]), 32 * len(a[0]), 40 * len(a[0]))),
        Watched(kernels, "march", "march", lambda a: _march(march, a)),
        Watched(svv.train.base.reconstruct, "representatives", "choose samples", lambda a: _choose(len(a[0]))),
        Watched(Owners, "assign", "regions of samples", lambda a: Work(len(a[2]), 20 * len(a[2]), 0, len(a[2]))),
        Watched(kernels, "lattice_encode", "encode", lambda a: _encode(a[0], a[1], a[2].shape[1], 1)),
        Watched(kernels, "hash_encode", "encode", lambda a: _hash(len(a[0]), len(a[1]), a[3].shape[1], 1)),
        Watched(kernels, "composite", "composite", lambda a: _composite(len(a[0]), len(a[2].start), a[1].shape[1], 1)),
        Watched(kernels, "composite_backward", "composite, backward",
                lambda a: _composite(len(a[0]), len(a[5]), a[1].shape[1], 2)),
        Watched(kernels, "lattice_backward", "encode, backward", lambda a: _encode(a[0], a[2], a[3].shape[1], 2)),
        Watched(kernels, "hash_backward", "encode, backward", lambda a: _hash(len(a[0]), len(a[2]), a[4].shape[1], 2)),
        Watched(kernels, "adam", "Adam, tables", _adam),
        Watched(NetworkAdam, "step", "Adam, networks"),
        Watched(Reconstruction, "prune", "prune"),
        *([] if kernels.IMAGE is None else _watched_image(kernels.IMAGE)),
        *([] if kernels.TRAINING is None or kernels.TRAINING.SPARE else _watched_steps(kernels.TRAINING)),
    ]  # fmt: skip


def _watched_steps(steps: TrainingKernels) -> list[Watched]:
    """Return the functions of which the CPU's whole steps are made."""
    from svv.kernels.numba import networks

    return [
        Watched(steps, "representatives", "choose samples", lambda a: _choose(len(a[0]))),
        Watched(Owners, "of", "regions of samples", lambda a: Work(len(a[1]), 20 * len(a[1]), 0, len(a[1]))),
        Watched(steps, "encode_into", "encode", lambda a: _encode(a[1], a[2], a[3].shape[1], 1)),
        Watched(steps, "lattice_encode", "encode", lambda a: _encode(a[0], a[1], a[2].shape[1], 1)),
        Watched(steps, "lattice_backward", "encode, backward", lambda a: _encode(a[0], a[2], a[3].shape[1], 2)),
        Watched(steps, "network_and_back", "networks", lambda a: _network(len(a[0]), a[1])),
        Watched(
            networks,
            "gradients_of",
            "networks, backward",
            lambda a: sum((_network(len(a[0]), a[1]) for _ in range(2)), Work()),
        ),
        Watched(steps, "learn_base", "composite, backward", lambda a: _composite(len(a[0]), len(a[4]), 3, 2)),
        Watched(steps, "learn_palette", "composite, backward", lambda a: _composite(len(a[0]), len(a[5]), 6, 2)),
    ]


def _network(samples: int, weights: Sequence[Tensor]) -> Work:
    return sum((linear_layer(samples, *weight.T.shape) for weight in weights), Work())


def _watched_image(image: ImageKernels) -> list[Watched]:
    return [
        Watched(image, "looks", "encode and networks", _looks),
        Watched(image, "material", "material and light", lambda a: _material(*a[0].shape)),
        Watched(image, "light", "material and light", lambda a: Work(len(a[1]), 40 * len(a[1]), 50 * len(a[1]))),
        Watched(image, "composite", "composite", lambda a: _composite(len(a[1]), len(a[0].start), 7, 1)),
    ]


def linear_layer(samples: int, inputs: int, outputs: int) -> Work:
    """Return the work of a product (S, inputs) x (inputs, outputs); values between layers stay in the cache."""
    return Work(products=2 * samples * inputs * outputs)


def _march(march: Callable[..., Any], a: Sequence[Any]) -> Work:
    """Return the work for the points visited: those in occupied cells up to each ray's end, found by another march."""
    limits = replace(a[8], least_weight=-1.0, merge=False)
    seen, _ = march(*a[:8], limits, *a[9:])
    kept, _ = march(*a)
    levels = len(a[5].scales)
    points, rays = len(seen), len(a[0])
    rows = _distinct(seen.position, a[5])
    moved = 24 * rays + 24 * len(kept) + 20 * rays + (FLOAT_BYTES + FLOAT_BYTES) * rows
    return Work(
        points,
        moved,
        points * (levels * (LOCATE_OPERATIONS + 16) + 20 + EXPONENTIAL_OPERATIONS),
        points * (1 + 2 * READS_A_CELL * levels),
    )


def _distinct(x: Tensor, lattice: Lattice) -> int:
    """Return the number of rows of a lattice's table that are read for the positions."""
    levels = zip(lattice.shapes, lattice.scales, lattice.bases[:-1], strict=True)
    return sum(len(lattice_corners(x, *level, lattice.index)[0].unique()) for level in levels)


def _choose(samples: int) -> Work:
    return Work(samples, 24 * samples, (2 * EXPONENTIAL_OPERATIONS + 10) * samples)


def _encode(x: Tensor, lattice: Lattice, features: int, passes: int) -> Work:
    """Return the work of encoding, forward (1) or backward (2: rows are read and written)."""
    samples, levels = len(x), len(lattice.scales)
    rows = _distinct(x, lattice)
    moved = samples * (12 + FLOAT_BYTES * levels * features) + rows * FLOAT_BYTES * (1 + passes * features)
    return Work(
        samples, moved, samples * levels * (LOCATE_OPERATIONS + 16 * features), samples * levels * 2 * READS_A_CELL
    )


def _hash(samples: int, levels: int, features: int, passes: int) -> Work:
    """Return the work of encoding as :func:`_encode` does; every corner is hashed separately and costs one read."""
    corners = 8 * samples * levels
    moved = samples * (12 + FLOAT_BYTES * levels * features)
    return Work(samples, moved, samples * levels * (LOCATE_OPERATIONS + 40 + 16 * features), corners)


def _looks(a: Sequence[Any]) -> Work:
    samples, _, lattice, tables, *networks = a
    looked_up = _encode(samples.position, lattice, tables.shape[1], 1)
    return sum((_network(len(samples), weights) for weights in networks), looked_up)


def _material(samples: int, outputs: int) -> Work:
    colours = (outputs - 1) // 4
    return Work(
        samples, samples * (FLOAT_BYTES * outputs + 20), samples * (colours * (2 * EXPONENTIAL_OPERATIONS + 12) + 40)
    )


def _composite(samples: int, rays: int, channels: int, passes: int) -> Work:
    """Return the work of compositing, forward (1) or backward (2: values are read, their gradients written)."""
    moved = samples * FLOAT_BYTES * (3 + passes * channels) + rays * FLOAT_BYTES * (5 + 2 * passes * channels)
    return Work(samples, moved, samples * (2 * EXPONENTIAL_OPERATIONS + 4 + 4 * passes * channels))


def _adam(a: Sequence[Any]) -> Work:
    table, _, used = a[:3]
    rows, features = int(used.sum()), table.shape[1]
    return Work(
        rows, len(used) + rows * (8 + FLOAT_BYTES * 8 * features), rows * (2 * EXPONENTIAL_OPERATIONS + 14 * features)
    )
