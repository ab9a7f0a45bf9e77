"""Figures of the pairs of a folder of frames, by svv's protocol and by the paper's, and what makes them doubtful."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from svv.errors import BadInput, Progress, silent
from svv.io.files.atomic import write_json
from svv.train.lpips import MIN_SIZE, Lpips
from svv_bench.frames.motion import Source
from svv_bench.frames.sequence import FrameFolder
from svv_bench.styles.paper import SEEN, lpips_within, mean_of, paper_figures
from svv_bench.styles.path import METRICS

SAVE_EVERY = 20
"""Number of pairs that are measured before results are saved."""
LEAST_FOLLOWED = 0.15
"""Share of what the second frame shows below which the flow counts as explaining nothing. Unrelated pictures have 0.01
to 0.10 (noise, paintings, a picture and its mirror image), frames of a scene 0.11 to 0.94."""

FIGURES = (*METRICS, *SEEN, "share", "followed")
"""Figures of a pair. ``share``: of the frame's pixels that svv's protocol compares; ``followed``: that share of what
the second frame shows, nan if it shows nothing."""

Record = dict[str, Any]


@dataclass(frozen=True)
class Compared:
    """Which pairs of frames are compared."""

    intervals: tuple[int, ...] = (1, 10)
    """Numbers of frames from the first frame of a pair to its second."""
    every: int = 1
    """Number of frames from the beginning of one pair to that of the next."""

    def pairs(self, frames: FrameFolder) -> tuple[list[tuple[int, int, int]], list[str]]:
        """Return interval, first and second number of each pair, and a sentence for each interval without pairs.

        Raises:
            BadInput: There are no pairs at all.
        """
        found = frames.pairs(self.intervals, self.every)
        lacking = [n for n in self.intervals if n not in {pair[0] for pair in found}]
        if not found:
            raise BadInput(
                f"No two of the {len(frames.numbers)} frames in {frames.folder} are {_or(self.intervals)} apart: "
                "choose a smaller distance with --intervals."
            )
        return found, [f"There are no pairs {n} apart: there are only {len(frames.numbers)} frames." for n in lacking]


def measure_pairs(
    frames: FrameFolder, source: Source, pairs: Sequence[tuple[int, int, int]], network: Lpips | None, file: Path,
    key: str, progress: Progress = silent,
) -> list[Record]:  # fmt: skip
    """Compare pairs of frames along the flow; pairs that are in the file already are not measured again.

    Which pixels show something is decided by the frames of ``source.guide``, the unstyled ones if there are any.

    Args:
        frames: The frames.
        source: Their motion.
        pairs: Interval, first and second number of each pair.
        network: LPIPS; None leaves it out.
        file: JSON file of the results.
        key: Key of the frames and of their motion; results with another key are measured again.
        progress: Called before each pair.

    Returns:
        Records with ``flow``, ``interval``, ``first``, ``second``, ``same`` (whether both frames are the same picture)
        and :data:`FIGURES`, None where there is nothing to measure.
    """
    records = _read(file, key)
    found = {(r["first"], r["second"]): r for r in records}
    left = [pair for pair in pairs if pair[1:] not in found]
    for index, (interval, first, second) in enumerate(left):
        progress(index / len(left), f"{source.name}, frames {first} and {second}")
        values = figures(frames, source, first, second, network)
        records.append({"flow": source.name, "interval": interval, "first": first, "second": second, **values})
        if index % SAVE_EVERY == 0 or index == len(left) - 1:
            write_json(file, {"key": key, "pairs": records})
    found = {(r["first"], r["second"]): r for r in records}
    progress(1.0, "measured")
    return [{**found[a, b], "interval": n} for n, a, b in pairs]


def figures(frames: FrameFolder, source: Source, first: int, second: int, network: Lpips | None) -> Record:
    """Return ``same`` and :data:`FIGURES` of one pair."""
    motion, guide = source.between(first, second), source.guide
    warp = motion.warp(guide.visible(first), guide.visible(second))
    one, two = (frames.straight(number) for number in (first, second))
    values: Record = dict(warp.differences(one, two))
    seen = float(guide.visible(second).mean())
    values["lpips"] = lpips_within(network, *warp.compared(one, two))
    before, after = frames.whole(first), frames.whole(second)
    # Where the flow is unknown, as behind everything that has a depth, nothing moves.
    values |= paper_figures(network, before, after, np.nan_to_num(motion.there), motion.importance)
    values |= {"followed": values["share"] / seen if seen else None, "same": bool(np.array_equal(before, after))}
    return {name: None if isinstance(v, float) and not np.isfinite(v) else v for name, v in values.items()}


def rows_of(records: Sequence[Record], frames: str) -> list[Record]:
    """Return a row per flow and interval: the means over its pairs, with the name of the frames."""
    rows = []
    for flow, interval in dict.fromkeys((r["flow"], r["interval"]) for r in records):
        own = [r for r in records if (r["flow"], r["interval"]) == (flow, interval)]
        rows.append({"frames": frames, "flow": flow, "interval": interval, "pairs": len(own), **mean_of(own, FIGURES)})
    return rows


def doubts(records: Sequence[Record], guide: FrameFolder, name: str) -> list[str]:
    """Return a sentence for everything that makes figures doubtful or meaningless.

    Args:
        records: Figures of all pairs.
        guide: The frames that decide what is visible.
        name: Name of the measured frames, for what concerns them and not their motion.
    """
    files, found = dict(zip(guide.numbers, guide.files)), []
    if all(r["followed"] is None for r in records):
        return ["The later frame of every pair shows nothing but its background, so there is nothing to measure."]
    if all(r["same"] for r in records):
        return [f"{name}: all compared frames are the same picture, which agrees with itself."]
    for flow, interval in dict.fromkeys((r["flow"], r["interval"]) for r in records):
        own = [r for r in records if (r["flow"], r["interval"]) == (flow, interval)]
        where = f"{flow}, {interval} apart"
        lost = [r for r in own if r["followed"] is None or r["followed"] < LEAST_FOLLOWED]
        if lost:
            one, two = (files[lost[0][k]].name for k in ("first", "second"))
            found.append(
                f"{where}: the flow explains nothing in {len(lost)} of {len(own)} pairs ({one} and {two}): less "
                f"than {LEAST_FOLLOWED:.0%} of what they show can be followed; the frames are unrelated or move too "
                "far, and such figures mean nothing."
            )
        worse = [r for r in own if r not in lost and (r["rmse_part"] or 0.0) >= 1.0]
        if worse:
            found.append(
                f"{name}, {where}: in {len(worse)} of {len(own)} pairs the later frame differs more from the warped "
                "one than from its own mean colour."
            )
    return found


def lpips_note(network: Lpips | None, frames: FrameFolder) -> list[str]:
    """Return why LPIPS was not measured, if it was not."""
    if network is None:
        return [
            "LPIPS was not measured because its weights are not on this machine: fetch them with svv features --get."
        ]
    if min(frames.size) < MIN_SIZE:
        return [f"LPIPS was not measured because it needs frames of at least {MIN_SIZE} x {MIN_SIZE} pixels."]
    return []


def _or(numbers: Sequence[int]) -> str:
    return " or ".join(map(str, numbers))


def _read(file: Path, key: str) -> list[Record]:
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        return list(content["pairs"]) if content["key"] == key else []
    except (OSError, ValueError, KeyError, TypeError):
        return []  # not begun, or damaged
