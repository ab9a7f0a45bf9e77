"""Results of a profile: stages of work, their times and floors, as data and as text."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from svv_bench.profile.ceilings import Ceilings
from svv_bench.profile.watch import GLUE, NETWORKS, OPTIMISER, REST, REST_BACK
from svv_bench.profile.work import Work
from svv_bench.results import Figure, cells

STAGES = (
    "draw pixels", "rays", "march", "choose samples", "encode", NETWORKS, "encode and networks", "material and light",
    "regions of samples", "composite", REST, "composite, backward", f"{NETWORKS}, backward", "encode, backward",
    REST_BACK, OPTIMISER, "Adam, tables", "prune", GLUE,
)  # fmt: skip
"""All possible stages, in the order of the work."""


@dataclass(frozen=True)
class Stage:
    """One part of a step. Its items are rows of the tables for Adam, and samples or rays for other stages."""

    name: str
    seconds: float
    """Time in seconds, median over the steps."""
    best: float
    """Shortest time in seconds over the steps: undisturbed by other programs, like the ceilings."""
    share: float
    """Fraction of the sum of all stages."""
    work: Work | None
    """Least work; None for operations that could be merged into others and therefore need no work."""
    floor: float
    """Least possible time in seconds."""
    bound: str
    """Bound that determines the floor: bytes, operations or reads; empty without work."""


@dataclass(frozen=True)
class Profile:
    """Profile of one kind of step."""

    name: str
    steps: int
    rays: int
    """Number of rays per step, or of the image."""
    stages: tuple[Stage, ...]

    @property
    def seconds(self) -> float:
        """Time of a step in seconds, the sum of its stages."""
        return sum(stage.seconds for stage in self.stages)

    @property
    def floor(self) -> float:
        """Sum of the stages' floors, in seconds."""
        return sum(stage.floor for stage in self.stages)

    def to_json(self) -> dict[str, Any]:
        """Return plain values."""
        stages = [{**vars(s), "work": None if s.work is None else vars(s.work)} for s in self.stages]
        own = {"name": self.name, "steps": self.steps, "rays": self.rays}
        return {**own, "seconds": self.seconds, "floor": self.floor, "stages": stages}


def profile_of(
    name: str, rays: int, times: list[dict[str, float]], work: Mapping[str, Work], ceilings: Ceilings
) -> Profile:
    """Combine the results of :class:`Watch`: seconds of the stages of each step, and their work."""
    medians = {stage: float(np.median([t.get(stage, 0.0) for t in times])) for stage in STAGES}
    total = sum(medians.values())
    stages = []
    for stage, seconds in medians.items():
        if seconds > 0:
            own = work.get(stage)
            floor, bound = (0.0, "") if own is None else ceilings.floor(own)
            best = min(t.get(stage, 0.0) for t in times)
            stages.append(Stage(stage, seconds, best, seconds / total, own, floor, bound))
    return Profile(name, len(times), rays, tuple(stages))


def figures(profiles: Iterable[Profile]) -> list[Figure]:
    """Return the stages' milliseconds, floors and ratios, for the file of results."""
    columns = (("median", "ms", ".2f"), ("best", "ms", ".2f"), ("floor", "ms", ".2f"), ("best / floor", "", ".1f"))
    rows = [
        (
            f"{p.name} | {s.name}",
            (1e3 * s.seconds, 1e3 * s.best, *((1e3 * s.floor, s.best / s.floor) if s.work else (None, None))),
        )
        for p in profiles
        for s in p.stages
    ]
    return cells("speed/profile", rows, columns)


def as_text(profiles: Iterable[Profile], ceilings: Ceilings) -> str:
    """Format tables for reading: milliseconds per step, and all other figures."""
    half = "none" if ceilings.half_operations is None else f"{ceilings.half_operations / 1e9:.0f}"
    lines = [
        f"memory {ceilings.bytes / 1e9:.1f} GB/s; products {ceilings.operations / 1e9:.0f} G operations/s in float32, "
        f"{half} in bfloat16; random reads {ceilings.gathers / 1e6:.0f} M/s from 1 MB, "
        f"{ceilings.far_gathers / 1e6:.0f} M/s from 64 MB"
    ]
    columns = {"ms": 8, "best": 8, "share": 7, "items": 9, "MB": 8, "M ops": 8, "M reads": 9, "floor": 8, "ratio": 7}
    for profile in profiles:
        times = f"{1e3 * profile.seconds:.2f} ms, floor {1e3 * profile.floor:.2f} ms"
        lines += ["", f"{profile.name}: {profile.rays} rays, {times}"]
        lines.append(" " * 34 + "".join(f"{name:>{width}}" for name, width in columns.items()))
        for s in profile.stages:
            line = f"  {s.name:32}{1e3 * s.seconds:8.2f}{1e3 * s.best:8.2f}{s.share:7.1%}"
            if s.work is not None:
                w, operations = s.work, s.work.operations + s.work.products
                line += f"{w.items:9.0f}{w.bytes / 1e6:8.2f}{operations / 1e6:8.1f}{w.gathers / 1e6:9.2f}"
                line += f"{1e3 * s.floor:8.2f}{s.best / s.floor:7.1f}  {s.bound}"
            lines.append(line)
    return "\n".join(lines)
