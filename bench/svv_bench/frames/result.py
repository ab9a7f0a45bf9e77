"""The consistency of a folder of frames, and of other methods' frames beside it: figures, table, notes and a sheet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from svv.errors import BadInput, Progress, part, silent
from svv.io.files.atomic import make_folder
from svv.io.files.keyed_results import digest
from svv.io.pictures.output import to_bytes, write_png
from svv.io.pictures.style_picture import read_style
from svv.render.pictures import Picture, cropped, error_picture, sheet
from svv.train.lpips import load_lpips
from svv_bench.frames.measure import Compared, Record, doubts, lpips_note, measure_pairs, rows_of
from svv_bench.frames.motion import Estimated, Source, given_motion
from svv_bench.frames.painted import Painting, paint_frames
from svv_bench.frames.sequence import FrameFolder, read_folder
from svv_bench.keys import key_of_measure
from svv_bench.results import record
from svv_bench.styles.paper import PAPER
from svv_bench.styles.table import figures, markdown, write_tables

COLUMNS = ("mse", "lpips", "rmse_part", "flip", *PAPER, "share", "followed", "pairs")
"""Figures that the table shows; the files have all."""
OWN = (
    "The flow was estimated from the frames that are compared, so it follows their flicker as well: give the unstyled "
    "frames with --guide, or flows or depths with --motion, if there are any."
)
FORM = 1
"""To be raised when the meaning of a figure changes; saved figures are then measured again."""


@dataclass(frozen=True)
class FolderJob:
    """What is measured of a folder of frames."""

    compared: Compared = field(default_factory=Compared)
    flows: tuple[str, ...] = ("tvl1",)
    """Estimators of the flow; not used if files give it."""
    guide: Path | None = None
    """Folder of the unstyled frames, from which the flow is estimated and what is visible is read."""
    motion: Path | None = None
    """Folder of flows, or of depths and cameras."""
    style: Path | None = None
    """Style picture in which the frames are painted by other methods, too."""
    painting: Painting = field(default_factory=Painting)


def folder_consistency(folder: Path, out: Path, job: FolderJob, progress: Progress = silent) -> dict[str, Any]:
    """Measure the short- and long-range consistency of any folder of frames.

    Args:
        folder: The frames.
        out: Folder of flows, painted frames and results; what is there of the same frames is reused.
        job: What is measured.
        progress: Called before each step; the work stops if it raises, and the same call resumes it.

    Returns:
        ``rows``: means per frames, flow and interval (:func:`svv_bench.frames.measure.rows_of`); ``pairs``: the figures
        of every pair; ``notes``: sentences about what was assumed, and what makes figures doubtful; ``protocol``.

    Raises:
        BadInput: The frames, the guide, the motion or the style picture are not usable.
    """
    work = _Work(folder, out, job, part(progress, 0.0, 0.1))
    shown = work.shown(part(progress, 0.1, 0.7))
    records = work.measured(shown, part(progress, 0.7, 0.98))
    doubtful = [sentence for name, own in records.items() for sentence in doubts(own, work.guide, name)]
    notes = list(dict.fromkeys([*work.notes, *doubtful]))  # all methods have the same motion
    write_sheet(out / "consistency.png", shown, work.sources[0], work.pairs)
    progress(1.0, "measured")
    return {
        "rows": [row for name, own in records.items() for row in rows_of(own, name)],
        "pairs": [{"frames": name, **record} for name, own in records.items() for record in own],
        "notes": notes,
        "protocol": work.protocol(),
    }


class _Work:
    """The work on one folder: its frames, their motion and the pairs that are compared."""

    def __init__(self, folder: Path, out: Path, job: FolderJob, progress: Progress) -> None:
        if job.style is not None and job.guide is not None:
            raise BadInput(
                "Give --guide for frames that are painted already, or --style to paint the frames, not both."
            )
        self.job, self.out = job, out
        self.frames = read_folder(folder, part(progress, 0.0, 0.5))
        self.guide = self.frames if job.guide is None else guide_of(job.guide, self.frames, part(progress, 0.5, 1.0))
        self.pairs, self.notes = job.compared.pairs(self.frames)
        if job.motion is not None and not job.motion.is_dir():
            raise BadInput(
                f"There is no folder {job.motion}: --motion needs one with flows, or with depths and cameras."
            )
        self.style = None if job.style is None else read_style(job.style)
        self.network = load_lpips()
        contents = [digest(path) for path in (*self.frames.files, *self.guide.files)]
        given = None if job.motion is None else digest(job.motion)
        self.key = key_of_measure(FORM, contents, self.frames.numbers, self.guide.numbers, given)
        self.sources = self._sources()
        if job.guide is None and job.motion is None and job.style is None:
            self.notes.append(OWN)
        self.notes += [*self.frames.notes, *lpips_note(self.network, self.frames)]

    def _sources(self) -> list[Source]:
        if self.job.motion is not None:
            return [given_motion(self.guide, self.job.motion)]
        return [Estimated(self.guide, name, self.out / f"{name}-flow", self.key) for name in self.job.flows]

    def shown(self, progress: Progress) -> dict[str, FrameFolder]:
        """Return the given frames and, with a style, those that other methods paint, by their names in the table."""
        found = {f"{self.frames.folder.resolve().name}/": self.frames}
        if self.style is None:
            return found
        modes = self.job.painting.modes
        for index, mode in enumerate(modes):
            span = titled(part(progress, index / len(modes), (index + 1) / len(modes)), mode)
            found[mode] = paint_frames(
                self.sources[0], self.job.compared, self.style, mode, self.job.painting, self.out / mode,
                self.key, span,
            )  # fmt: skip
        return found

    def measured(self, shown: Mapping[str, FrameFolder], progress: Progress) -> dict[str, list[Record]]:
        """Return the records of all pairs, by the names of the frames."""
        found: dict[str, list[Record]] = {name: [] for name in shown}
        jobs = [(name, source) for name in shown for source in self.sources]
        for index, (name, source) in enumerate(jobs):
            span = titled(part(progress, index / len(jobs), (index + 1) / len(jobs)), name)
            files = [digest(path) for path in shown[name].files]
            key = key_of_measure(self.key, files, self.network is not None)
            file = self.out / "pairs" / f"{name.strip('/')}-{source.name}.json"
            found[name] += measure_pairs(shown[name], source, self.pairs, self.network, make_parent(file), key, span)
        return found

    def protocol(self) -> dict[str, Any]:
        """Return what was measured how, for the record."""
        frames, job = self.frames, self.job
        return {
            "folder": frames.folder.resolve().name, "frames": len(frames.numbers), "size": frames.size,
            "step": frames.step, "background": frames.background, "intervals": job.compared.intervals,
            "every": job.compared.every, "flows": [source.name for source in self.sources],
            "flow_from": ("--motion" if job.motion else "--guide" if job.guide else "frames"),
            **({"style": job.style.name, **asdict(job.painting)} if job.style else {}),
        }  # fmt: skip


def guide_of(folder: Path, frames: FrameFolder, progress: Progress = silent) -> FrameFolder:
    """Return the unstyled frames of a folder, as many as the frames and with their numbers.

    Raises:
        BadInput: They are not usable, a number is missing, or sizes differ.
    """
    guide = read_folder(folder, progress)
    if guide.size != frames.size:
        ours, theirs = ("{} x {}".format(*f.size) for f in (frames, guide))
        raise BadInput(f"The frames of --guide have {theirs} pixels and the others {ours}: give both in one size.")
    lacking = [file.name for number, file in zip(frames.numbers, frames.files) if number not in guide.numbers]
    if lacking:
        raise BadInput(f"{folder} has no frame for {lacking[0]}: --guide needs the same numbers.")
    kept = [(n, file) for n, file in zip(guide.numbers, guide.files) if n in frames.numbers]
    return replace(guide, numbers=tuple(n for n, _ in kept), files=tuple(file for _, file in kept), step=frames.step)


def titled(progress: Progress, title: str) -> Progress:
    """Return a progress callback whose labels begin with a title."""
    return lambda fraction, label: progress(fraction, f"{title}: {label}")


def make_parent(file: Path) -> Path:
    """Return a file after making its folder."""
    make_folder(file.parent)
    return file


def write_result(out: Path, found: Mapping[str, Any]) -> str:
    """Write ``consistency.md``, ``.csv`` and ``.json`` (a row per frames, flow and interval); return the Markdown."""
    rows = [{"frames, flow, interval": f"{r['frames']} {r['flow']} {r['interval']}", **r} for r in found["rows"]]
    notes = "\n".join(f"- {note}" for note in found["notes"])
    text = markdown(rows, "frames, flow, interval", COLUMNS) + (f"\n\n{notes}" if notes else "") + "\n"
    write_tables(make_folder(out), "consistency", found["rows"], text)
    record(figures("painting/frames", rows, "frames, flow, interval", COLUMNS))
    return text


def write_sheet(
    file: Path, shown: Mapping[str, FrameFolder], source: Source, pairs: Sequence[tuple[int, int, int]]
) -> None:
    """Draw a pair of frames of each kind, and from white (not at all, or not compared) to dark red where they differ.

    The pair is the middle one of the largest interval, and they are compared after warping.
    """
    longest = max(n for n, _, _ in pairs)
    own = [(a, b) for n, a, b in pairs if n == longest]
    first, second = own[len(own) // 2]
    warp = source.between(first, second).warp(source.guide.visible(first), source.guide.visible(second))
    columns: list[tuple[Picture, ...]] = []
    for frames in shown.values():
        one, two = (frames.straight(number) for number in (first, second))
        moved = to_bytes(np.where(warp.mask[..., None], warp.moved(one), two / 255.0))
        columns.append(
            (*(to_bytes(frames.whole(number)) for number in (first, second)), error_picture(two, moved, 2.0))
        )
    write_png(file, sheet(cropped([list(row) for row in zip(*columns)]), list(shown)))
