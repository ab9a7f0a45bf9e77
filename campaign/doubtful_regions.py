"""Whether the confidence told of regions that views alone tell is right: generated scenes whose regions are known.

``python -m campaign.doubtful_regions --out FOLDER --scenes 80`` trains scenes of 2 to 5 ranges, from nested shells to
clouds, of opacities and hues at random, on views alone. Each is one line of ``FOLDER/scenes.jsonl``: of each region
what was told and its intersection over union with the range that it stands for. Scenes that are there are not repeated.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from svv.core.colour.colour import rgb_array
from svv.core.volumes.classified import ClassifiedVolume
from svv.dvr.draw.views import make_views
from svv.errors import silent
from svv.fields.radiance.rendering import march
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet
from svv.train.palette.ranges import LOOKED_AT, KnownRegions, Owners, shares_of
from svv.train.palette.recolour import palette_of
from svv.train.palette.regions_from_views import regions_in
from svv.train.run.batches import RayPool
from svv.train.run.config import PRESETS
from svv.train.training import Training
from svv_bench.stability.scenes import KnownScene, Range, layers

Array = NDArray[np.float64]

RESOLUTION, VIEWS, SIZE = 48, 24, 96
"""Voxels along a side, and number and size of the views: small, so that a scene takes a few seconds of processor."""

STEPS, RAYS = 150, 2048
"""Steps of the base field, and rays of each, which suffice for so few pixels."""


def _shells(random: np.random.Generator, count: int) -> Callable[[Array], Array]:
    phase, strength = random.uniform(0.0, 6.0, 3), random.uniform(0.02, 0.2)

    def field(point: Array) -> Array:
        x, y, z = point
        dents = 1.0 + strength * np.sin(4.0 * x + phase[0]) * np.sin(4.0 * y + phase[1]) * np.cos(3.0 * z + phase[2])
        return np.asarray(count * (1.0 - np.sqrt(x * x + y * y + z * z) * dents / 0.95))

    return field


def _clouds(random: np.random.Generator, count: int) -> Callable[[Array], Array]:
    centres, widths = random.uniform(-0.6, 0.6, (12, 3)), random.uniform(0.2, 0.45, 12)

    def field(point: Array) -> Array:
        near = [np.exp(-sum((p - c) ** 2 for p, c in zip(point, centre)) / (2.0 * width**2))
                for centre, width in zip(centres, widths)]  # fmt: skip
        return np.asarray(count * (1.0 - np.exp(-1.2 * np.sum(near, axis=0))) - 0.4)

    return field


def _balls(random: np.random.Generator, count: int) -> Callable[[Array], Array]:
    centres, radii = random.uniform(-0.65, 0.65, (3 * count, 3)), random.uniform(0.15, 0.32, 3 * count)

    def field(point: Array) -> Array:
        values = np.full(point[0].shape, -0.5)
        for number, (centre, radius) in enumerate(zip(centres, radii)):
            inside = sum((p - c) ** 2 for p, c in zip(point, centre)) < radius**2
            values[inside] = number % count + 0.5
        return values

    return field


def known_scene(seed: int) -> KnownScene:
    """Return the scene of a seed: a shape, 2 to 5 ranges of values, and their hues and opacities."""
    random = np.random.default_rng(seed)
    count = int(random.integers(2, 6))
    shape = (_shells, _clouds, _balls, lambda _, ranges: layers(ranges))[seed % 4](random, count)
    hues = (random.uniform() + np.arange(count) / count + random.normal(0.0, 0.12 / count, count)) % 1.0
    if random.uniform() < 0.5:  # two whose hues are near
        one, other = random.choice(count, 2, replace=False)
        hues[other] = (hues[one] + random.uniform(0.02, 0.12)) % 1.0
    saturation, value = random.uniform(0.45, 0.95, count), random.uniform(0.6, 0.98, count)
    opacity = np.exp(random.uniform(np.log(0.04), np.log(0.9), count))
    colours = rgb_array(np.stack([hues, saturation, value], axis=1)).tolist()
    return KnownScene(shape, tuple(
        Range(k + 0.12, k + 0.88, float(opacity[k]), (r, g, b)) for k, (r, g, b) in enumerate(colours)
    ))  # fmt: skip


@torch.no_grad()
def true_overlaps(base: Scene, views: ViewSet, volume: ClassifiedVolume, found: KnownRegions) -> list[float]:
    """Return the overlap of each region with its range, in the best one-to-one assignment, by light; 0 without one."""
    batch = RayPool(views, base.occupancy.box, 0, base.device).batch(0, LOOKED_AT)
    samples = march(batch.rays, base.occupancy, base.base.density, base.marching)
    ours, theirs = base.occupancy.box, volume.box
    shift = samples.position.new_tensor((np.asarray(ours.low) - np.asarray(theirs.low)) / theirs.size)
    ranges, regions = len(volume.ranges), len(found.palette.colours)
    at = samples.position * (ours.size / theirs.size) + shift
    owner = Owners(volume, np.arange(ranges), base.device).of(at)
    told = owner * regions + found.owners.of(samples.position)
    both = shares_of(samples, base.base.extinction(samples), told, ranges * regions).reshape(ranges, regions)
    each = both / np.maximum(both.sum(axis=1, keepdims=True) + both.sum(axis=0) - both, 1e-12)
    overlap = np.zeros(regions)
    rows, columns = linear_sum_assignment(-each)
    overlap[columns] = each[rows, columns]
    return [round(float(value), 4) for value in overlap]


def regions_of_scene(seed: int) -> tuple[dict[str, Any], Scene, ViewSet, KnownRegions]:
    """Find the regions of the scene of a seed: what was told of them and what is true, and what they were found in."""
    known, draft = known_scene(seed), PRESETS["draft"]
    views = make_views(known.volume(RESOLUTION), known.transfer_function(), n=VIEWS, size=SIZE, mapper="cpu")[0]
    assert views.classified is not None
    few = replace(draft, reconstruct=replace(draft.reconstruct, rays=RAYS, iterations=STEPS))
    alone = replace(views, classified=None)
    base = Training(alone, few, None, seed, silent, None, torch.device("cpu"))._base()
    palette = palette_of(alone, base.occupancy, seed, device=base.device)
    found = regions_in(base, alone, palette, seed)
    row = {
        "seed": seed,
        "ranges": len(views.classified.ranges),
        "opacities": [round(one.opacity, 3) for one in known.ranges],
        "told": list(found.confidence),
        "true": true_overlaps(base, alone, views.classified, found),
    }
    return row, base, alone, found


def main() -> None:
    """Measure scenes, and print how far told and true values are apart."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--scenes", type=int, default=80)
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    file = asked.out / "scenes.jsonl"
    rows = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    for seed in sorted(set(range(asked.scenes)) - {row["seed"] for row in rows}):
        rows.append(regions_of_scene(seed)[0])
        with file.open("a") as out:
            out.write(json.dumps(rows[-1]) + "\n")
        print(rows[-1], flush=True)
    told, true = (np.concatenate([row[name] for row in rows if row["told"]]) for name in ("told", "true"))
    for tenth in range(10):
        mine = (10.0 * told).astype(int).clip(max=9) == tenth
        if mine.any():
            print(f"told .{tenth}: {mine.sum()} regions, {told[mine].mean():.2f}; true: {true[mine].mean():.2f}")
    wrong = int(((told > 0.9) & (true < 0.6)).sum())
    print(f"{len(told)} regions: mean error {np.abs(told - true).mean():.3f}, {wrong} above .9 with less than .6")


if __name__ == "__main__":
    main()
