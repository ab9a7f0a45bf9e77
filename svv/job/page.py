"""The page that shows the results of a job: one self-contained HTML file."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path

from PIL import Image

from svv._version import __version__
from svv.io.files.atomic import atomic_path
from svv.io.pictures.picture_data import as_text
from svv.progress import duration
from svv.render.web.html import filled

JPEG_QUALITY = 90


@dataclass(frozen=True)
class Picture:
    """A picture on the page, with its heading and one sentence about it.

    A ``drawing``, with few colours and sharp edges, is stored losslessly; other pictures are compressed.
    """

    heading: str
    text: str
    file: Path
    drawing: bool = False


@dataclass(frozen=True)
class Table:
    """A table on the page; cells are shown verbatim and right-aligned except in the first column.

    ``text`` is one sentence about it; ``swatch`` are the columns whose cells are colours ``#rrggbb``, shown as such.
    """

    heading: str
    text: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    swatch: Sequence[int] = ()


@dataclass(frozen=True)
class Page:
    """Content of the page, in order, but that the link follows the movie.

    ``text`` is one sentence, ``numbers`` are (value, meaning) of the few figures that matter most, ``movie`` is an MP4
    file, ``facts`` are (name, value) of the conditions of the run, and ``link`` is a file beside the page with the
    link's text.
    """

    title: str
    text: str
    numbers: Sequence[tuple[str, str]]
    movie: Path | None
    parts: Sequence[Picture | Table]
    facts: Sequence[tuple[str, str]] = field(default=())
    link: tuple[Path, str] | None = None


def write_page(path: Path, page: Page) -> None:
    """Write the page atomically; raises BadInput if the file cannot be written."""
    movie = base64.b64encode(page.movie.read_bytes()).decode() if page.movie else ""
    template = files("svv.job").joinpath("page.html").read_text(encoding="utf-8")
    text = filled(template, page=page, movie=movie, embedded=_embedded, version=__version__)
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def cost_table(costs: Sequence[dict[str, object]]) -> Table:
    """Build the table of time and peak memory of a job's stages (see :attr:`svv.job.stages.Stages.costs`)."""
    seconds = [float(str(cost["seconds"])) for cost in costs]
    memory = [int(str(cost["peak_rss_bytes"])) for cost in costs]
    rows = [
        [str(cost["title"]), duration(s) if s >= 10 else f"{s:.1f} s", f"{m / 1e9:.2f} GB"]
        for cost, s, m in zip(costs, seconds, memory, strict=True)
    ]
    rows.append(["Total", duration(sum(seconds)), f"{max(memory, default=0) / 1e9:.2f} GB"])
    text = "Wall-clock time and peak resident memory of each stage."
    return Table("Time and memory", text, ("Stage", "Time", "Peak memory"), rows)


def _embedded(picture: Picture) -> str:
    """Return the address of a picture that carries it."""
    buffer = io.BytesIO()
    kind = "PNG" if picture.drawing else "JPEG"
    with Image.open(picture.file) as image:
        image.convert("RGB").save(buffer, format=kind, quality=JPEG_QUALITY)
    return as_text(buffer.getvalue())
