"""The volume's values on a page, which clicks read off as ``svv probe`` does (``values.js``).

They are what the scene's file keeps (:mod:`svv.fields.radiance.kept_values`), as compressed there.
"""

from __future__ import annotations

import numpy as np

from svv.errors import BadInput
from svv.fields.radiance.kept_values import FINEST, KeptValues, finer_than_cells
from svv.fields.radiance.time_steps import TimeSteps
from svv.fields.scene.joined import members
from svv.fields.scene.probing import voxels_in_one
from svv.fields.scene.scene import Scene


def values_of(scene: Scene) -> tuple[list[dict[str, object] | None], bytes]:
    """Return what a page is told of the values of each function of a scene, None where it keeps none, and their bytes.

    Raises BadInput if they are damaged.
    """
    told: list[dict[str, object] | None] = []
    content: list[bytes] = []
    for member in members(scene):
        kept = _kept(member)
        if kept is None:
            told.append(None)
            continue
        source, steps = member.made.get("source", {}), member.steps
        grid = source.get("grid")
        told.append({
            "box": {"low": kept.box.low, "size": kept.box.size}, "shape": kept.shape, "cells": kept.cells,
            "interval": kept.interval, "step": kept.step, "coarse": kept.coarse, "nearest": kept.nearest,
            "whole": kept.whole, "finer": finer_than_cells(kept.edges).tolist(), "finest": FINEST,
            "bytes": [len(kept.there), len(kept.codes)], "range": None if grid is None else list(grid["range"]),
            "mean_of": voxels_in_one(kept, grid), "array": source.get("array") or source.get("volume"),
            "time": steps.times[steps.own] if steps is not None and steps.times != (0.0,) else None,
        })  # fmt: skip
        content += [kept.there.tobytes(), kept.codes.tobytes()]
    return told, b"".join(content)


def _kept(scene: Scene) -> KeptValues | None:
    """Return the values that a scene keeps, of the step that it shows."""
    steps: TimeSteps | None = scene.steps
    if steps is None:
        return scene.kept
    try:
        grid = steps.grid(steps.own, (0.0, 1.0))
    except ValueError as error:
        raise BadInput(f"The volume's values in the scene cannot be read ({error}): train it again.") from error
    # Steps have values of 10 bits everywhere; those around what is shown suffice.
    return KeptValues.of(grid, steps.box, scene.occupancy)


def interval_of(values: tuple[float, float] | None) -> list[float] | None:
    """Return a region's interval of values, for a page's header, which holds no infinite number."""
    return None if values is None or not np.isfinite(values).all() else list(values)
