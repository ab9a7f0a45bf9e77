"""Colours by their English names: CSS's, and those of the survey of xkcd.com, with words such as pale and deep."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from importlib.resources import files

import numpy as np
from PIL import ImageColor

from svv.core.colour.colour_vision import from_oklab, oklab

Colour = tuple[float, float, float]

MODIFIERS = {
    "pale": (0.5, 0.55, 1.0),
    "light": (0.35, 0.8, 1.0),
    "lighter": (0.25, 0.9, 1.0),
    "brighter": (0.2, 1.1, 1.0),
    "bright": (0.1, 1.35, 1.0),
    "vivid": (0.0, 1.5, 1.0),
    "deep": (0.0, 1.1, 0.75),
    "dark": (0.0, 0.95, 0.6),
    "darker": (0.0, 1.0, 0.75),
    "dull": (0.0, 0.4, 1.0),
    "muted": (0.0, 0.5, 1.0),
}
"""Word before the name of a colour -> how far towards white, and factors on its chroma and lightness, in Oklab."""


@cache
def names() -> dict[str, Colour]:
    """Return the colours by name, in small letters; where CSS and xkcd differ, CSS's."""
    found: dict[str, Colour] = {}
    for line in files("svv.job.words").joinpath("xkcd.txt").read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            digits, name = line.split(" ", 1)
            found[name] = _of(int(digits, 16))
    css = {name: code for name, code in ImageColor.colormap.items() if isinstance(code, str)}
    return found | {name: _of(int(code.removeprefix("#"), 16)) for name, code in css.items()}


def _of(value: int) -> Colour:
    return (value >> 16) / 255, (value >> 8 & 255) / 255, (value & 255) / 255


def changed(colour: Sequence[float], modifier: str) -> Colour:
    """Return a colour, RGB in [0, 1], as a word of :data:`MODIFIERS` changes it.

    >>> [round(c, 2) for c in changed((0.0, 0.0, 0.0), "dark")]
    [0.0, 0.0, 0.0]
    """
    towards_white, chroma, darker = MODIFIERS[modifier]
    light, *hue = oklab(np.asarray(colour, np.float64)) * (darker, chroma, chroma)
    r, g, b = (float(c) for c in np.clip(from_oklab(np.array([light + towards_white * (1.0 - light), *hue])), 0.0, 1.0))
    return r, g, b


def colour_at(words: Sequence[str], start: int) -> tuple[Colour, int] | None:
    """Return the colour that begins at a word, and the number of its words; None if none does.

    A whole name, such as "pale blue", comes before the same name with its first word as a modifier.
    """
    known, very = names(), False
    for count in range(min(4, len(words) - start), 0, -1):
        text = " ".join(words[start : start + count])
        if text in known and text not in MODIFIERS:  # xkcd has colours called "pale" and "dark"
            return known[text], count
    if words[start] == "very" and start + 1 < len(words):
        very, start = True, start + 1
    if words[start] in MODIFIERS and start + 1 < len(words):
        inner = colour_at(words, start + 1)
        if inner is not None:
            colour = changed(inner[0], words[start])
            return (changed(colour, words[start]) if very else colour), inner[1] + 1 + very
    text = words[start]
    if len(text) == 7 and text[0] == "#" and all(c in "0123456789abcdef" for c in text[1:]):
        return _of(int(text[1:], 16)), 1
    return None
