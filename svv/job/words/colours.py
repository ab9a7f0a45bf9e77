"""Colours by their English names: CSS's, and those of the survey of xkcd.com, with words such as pale and deep."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from importlib.resources import files

import numpy as np
from PIL import ImageColor

from svv.core.colour.colour_vision import from_oklab, oklab

Colour = tuple[float, float, float]


def _moved(towards_white: float, chroma: float, darker: float = 1.0) -> Callable[[np.ndarray], np.ndarray]:
    """Return a change of a colour in Oklab: towards white, more or less colourful, and darker."""

    def change(lab: np.ndarray) -> np.ndarray:
        light = lab[0] * darker
        return np.array([light + towards_white * (1.0 - light), chroma * lab[1], chroma * lab[2]])

    return change


MODIFIERS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "pale": _moved(0.5, 0.55),
    "light": _moved(0.35, 0.8),
    "lighter": _moved(0.25, 0.9),
    "brighter": _moved(0.2, 1.1),
    "bright": _moved(0.1, 1.35),
    "vivid": _moved(0.0, 1.5),
    "deep": _moved(0.0, 1.1, 0.75),
    "dark": _moved(0.0, 0.95, 0.6),
    "darker": _moved(0.0, 1.0, 0.75),
    "dull": _moved(0.0, 0.4),
    "muted": _moved(0.0, 0.5),
}
"""Word before the name of a colour -> what it changes."""


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
    lab = MODIFIERS[modifier](oklab(np.asarray(colour, np.float64)))
    r, g, b = (float(c) for c in np.clip(from_oklab(lab), 0.0, 1.0))
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
