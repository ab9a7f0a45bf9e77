"""``svv bench consistency`` of a folder of frames; see :mod:`svv_bench.cli.styles`."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from svv.cli.options import parse_whole
from svv.errors import BadInput
from svv.options.described import Setting
from svv.progress import shown

if TYPE_CHECKING:
    from svv_bench.frames.result import FolderJob

FRAME_MODES = "frame-by-frame,video,adain"
"""Default of ``--modes``."""
ESTIMATORS = ("tvl1", "ilk")
"""Flows that are estimated from pictures."""


@dataclass(frozen=True)
class OfFrames:
    """What is measured of a folder of frames."""

    guide: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Unstyled frames of the same numbers, from which the flow is estimated."),
    ] = None
    motion: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Flow from each frame to the next (.flo, .npy), or depths (.npy) and transforms.json.",
        ),
    ] = None
    style: Annotated[
        str | None,
        typer.Option(
            metavar="IMG|gallery:NAME", help="Also paint the frames in this style by other methods, and measure those."
        ),
    ] = None
    modes: Annotated[
        str, typer.Option(metavar="A,B", help=f"Methods for --style: {FRAME_MODES.replace(',', ', ')}.")
    ] = FRAME_MODES
    steps: Annotated[int, Setting(least=1)] = 84
    """Optimisation steps per frame, for --style."""
    features: Annotated[str, Setting(metavar="auto|embedded|vgg16|FILE")] = "auto"
    """Features that the methods of --style match; auto uses VGG-16 if its weights are available."""

    def job(self, intervals: str, every: int, flows: str, out: Path) -> FolderJob:
        """Return the settings in the form that the layers below take."""
        from svv.render.gallery import style_file
        from svv_bench.frames.measure import Compared
        from svv_bench.frames.painted import Painting
        from svv_bench.frames.result import FolderJob

        painting = Painting(words(self.modes), self.steps, self.features)
        compared = Compared(parse_whole(intervals, "--intervals", 1), every)
        style = None if self.style is None else style_file(self.style, out)
        return FolderJob(compared, words(flows), self.guide, self.motion, style, painting)


def words(text: str) -> tuple[str, ...]:
    """Return the words between commas, each once."""
    return tuple(dict.fromkeys(part.strip() for part in text.split(",")))


def changed(options: object) -> list[str]:
    """Return the names of the options of a dataclass that differ from their defaults."""
    return [f"--{f.name.replace('_', '-')}" for f in fields(options) if getattr(options, f.name) != f.default]  # type: ignore[arg-type]


def estimators(flows: str, given: bool) -> str:
    """Return the estimators among the names of flows; of the default, those that need no scene.

    Raises:
        BadInput: A name is unknown, or the depth is asked for, which only a scene has.
    """
    names = [name for name in words(flows) if name != "depth"]
    for name in names:
        if name not in ESTIMATORS:
            raise BadInput(f"--flows has no '{name}'; choose from {', '.join(ESTIMATORS)}, separated by commas.")
    if not names and not given:
        raise BadInput("Frames have no depth: choose --flows tvl1 or ilk, or give depths and cameras with --motion.")
    return ",".join(names)


def check_scene(path: Path, options: OfFrames) -> None:
    """Raise BadInput if options of folders are given for a scene, or a picture or movie in its place."""
    from svv_bench.frames.sequence import MOVIES, PICTURES

    if path.suffix.lower() in (*PICTURES, *MOVIES):
        raise BadInput(
            f"{path} is a picture or a movie: give a scene, or a folder of frames, into which ffmpeg -i MOVIE "
            "FOLDER/%04d.png takes a movie apart."
        )
    if own := changed(options):
        raise BadInput(f"{' and '.join(own)}: only for folders of frames, and {path} is not a folder.")


def measure_folder(
    folder: Path, out: Path, of: OfFrames, intervals: str, every: int, flows: str, json: Path | None
) -> None:
    """Measure a folder of frames, write the results and print the table."""
    from svv.io.files.atomic import check_writable, write_json
    from svv_bench.frames.result import folder_consistency, write_result

    if json is not None:
        check_writable(json)
    job = of.job(intervals, every, estimators(flows, of.motion is not None), out)
    with shown("Consistency") as progress:
        found = folder_consistency(folder, out, job, progress)
    print(write_result(out, found), end="")
    if json is not None:
        write_json(json, found)
