"""Families of strokes: a picture's strokes divided into as many parts as are asked for, so that regions can share it.

What the hand of a picture measures as one stroke (:mod:`svv.styles.hand`) has one colour. Strokes are divided by
coherent areas where the picture has some that differ, else by colour (Ward 1963). Letters: N strokes, F families.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial import cKDTree

from svv.core.colour.colour import lab_to_rgb, rgb_to_lab
from svv.core.colour.colour_names import colour_name
from svv.core.colour.colour_vision import oklab
from svv.core.colour.hex_codes import to_hex
from svv.core.images.segmentation import partitions
from svv.options.making import DivisionName
from svv.styles.hand import Hand

LIGHTNESS, HUES = 0.7, 1.6
"""Weights of lightness and of hue and chroma when strokes are told apart by colour, in Oklab."""

CLUSTERED = 1500
"""Number of strokes that are clustered; the others join the nearest of these."""

LEAST_SHARE = 0.03
"""Least share of the strokes that a family has: fewer would be the same stroke again and again."""

SIDE = 300
"""Long side in pixels of the picture that is divided."""

PIECES = 400
"""Approximate number of pieces of it that areas consist of."""

TOGETHER = 4.0
"""Weight of a distance of the picture's long side when a pixel's nearest stroke is found, against colours in Oklab."""

QUANTILES = 12
"""Number of tones at which the colours of two families are compared."""

CONCENTRATED = 0.2
"""How near to one another a family's strokes are from which its place names it."""

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Family:
    """Strokes of a picture that belong together."""

    hand: Hand
    """The hand of the picture."""
    own: Mask
    """Which of its strokes belong to the family. (N,)"""

    @cached_property
    def colours(self) -> Floats:
        """Their colours, CIELAB. (n, 3)"""
        return self.hand.colours[self.own].astype(np.float64)

    @property
    def share(self) -> float:
        """Fraction of the picture's strokes."""
        return float(self.own.mean())

    @property
    def place(self) -> tuple[float, float]:
        """Mean place from the left and from below, in fractions of the picture's width and height."""
        x, y = (self.hand.places[self.own] / self.hand.places.max(0).clip(1e-6)).mean(0).tolist()
        return x, y

    @property
    def together(self) -> float:
        """How near to one another they are: 0 if spread over the picture, towards 1 in one small place."""
        whole, own = (
            float(np.linalg.norm(places - places.mean(0), axis=1).mean())
            for places in (self.hand.places, self.hand.places[self.own])
        )
        return float(np.clip(1.0 - own / max(whole, 1e-9), 0.0, 1.0))

    @cached_property
    def mean(self) -> Floats:
        """Mean colour, CIELAB. (3,)"""
        return np.asarray(self.colours.mean(0))

    @cached_property
    def tones(self) -> Floats:
        """Colours at :data:`QUANTILES` tones from dark to light, CIELAB. (QUANTILES, 3)"""
        order = np.argsort(self.colours[:, 0], kind="stable")
        return np.stack([part.mean(0) for part in np.array_split(self.colours[order], QUANTILES) if len(part)])

    def codes(self) -> list[str]:
        """Return hex codes of up to three of its colours, from dark to light."""
        return [to_hex(lab_to_rgb(part.mean(0))) for part in np.array_split(self.tones, min(3, len(self.tones)))]


def joined(families: Sequence[Family]) -> Family:
    """Return the strokes of several families of one picture as one."""
    return Family(families[0].hand, np.logical_or.reduce([one.own for one in families]))


def divisions(
    picture: NDArray[np.floating], hand: Hand, counts: Sequence[int], ways: Sequence[DivisionName]
) -> list[list[Family]]:
    """Divide a picture (H, W, 3), sRGB in [0, 1], into families of strokes by its hand, or that of a part of it.

    For each way, by coherent ``areas`` or by ``colours``, and each count (>= 1), there are at most as many families,
    the largest first; fewer if the picture has fewer colours.
    """
    found = []
    for way in ways:
        every = _by_area(_reduced(picture), hand, counts) if way == "areas" else _by_colour(hand, counts)
        for own in every:
            own = _without_small(own, hand)
            count = np.bincount(own)
            found.append([Family(hand, own == k) for k in np.argsort(-count, kind="stable") if count[k]])
    return found


def areas_of(picture: NDArray[np.floating], families: Sequence[Family], mask: Mask | None = None) -> list[Mask]:
    """Return the pixels of each family (H, W): those whose nearest stroke of a like colour is the family's.

    The picture (H, W, 3) is sRGB in [0, 1]; a ``mask`` (H, W) is the part that was divided.
    """
    from skimage.transform import resize

    small, hand = _reduced(picture), families[0].hand
    height, width = small.shape[:2]
    places = np.stack(np.meshgrid(np.arange(width), np.arange(height)[::-1]), -1).reshape(-1, 2) / max(height, width)
    pixels = np.concatenate([TOGETHER * places, features_of(rgb_to_lab(small).reshape(-1, 3))], 1)
    own = np.full(len(hand.places), -1)
    for number, one in enumerate(families):
        own[one.own] = number
    strokes = np.concatenate([TOGETHER * hand.places, features_of(hand.colours.astype(np.float64))], 1)
    labels = own[cKDTree(strokes).query(pixels)[1]].reshape(height, width)
    labels = resize(labels, picture.shape[:2], order=0, preserve_range=True, anti_aliasing=False)
    return [(labels == number) & (True if mask is None else mask) for number in range(len(families))]


def features_of(colours: Floats) -> Floats:
    """Return colours, CIELAB (N, 3), as they are told apart: Oklab with more weight on hue than on lightness. (N, 3)"""
    return oklab(lab_to_rgb(colours).astype(np.float64)) * np.array([LIGHTNESS, HUES, HUES])


def _by_colour(hand: Hand, counts: Sequence[int]) -> list[NDArray[np.int64]]:
    """Return the family of each stroke by its colour, for each count. (N,)"""
    features = features_of(hand.colours.astype(np.float64))
    some = features[:: max(len(features) // CLUSTERED, 1)]
    tree, nearest = linkage(some, "ward"), cKDTree(some).query(features)[1]
    return [np.asarray(fcluster(tree, count, "maxclust")[nearest] - 1, np.int64) for count in counts]


def _by_area(picture: Floats, hand: Hand, counts: Sequence[int]) -> list[NDArray[np.int64]]:
    """Return the area of each stroke, of a picture (h, w, 3), for each count. (N,)"""
    (height, width), long = picture.shape[:2], max(picture.shape[:2])
    column = (hand.places[:, 0] * long).astype(np.int64).clip(0, width - 1)
    row = (height - 1 - hand.places[:, 1] * long).astype(np.int64).clip(0, height - 1)
    return [labels[row, column] for labels in partitions(picture, counts, PIECES)]


def _without_small(own: NDArray[np.int64], hand: Hand) -> NDArray[np.int64]:
    """Return families (N,) without those that have too few strokes, which join the nearest by colour."""
    features = features_of(hand.colours.astype(np.float64))
    while True:
        count = np.bincount(own)
        there = np.flatnonzero(count)
        if len(there) == 1:
            return own
        least = there[count[there].argmin()]
        if count[least] >= LEAST_SHARE * len(own):
            return own
        means = np.stack([features[own == k].mean(0) for k in there])
        away = np.linalg.norm(means - features[own == least].mean(0), axis=1)
        away[there == least] = np.inf
        own = np.where(own == least, there[away.argmin()], own)


def _reduced(picture: NDArray[np.floating]) -> Floats:
    """Return a picture with a long side of at most :data:`SIDE`. (h, w, 3)"""
    from skimage.transform import resize

    factor = min(1.0, SIDE / max(picture.shape[:2]))
    size = [max(round(side * factor), 1) for side in picture.shape[:2]]
    return np.asarray(resize(np.asarray(picture, np.float64), size, anti_aliasing=factor < 1.0).clip(0.0, 1.0))


def names_of(families: Sequence[Family]) -> list[list[str]]:
    """Return each family's names: first a colour, unlike other families' first names, then its place if it has one."""
    every = []
    for one in families:
        words = [colour_name(one.mean)]
        if one.together > CONCENTRATED:
            x, y = one.place
            words += ["top", "sky"] if y > 0.6 else ["bottom", "ground"] if y < 0.4 else []
            words += ["right"] if x > 0.6 else ["left"] if x < 0.4 else []
        every.append(words)
    firsts = [words[0] for words in every]
    for number, words in enumerate(every):
        same = [k for k, first in enumerate(firsts) if first == words[0]]
        if len(same) > 1:  # from light to dark, they are numbered
            order = sorted(same, key=lambda k: -float(families[k].mean[0]))
            words.insert(0, f"{firsts[number]}-{order.index(number) + 1}")
    return every
