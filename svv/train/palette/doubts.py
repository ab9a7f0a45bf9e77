"""What a user is told of regions that views alone do not tell well, and how to mend them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from svv.core.colour.hex_codes import to_hex
from svv.core.interval_text import interval_text
from svv.core.volumes.classified import MOST_RANGES, ValueRange

SURE = 0.7
"""Confidence below which a region is said to be doubtful."""


@dataclass(frozen=True)
class Question:
    """Which of two regions a place belongs to: the one where most light of a doubtful region is told both ways."""

    region: int
    """The doubtful region."""
    other: int
    """The one that single views tell instead of it, or it instead of that."""
    place: tuple[float, float, float]
    """The place, in world units."""


def doubts(
    colours: NDArray[np.floating], confidence: Sequence[float], questions: Sequence[Question] = ()
) -> list[str]:  # fmt: skip
    """Return a sentence for each region, of a colour (P, 3), whose confidence is below :data:`SURE`, and what to do."""
    asked = {question.region: question for question in questions}
    return [
        f"Region {number} ({to_hex(colour)}) may be wrong: it overlaps what it stands for by about {sure:.0%} only. "
        + (_ask(asked[number], colours) if number in asked else "Look at it (svv render --what region), and correct it "
           "with svv palette if need be.")
        for number, (colour, sure) in enumerate(zip(colours, confidence))
        if sure < SURE
    ]  # fmt: skip


def _ask(question: Question, colours: NDArray[np.floating]) -> str:
    """Return what to point at to tell two regions apart."""
    place, other = ",".join(f"{value:.4g}" for value in question.place), question.other
    return (
        f"It is confused with region {other} ({to_hex(colours[other])}): look at both (svv render --what region), and "
        f"say which of them {place} belongs to: svv palette --point {place}={question.region}, or ={other}."
    )


def hues_within(mixed: Sequence[tuple[int, NDArray[np.floating]]]) -> list[str]:
    """Return a sentence for each region that holds a light of another hue than its own, RGB >= 0. (3,)"""
    return [
        f"Region {number} holds more than one hue, and there are as many regions as there can be. Merge two others "
        f"(svv palette --merge), then split it with svv palette --add '{to_hex(light / light.max())}'."
        for number, light in mixed
    ]


def joined_ranges(mixed: Sequence[ValueRange], regions: Sequence[Sequence[tuple[float, float]]]) -> list[str]:
    """Return a sentence for each range of several colours, given the ranges of each region in scalar values."""
    return [
        f"Region {number} shows the values from {interval_text(one.low, one.high)} in several colours, because a "
        f"transfer function has at most {MOST_RANGES} regions: give svv views several with --tf, each for a part of "
        "the values, which become one scene."
        for one in mixed
        for number, own in enumerate(regions)
        if (one.low, one.high) in own
    ]
