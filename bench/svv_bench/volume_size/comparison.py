"""Table of direct volume rendering (DVR) against palette networks (PCN), over the size of the volume, in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from svv.styles.weights import NO_LPIPS

Row = Mapping[str, Any]
"""Measurement of one side at one size: the columns of compare.csv."""

About = Mapping[str, Any]
"""How and on what was measured: :func:`svv_bench.volume_size.circumstances.circumstances`, settings and dates."""

SIDES = {"DVR": "VTK's ray caster", "bricks": "the ray caster of bricks", "PCN": "the PCN"}
"""VTK's ray caster, our own and the palette network, in sentences."""

QUANTITIES = {"time": ("seconds_least", "seconds_most"), "memory": ("own_bytes", "own_bytes")}
"""What crosses, and the columns with its smallest and largest value."""


def table(rows: Sequence[Row], about: About) -> str:
    """Return a table with all sides in one line per size, where they cross, and under which circumstances."""
    likened = any(row.get("lpips") is not None for row in rows)
    head = ["volume", "image", "VTK time", "VTK memory", "bricks time", "bricks memory", "volume file"]
    head += ["PCN time", "PCN memory", "scene file", "PSNR", "foreground", "SSIM", *(["LPIPS"] if likened else [])]
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for other in (row for row in rows if row["side"] == "PCN"):
        mine, size = (other["volume"], other["image"]), f"{other['volume']}"
        sides = {r["side"]: r for r in rows if (r["volume"], r["image"]) == mine}
        cells = [size, f"{other['image']}^2", *(costs(sides["DVR"]) if "DVR" in sides else ["does not fit", ""])]
        cells += [*costs(sides["bricks"]), megabytes(sides["bricks"]), *costs(other), megabytes(other)]
        cells += [f"{other['psnr']:.2f} dB", f"{other['psnr_foreground']:.2f} dB", f"{other['ssim']:.4f}"]
        cells += [f"{other['lpips']:.4f}"] if likened else []
        lines.append(f"| {' | '.join(cells)} |")
    crossings = [crossing(rows, side, quantity) for side in ("DVR", "bricks") for quantity in QUANTITIES]
    said = [how_measured(about), idle(rows), *([] if likened else [NO_LPIPS]), measured_on(about)]
    return "\n".join([*lines, "", *(f"{sentence}\n" for sentence in [*crossings, *said])])


def costs(row: Row) -> list[str]:
    """Return one side's time with its range, and its own memory, as texts."""
    seconds = [1e3 * row[f"seconds_{name}"] for name in ("median", "least", "most")]
    return [f"{seconds[0]:.0f} ms ({seconds[1]:.0f} to {seconds[2]:.0f})", f"{row['own_bytes'] / 1e6:.0f} MB"]


def megabytes(row: Row) -> str:
    """Return the size of one side's file as a text."""
    return f"{row['data_bytes'] / 1e6:.1f} MB"


def how_measured(about: About) -> str:
    """Return a sentence that says what the figures are."""
    return (
        f"Time of an image: the median (smallest to largest) of {about['repeats']} repeats, each the mean over "
        f"{about['unseen_views']} views on which the scene was not trained, after a first one that does not count. "
        "Memory: the most that the process held while it rendered, less what it held before it opened the volume or "
        "scene."
    )


def idle(rows: Sequence[Row]) -> str:
    """Return a sentence about the memory of the programs themselves, which is in no figure."""
    told = []
    for side, name in SIDES.items():
        held = [row["idle_bytes"] / 1e9 for row in rows if row["side"] == side]
        if held:
            low, high = f"{min(held):.2f}", f"{max(held):.2f}"
            told.append(f"{name} {low if low == high else f'{low} to {high}'} GB")
    return f"Held before: {', '.join(told)}."


def measured_on(about: About) -> str:
    """Return a sentence with date, machine, versions and settings."""
    programs = [f"svv {about['svv']}{f' ({commit})' if (commit := about['commit']) else ''}"]
    programs += [f"ParaView {about['paraview']}"] if about["paraview"] else []
    programs += [f"VTK {about['vtk']}", f"torch {about['torch']}", f"Python {about['python']}", str(about["system"])]
    machine = [str(about["processor"]), f"{about['cores']} cores", f"{about['memory_bytes'] / 1e9:.0f} GB"]
    machine += [about["gpu"]] if about["gpu"] else []
    settings = [f"volume {about['volume']}", f"preset {about['preset']}"]
    settings += [f"{about['time_limit']:g} s at most"] if about["time_limit"] else []
    settings += [f"learned from {about['learned_from']}", f"{about['views']} training views of {about['views_side']}^2"]
    settings += [f"seed {about['seed']}", f"VTK's ray caster: {about['ray_caster']}"]
    return f"Measured {about['date']} on {', '.join(machine)}; {', '.join(programs)}; {', '.join(settings)}."


def crossing(rows: Sequence[Row], side: str, quantity: str) -> str:
    """Return a sentence about the volumes between which a side and the PCN change places, for the largest image.

    One side takes less than the other only if its largest value is below the other's smallest one.
    """
    image, keys = max(row["image"] for row in rows), QUANTITIES[quantity]
    one, other = (
        {r["volume"]: tuple(r[key] for key in keys) for r in rows if (r["side"], r["image"]) == (s, image)}
        for s in (side, "PCN")
    )
    volumes, said = sorted(one.keys() & other.keys()), SIDES[side]
    where = f"In {quantity}, at {image}^2 pixels,"
    if not volumes:
        return f"{where} {said} was not measured: no volume fits."
    less = {}
    for n in volumes:
        if one[n][1] < other[n][0] or other[n][1] < one[n][0]:
            less[n] = said if one[n][1] < other[n][0] else SIDES["PCN"]
    through = f"{volumes[0]}^3 to {volumes[-1]}^3"
    if not less:
        return (
            f"{where} neither {said} nor the PCN takes less: their spreads overlap at all volumes measured, {through}."
        )
    changes = [(a, b) for a, b in pairwise(less) if less[a] != less[b]]
    if len(changes) == 1:
        ((a, b),) = changes
        return f"{where} {less[a]} takes less up to {a}^3 voxels, {less[b]} from {b}^3: they cross between them."
    told = "; ".join(f"{name} takes less at {_listed(less, name)}" for name in dict.fromkeys(less.values()))
    open_ = [n for n in volumes if n not in less]
    told += f"; the spreads overlap at {', '.join(f'{n}^3' for n in open_)}" if open_ else ""
    if changes:
        return f"{where} the order changes more than once: {told}."
    return f"{where} no crossing was seen from {through}: {told}."


def _listed(less: Mapping[int, str], name: str) -> str:
    return ", ".join(f"{n}^3" for n in less if less[n] == name)
