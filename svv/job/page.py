"""The page that shows the results of a job: one self-contained HTML file."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from urllib.parse import quote

from PIL import Image

from svv._version import __version__
from svv.io.files.atomic import atomic_path
from svv.progress import duration

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

    Args:
        heading: Heading of the table.
        text: One sentence about the table.
        columns: Names of the columns.
        rows: One cell per column.
        swatch: Indices of columns whose cells are colours ``#rrggbb``, shown as such.
    """

    heading: str
    text: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    swatch: Sequence[int] = ()


@dataclass(frozen=True)
class Page:
    """Content of the page, in order.

    Args:
        title: Heading of the page.
        text: One sentence below the heading.
        numbers: (value, meaning) of the few figures that matter most.
        movie: An MP4 file, shown first.
        parts: Pictures and tables.
        facts: (name, value) of the conditions of the run, shown at the end.
        link: A file beside the page, and the text of the link to it, shown after the movie.
    """

    title: str
    text: str
    numbers: Sequence[tuple[str, str]]
    movie: Path | None
    parts: Sequence[Picture | Table]
    facts: Sequence[tuple[str, str]] = field(default=())
    link: tuple[Path, str] | None = None


def write_page(path: Path, page: Page) -> None:
    """Write the page atomically.

    Raises:
        BadInput: The file cannot be written (see :func:`svv.io.files.atomic.atomic_path`).
    """
    body = [
        f"<header><h1>{escape(page.title)}</h1><p>{escape(page.text)}</p></header>",
        _numbers(page.numbers),
        _movie(page.movie, page.title) if page.movie else "",
        _link(*page.link) if page.link else "",
        *(_picture(part) if isinstance(part, Picture) else _table(part) for part in page.parts),
        _facts(page.facts),
        f"<footer>Made by svv {escape(__version__)}</footer>",
    ]
    text = _FRAME.format(title=escape(page.title), style=_STYLE, body="\n".join(body))
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


def _numbers(numbers: Sequence[tuple[str, str]]) -> str:
    cards = "".join(f"<div><b>{escape(value)}</b><span>{escape(name)}</span></div>" for value, name in numbers)
    return f'<div class="numbers">{cards}</div>' if cards else ""


def _movie(file: Path, title: str) -> str:
    data = base64.b64encode(file.read_bytes()).decode()
    label = escape(f"{title}, seen from all around")
    source = f"data:video/mp4;base64,{data}"
    return f'<video controls autoplay loop muted playsinline aria-label="{label}" src="{source}"></video>'


def _link(file: Path, text: str) -> str:
    return f'<p class="link"><a href="{escape(quote(file.name))}">{escape(text)}</a></p>'


def _picture(picture: Picture) -> str:
    buffer = io.BytesIO()
    kind = "PNG" if picture.drawing else "JPEG"
    with Image.open(picture.file) as image:
        image.convert("RGB").save(buffer, format=kind, quality=JPEG_QUALITY)
    data = base64.b64encode(buffer.getvalue()).decode()
    return (
        f"<section><h2>{escape(picture.heading)}</h2><p>{escape(picture.text)}</p>"
        f'<img alt="{escape(picture.heading)}" src="data:image/{kind.lower()};base64,{data}"></section>'
    )


def _table(table: Table) -> str:
    def cell(index: int, value: str) -> str:
        mark = f'<i style="background:{escape(value)}"></i>' if index in table.swatch and value else ""
        return f"<td>{mark}{escape(value)}</td>"

    head = "".join(f"<th>{escape(name)}</th>" for name in table.columns)
    rows = "".join(f"<tr>{''.join(cell(i, v) for i, v in enumerate(row))}</tr>" for row in table.rows)
    return (
        f"<section><h2>{escape(table.heading)}</h2><p>{escape(table.text)}</p>"
        f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div></section>'
    )


def _facts(facts: Sequence[tuple[str, str]]) -> str:
    rows = "".join(f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>" for name, value in facts)
    return f"<section><h2>How it was made</h2><dl>{rows}</dl></section>" if rows else ""


_FRAME = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>{style}</style>
</head>
<body><main>
{body}
</main></body>
</html>
"""

_STYLE = """
:root { --ink: #1d2733; --soft: #5c6977; --line: #e3e8ee; --accent: #0f5c8c; --paper: #fff; --ground: #f4f6f8 }
* { box-sizing: border-box }
body { margin: 0; background: var(--ground); color: var(--ink);
  font: 16px/1.55 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif }
main { max-width: 1120px; margin: 0 auto; padding: 48px 24px 64px }
h1 { font-size: 34px; line-height: 1.2; letter-spacing: -.01em; margin: 0 0 8px }
header p { font-size: 18px; color: var(--soft); margin: 0 0 28px; max-width: 70ch }
h2 { font-size: 20px; margin: 0 0 4px }
section { background: var(--paper); border: 1px solid var(--line); border-radius: 10px; padding: 24px;
  margin-top: 24px }
section > p { color: var(--soft); margin: 0 0 16px; max-width: 80ch }
img, video { display: block; max-width: 100%; height: auto; margin: 0 auto; border-radius: 6px }
video { width: 100%; background: #fff; border: 1px solid var(--line); border-radius: 10px }
.numbers { display: grid; grid-template-columns: repeat(auto-fit, minmax(158px, 1fr)); gap: 12px; margin-bottom: 24px }
.numbers div { background: var(--paper); border: 1px solid var(--line); border-radius: 10px; padding: 14px 18px }
.numbers b { display: block; font-size: 22px; font-weight: 650; white-space: nowrap; color: var(--accent);
  font-variant-numeric: tabular-nums }
.numbers span { color: var(--soft); font-size: 14px }
.link { margin: 16px 0 0 }
.link a { color: var(--accent); font-weight: 600 }
.scroll { overflow-x: auto }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums }
th { text-align: right; font-weight: 600; color: var(--soft); font-size: 14px }
td { text-align: right }
th, td { padding: 8px 12px; border-bottom: 1px solid var(--line); white-space: nowrap }
th:first-child, td:first-child { text-align: left; padding-left: 0 }
tbody tr:last-child td { border-bottom: 0 }
td i { display: inline-block; width: 1.1em; height: 1.1em; margin-right: .5em; vertical-align: -.2em;
  border-radius: 4px; border: 1px solid rgba(0, 0, 0, .15) }
dl { display: grid; grid-template-columns: max-content 1fr; gap: 6px 20px; margin: 12px 0 0 }
dt { color: var(--soft) }
dd { margin: 0; overflow-wrap: anywhere }
footer { color: var(--soft); font-size: 14px; margin-top: 24px }
@media (max-width: 640px) { main { padding: 24px 12px } dl { grid-template-columns: 1fr } dd { margin-bottom: 8px } }
"""
