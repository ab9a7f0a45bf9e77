"""Files of figures: PDF and SVG with text as text and its fonts inside, PNG and TIFF at their resolution."""

from __future__ import annotations

import base64
import io
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from svv.errors import BadInput
from svv.io.files.atomic import atomic_path, check_writable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KINDS = (".pdf", ".svg", ".png", ".tif", ".tiff")
"""Extensions of files that a figure can be written to."""

TOLD = "svv:regions"
"""Name of the text of a PNG that tells the colours of the regions; a TIFF has it as its description."""

PIXELATED = re.compile(r"image-rendering: ?(crisp-edges|pixelated);?")
"""What matplotlib says of pictures that are not interpolated."""

DESCRIPTION, XRES, YRES, UNIT = 270, 282, 283, 296
"""Tags of TIFF."""


def check_kind(path: str | Path) -> Path:
    """Return the path of a figure; raises BadInput if it cannot be written, or has no known extension."""
    file = Path(path)
    if file.suffix.lower() not in KINDS:
        raise BadInput(f"Cannot tell what to write to {file}: name a figure .pdf, .svg, .png or .tiff.")
    check_writable(file)
    return file


def write_figure(figure: Figure, path: str | Path, told: str = "") -> None:
    """Write a :func:`svv.render.figures.figure.figure` as .pdf, .svg, .png, .tif or .tiff, whole or not at all.

    Its resolution is kept. Its label is the title of an SVG, the subject of a PDF, and the description of a PNG: by
    default what it shows, in words. ``told`` is what a PNG or TIFF tells of the colours of its regions, for
    :func:`read_region_metadata`. Raises BadInput if the extension is not known, or the file cannot be written.
    """
    from svv.render.figures.lettering import as_text

    file, alt = check_kind(path), str(figure.get_label())
    kind = file.suffix.lower()
    with as_text():
        if kind == ".pdf":
            content = _saved(figure, "pdf", {"CreationDate": None, "ModDate": None, "Creator": "svv", "Subject": alt})
        elif kind == ".svg":
            content = _with_fonts(
                _saved(figure, "svg", {"Date": None, "Creator": "svv", "Title": alt}).decode(), figure
            ).encode()
        else:
            content = _raster(figure, kind, told, alt)
    with atomic_path(file) as temporary:
        temporary.write_bytes(content)


def pixels_of(figure: Figure) -> NDArray[np.uint8]:
    """Return a figure as a picture at its resolution: straight RGBA where it is transparent, otherwise RGB."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())
    return pixels.copy() if figure.patch.get_alpha() == 0.0 else pixels[..., :3].copy()


def read_region_metadata(picture: Image.Image) -> str:
    """Return what a PNG or TIFF tells of its regions; empty if nothing."""
    text = picture.info.get(TOLD, "")
    if not text and hasattr(picture, "tag_v2"):
        text = picture.tag_v2.get(DESCRIPTION, "")
    return text if isinstance(text, str) and text.startswith("{") else ""


def _saved(figure: Figure, kind: str, metadata: Mapping[str, object]) -> bytes:
    stream = io.BytesIO()
    figure.savefig(stream, format=kind, metadata=metadata, dpi=figure.dpi)
    return stream.getvalue()


def _raster(figure: Figure, kind: str, told: str, alt: str) -> bytes:
    stream, dpi = io.BytesIO(), float(figure.dpi)
    picture = Image.fromarray(pixels_of(figure))
    if kind == ".png":
        text = PngInfo()
        if alt:
            text.add_itxt("Description", alt)
        if told:
            text.add_text(TOLD, told)
        picture.save(stream, format="PNG", dpi=(dpi, dpi), pnginfo=text)
    else:
        tags = {XRES: dpi, YRES: dpi, UNIT: 2, **({DESCRIPTION: told} if told else {})}
        picture.save(stream, format="TIFF", compression="tiff_lzw", tiffinfo=tags)
    return stream.getvalue()


def _with_fonts(svg: str, figure: Figure) -> str:
    """Return an SVG with the characters of its fonts inside, so that it looks alike where they are not installed."""
    used: dict[tuple[str, bool], set[str]] = {}
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        if text.get_text():
            for family in text.get_fontfamily():
                bold = text.get_fontweight() == "bold"
                used.setdefault((family, bold), set()).update(text.get_text())
    rules = [_font_face(family, bold, characters) for (family, bold), characters in sorted(used.items())]
    start = svg.index("<defs>") if "<defs>" in svg else svg.index(">", svg.index("<svg")) + 1
    # Lines take their direction from their first letters, as matplotlib draws them; pictures have no visible pixels.
    rules.append("text{unicode-bidi:plaintext}")
    return PIXELATED.sub("", f"{svg[:start]}<style>{escape(''.join(rules))}</style>{svg[start:]}")


def _font_face(family: str, bold: bool, characters: Iterable[str]) -> str:
    """Return CSS that brings the given characters of a font, as WOFF."""
    from fontTools import subset
    from fontTools.ttLib import TTFont

    from svv.render.figures.lettering import font_file

    # .ttc files hold several fonts, of which matplotlib uses the first
    font = TTFont(font_file(family, bold), fontNumber=0, recalcTimestamp=False)
    options = subset.Options(layout_features=["*"], notdef_outline=True, drop_tables=["FFTM"])
    cut = subset.Subsetter(options)
    cut.populate(text="".join(characters))
    cut.subset(font)
    font.flavor = "woff"
    stream = io.BytesIO()
    font.save(stream)
    data = base64.b64encode(stream.getvalue()).decode()
    weight = "bold" if bold else "normal"
    return f"@font-face{{font-family:'{family}';font-weight:{weight};src:url(data:font/woff;base64,{data})}}"
