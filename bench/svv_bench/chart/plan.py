"""The runs of a chart, and the keys by which finished runs are recognized."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from svv.errors import BadInput
from svv.options.making import MapperName
from svv.train.run.config import lit_by, preset
from svv_bench.keys import key_of_measure

SECONDS = {"draft": 40.0, "fast": 120.0, "balanced": 250.0, "best": 900.0, "paper": 9000.0}
"""Rough time of a complete training in seconds, from which the remaining time is estimated before the first run."""

HASH_TAKES = 4.0
"""Rough factor on these times with a hash grid."""

REFERENCE_TAKES = 8.0
"""Rough factor on these times with the reference kernels."""

LEAST_VIEWS = 5
"""Minimum number of timed views of a run: a median of fewer says little."""


@dataclass(frozen=True)
class Grid:
    """Settings that are varied; every combination is a run."""

    presets: tuple[str, ...] = ("draft", "fast")
    encodings: tuple[str, ...] = ("lattice", "hash")
    limits: tuple[float | None, ...] = (15.0, 30.0, 60.0)
    """Time limits of training in seconds; None for the preset's whole schedule."""
    sizes: tuple[int | None, ...] = (None,)
    """Widths of the training views in pixels; None for the original views, or 400 for a volume."""
    render_sizes: tuple[int | None, ...] = (None,)
    """Widths of the rendered views in pixels; None for that of the training views."""
    devices: tuple[str, ...] = ("cpu",)
    kernels: tuple[str, ...] = ("auto",)
    """Kernels. ``auto``: numba on the CPU, Triton on a GPU; ``reference``: plain torch."""
    seeds: tuple[int, ...] = (0,)
    lightings: tuple[str, ...] = ("network",)
    """Lighting of scenes whose views show light: network, phong or auto."""


@dataclass(frozen=True)
class Measure:
    """How each run is measured and how a volume's views are drawn."""

    test: int = 8
    """Number of unseen views that are scored and timed."""
    network: str = "pcn"
    """Network whose colours are scored: base or pcn."""
    n: int = 92
    """Number of training views drawn of a volume."""
    mapper: MapperName = "auto"
    """Ray caster for a volume: auto, gpu or cpu."""


@dataclass(frozen=True)
class Training:
    """One training run."""

    scene: str
    """Name of the scene."""
    source: str
    """Hash of everything that the training views depend on."""
    preset: str
    encoding: str
    size: int
    """Width of the training views in pixels."""
    limit: float | None
    device: str
    seed: int
    kernels: str = "auto"
    lighting: str = "network"

    @property
    def settings(self) -> dict[str, Any]:
        """All its settings, as JSON."""
        return {k: v for k, v in asdict(self).items() if k != "source"}

    @property
    def name(self) -> str:
        """Name of its folder: readable, and unique even among past versions of a preset's settings."""
        chosen = lit_by(preset(self.preset, self.encoding), self.lighting)
        key = digest({"run": asdict(self), "preset": asdict(chosen)})
        limit = "full" if self.limit is None else f"{self.limit:g}s"
        where = self.device if self.kernels == "auto" else f"{self.device}-{self.kernels}"
        table = self.encoding if self.lighting == "network" else f"{self.encoding}-{self.lighting}"
        return "-".join((self.scene, self.preset, table, f"{self.size}px", limit, where, f"seed{self.seed}", key))

    @property
    def expected(self) -> float:
        """Rough time that it takes, in seconds."""
        whole = SECONDS[self.preset] * (HASH_TAKES if self.encoding == "hash" else 1.0)
        whole *= REFERENCE_TAKES if self.kernels == "reference" else 1.0
        return 15.0 + (whole if self.limit is None else min(whole, self.limit))


@dataclass(frozen=True)
class Rendering:
    """One measurement of a training run's scene: scores and times at one size."""

    training: Training
    size: int
    """Width of the rendered views in pixels."""
    measured: str
    """Hash of everything else that its figures depend on."""

    @property
    def file(self) -> str:
        """Name of its JSON file in the folder of its training."""
        return f"render-{self.size}px-{self.measured}.json"


def trainings(grid: Grid, scene: str, source: Mapping[int, str], sizes: tuple[int, ...]) -> list[Training]:
    """List the training runs on one scene, short ones first.

    Args:
        grid: Settings that are varied.
        scene: Name of the scene.
        source: Hash of everything that the views depend on, by their size.
        sizes: Widths of the training views in pixels.
    """
    product = itertools.product(
        grid.seeds, grid.limits, sizes, grid.presets, grid.encodings, grid.devices, grid.kernels, grid.lightings
    )
    runs = [
        Training(scene, source[size], name, encoding, size, limit, device, seed, kernels, lighting)
        for seed, limit, size, name, encoding, device, kernels, lighting in product
    ]
    return sorted(dict.fromkeys(runs), key=lambda run: (run.seed, run.expected))


def check(grid: Grid, measure: Measure) -> None:
    """Check that all settings are in range.

    Raises:
        BadInput: A setting is out of range.
    """
    for name, encoding, lighting in itertools.product(grid.presets, grid.encodings, grid.lightings):
        lit_by(preset(name, encoding), lighting)
    if any(limit is not None and not 1.0 <= limit < float("inf") for limit in grid.limits):
        raise BadInput("A time limit must be a number of at least 1 second, or 'full' for the whole schedule.")
    if any(size is not None and size < 16 for size in (*grid.sizes, *grid.render_sizes)):
        raise BadInput("Views must be at least 16 pixels wide.")
    if measure.test < LEAST_VIEWS:
        raise BadInput(f"Give at least {LEAST_VIEWS} test views, not {measure.test}: times are medians over them.")
    if measure.network not in ("base", "pcn"):
        raise BadInput(f"A chart can show the network base or pcn, not '{measure.network}'.")


def digest(content: Any) -> str:
    """Return eight characters that change with the content, with our version and with the measured code."""
    return key_of_measure(content)[:8]
