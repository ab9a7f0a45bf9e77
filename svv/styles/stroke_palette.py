"""Palettes, of pictures or of a few colours, for painted strokes (:mod:`svv.fields.scene.stroke_edits`)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from svv.core.colour.colour import lab_to_rgb, rgb_to_lab
from svv.errors import BadInput, Progress, silent
from svv.fields.scene.stroke_edits import PALETTE_SIZE, luminance
from svv.styles.gallery import open_style
from svv.styles.hand import measure_hand

Palette = tuple[tuple[float, float, float], ...]
"""Colours from dark to light, RGB in [0, 1]."""

OWN = "own"
"""Word for the colours in which strokes were painted."""

COLOUR = re.compile(r"#[0-9a-fA-F]{6}")


def palette_named(source: str, progress: Progress = silent) -> Palette:
    """Return a palette from its name.

    That is a picture file or ``gallery:NAME``; colours such as ``#102040,#f0d090``, between which strokes get mixtures;
    or ``own`` for the colours in which they were painted, which is an empty palette. Raises BadInput if a colour has
    another form, or the picture cannot be read (:func:`svv.styles.gallery.open_style`).

    >>> len(palette_named("#102040,#f0d090")), palette_named("own")
    (64, ())
    """
    if source == OWN:
        return ()
    words = [word.strip() for word in source.split(",")]
    if source.startswith("#"):
        for word in words:
            if not COLOUR.fullmatch(word):
                raise BadInput(f"'{word}' is not a colour; write the colours as '#rrggbb,#rrggbb'.")
        return mixed([[int(word[k : k + 2], 16) / 255.0 for k in (1, 3, 5)] for word in words])
    file = Path(source)
    return _of_picture(source, file.stat().st_mtime_ns if file.is_file() else 0, progress)


@lru_cache(maxsize=4)
def _of_picture(source: str, _: int, progress: Progress) -> Palette:
    return palette_of(open_style(source, progress)[1])


def palette_of(picture: NDArray[np.floating]) -> Palette:
    """Return a picture's (H, W, 3) stroke colours, as often as they occur, from dark to light, or raise BadInput."""
    hand = measure_hand(picture)
    every = lab_to_rgb(hand.colours[np.argsort(hand.tones, kind="stable")])
    chosen = every[((np.arange(PALETTE_SIZE) + 0.5) * len(every) / PALETTE_SIZE).astype(np.int64)]
    return _sorted(chosen)


def mixed(colours: Sequence[Sequence[float]]) -> Palette:
    """Return a palette of mixtures, in CIELAB, between colours (C, 3) that are neighbours from dark to light."""
    given = np.asarray(_sorted(np.asarray(colours, np.float64)))
    lab = rgb_to_lab(given)
    at = np.linspace(0.0, len(lab) - 1.0, PALETTE_SIZE)
    between = np.stack([np.interp(at, np.arange(len(lab)), column) for column in lab.T], 1)
    return _sorted(lab_to_rgb(between))


def _sorted(colours: NDArray[np.floating]) -> Palette:
    ordered = colours[np.argsort(luminance(colours), kind="stable")]
    return tuple((r, g, b) for r, g, b in ordered.astype(np.float64).tolist())
