"""The page that shows the results of a job: one self-contained HTML file."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from PIL import Image

from svv._version import __version__
from svv.io.files.atomic import atomic_path
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
    movie = base64.b64encode(page.movie.read_bytes()).decode() if page.movie else ""
    text = filled(_TEMPLATE, page=page, movie=movie, embedded=_embedded, version=__version__)
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
    return f"data:image/{kind.lower()};base64,{base64.b64encode(buffer.getvalue()).decode()}"


_TEMPLATE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{{ page.title }}</title>
<style>
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
</style>
</head>
<body><main>
<header><h1>{{ page.title }}</h1><p>{{ page.text }}</p></header>
{% if page.numbers %}<div class="numbers">
{%- for value, name in page.numbers %}<div><b>{{ value }}</b><span>{{ name }}</span></div>{% endfor %}</div>{% endif %}
{% if movie %}<video controls autoplay loop muted playsinline aria-label="{{ page.title }}, seen from all around"
src="data:video/mp4;base64,{{ movie }}"></video>{% endif %}
{% if page.link %}<p class="link"><a href="{{ page.link[0].name | urlencode }}">{{ page.link[1] }}</a></p>{% endif %}
{% for part in page.parts %}<section><h2>{{ part.heading }}</h2><p>{{ part.text }}</p>
{%- if part.columns is defined %}<div class="scroll"><table><thead><tr>
{%- for name in part.columns %}<th>{{ name }}</th>{% endfor %}</tr></thead><tbody>
{%- for row in part.rows %}<tr>
{%- for value in row %}<td>
{%- if loop.index0 in part.swatch and value %}<i style="background:{{ value }}"></i>{% endif %}{{ value }}</td>
{%- endfor %}</tr>{% endfor %}</tbody></table></div>
{%- else %}<img alt="{{ part.heading }}" src="{{ embedded(part) }}">{% endif %}</section>
{% endfor %}
{% if page.facts %}<section><h2>How it was made</h2><dl>
{%- for name, value in page.facts %}<dt>{{ name }}</dt><dd>{{ value }}</dd>{% endfor %}</dl></section>{% endif %}
<footer>Made by svv {{ version }}</footer>
</main></body>
</html>
"""
