"""The text of a figure: fonts that have its characters, its size on the page, and lines that fit."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from matplotlib import font_manager, rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.ft2font import FT2Font

from svv.errors import BadInput

OWN_FONT = "DejaVu Sans"
"""The font that comes with matplotlib, so that figures look alike on all machines."""

NOT_FONTS = ("Last Resort",)
"""Starts of the names of fonts that show boxes instead of characters."""

LINE = 1.25
"""Distance of lines in font sizes."""

MEASURED = 720.0
"""Pixels per inch at which text is measured."""

MM_A_POINT = 25.4 / 72.0


@dataclass(frozen=True)
class Lettering:
    """Fonts, in the order in which characters are looked for, and size and colour of the text."""

    families: tuple[str, ...]
    points: float
    ink: str

    @property
    def line(self) -> float:
        """Distance of lines in mm."""
        return LINE * self.points * MM_A_POINT

    def properties(self, bold: bool = False) -> dict[str, Any]:
        """Return keyword arguments of matplotlib's texts; a ``$`` is a dollar sign."""
        weight = "bold" if bold else "normal"
        font = FontProperties(family=list(self.families), weight=weight, size=self.points)
        return {"fontproperties": font, "color": self.ink, "parse_math": False}

    def width(self, text: str, bold: bool = False) -> float:
        """Return the width of a line of text in mm."""
        if not text:
            return 0.0
        return _width(text, self.families, self.points, bold)

    def wrapped(self, text: str, width: float) -> list[str]:
        """Return a text as lines of at most ``width`` mm, broken at blanks, and within words that are longer."""
        lines: list[str] = []
        for word in text.split():
            joined = f"{lines[-1]} {word}" if lines else word
            if lines and self.width(joined) <= width:
                lines[-1] = joined
                continue
            lines.append(word)
            while self.width(lines[-1]) > width and len(lines[-1]) > 1:
                last, fits = lines[-1], len(lines[-1]) - 1
                while fits > 1 and self.width(last[:fits]) > width:
                    fits -= 1
                lines[-1:] = [last[:fits], last[fits:]]
        return lines


def families_for(texts: Iterable[str], font: str | None) -> tuple[str, ...]:
    """Return fonts for all characters, the chosen one first.

    Raises BadInput if it, or one for a character, is missing.
    """
    families = [OWN_FONT] if font is None else [_installed(font), OWN_FONT]
    installed = dict.fromkeys(entry.name for entry in font_manager.fontManager.ttflist)
    others = [name for name in installed if not name.startswith(NOT_FONTS)]
    for text in texts:
        for character in text:
            if unicodedata.category(character) == "Cf" or any(ord(character) in _characters(f) for f in families):
                continue
            other = next((f for f in others if ord(character) in _characters(f)), None)
            if other is None:
                raise BadInput(
                    f"No installed font has the character '{character}' (U+{ord(character):04X}) of '{text}': install "
                    "one that has it, such as Noto, or use other characters."
                )
            families.append(other)
    return tuple(dict.fromkeys(families))


def font_file(family: str, bold: bool = False) -> Path:
    """Return the file of an installed font."""
    wanted = FontProperties(family=[family], weight="bold" if bold else "normal")
    return Path(font_manager.findfont(wanted, fallback_to_default=False))


def _installed(font: str) -> str:
    """Return the name of an installed font as it is spelled there."""
    known = {entry.name.lower(): entry.name for entry in font_manager.fontManager.ttflist}
    if font.strip().lower() not in known:
        few = [name for name in ("Arial", "Helvetica", "Liberation Sans", OWN_FONT) if name.lower() in known]
        raise BadInput(f"There is no font '{font}' on this machine: leave it out, or name one of {', '.join(few)}.")
    return known[font.strip().lower()]


@cache
def _width(text: str, families: tuple[str, ...], points: float, bold: bool) -> float:
    """Return the width of a line of text in mm, measured at a resolution at which rounding does not matter."""
    canvas = FigureCanvasAgg(Figure((0.1, 0.1), dpi=MEASURED))
    one = canvas.figure.text(0, 0, text, **Lettering(families, points, "black").properties(bold))
    return float(one.get_window_extent(canvas.get_renderer()).width) / MEASURED * 25.4


@cache
def _characters(family: str) -> frozenset[int]:
    """Return the code points of a font; none if it cannot be used."""
    try:
        return frozenset(FT2Font(str(font_file(family))).get_charmap())
    except (ValueError, RuntimeError, OSError):  # not installed, or a kind of font that cannot be embedded
        return frozenset()


def as_text() -> AbstractContextManager[None]:
    """Return a context in which matplotlib writes text as text, with its fonts, and the same file each time."""
    return rc_context({"svg.fonttype": "none", "pdf.fonttype": 42, "svg.hashsalt": "svv", "axes.unicode_minus": True})
