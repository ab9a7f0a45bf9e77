"""Palettes corrected by hand: the effect on their colours, and on the transfer function's ranges that these show."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from svv.core.colour.correction import Correction, Entry, corrected
from svv.core.volumes.classified import ValueRange
from svv.errors import BadInput

RED, GREEN, BLUE, GOLD = (0.9, 0.1, 0.1), (0.2, 0.8, 0.2), (0.1, 0.2, 0.9), (0.9, 0.7, 0.1)
SEEN = [Entry(RED, 0.5), Entry(GREEN, 0.3), Entry(BLUE, 0.2)]
"""A palette that was found in views."""
RANGES = [ValueRange(k, k + 0.5, colour) for k, colour in enumerate((RED, GREEN, BLUE, GOLD))]
KNOWN = [Entry(RED, 0.6, ranges=(0,)), Entry(GREEN, 0.3, ranges=(1, 3)), Entry(BLUE, 0.1, ranges=(2,))]
"""One of four ranges, of which the second and the last are one region."""


def colours(entries: tuple[Entry, ...]) -> list[tuple[float, float, float]]:
    return [entry.colour for entry in entries]


def test_colours_are_added_removed_and_set() -> None:
    found, said = corrected(SEEN, Correction(remove=(1,), colours={2: GREEN}, add=(GOLD,)))
    assert colours(found) == [RED, GREEN, GOLD]
    assert [entry.origin for entry in found] == [(0,), (2,), ()]
    assert len(said) == 3


def test_merged_colours_are_their_mean_by_share() -> None:
    found, _ = corrected(SEEN, Correction(merge=((2, 0),)))
    np.testing.assert_allclose(found[0].colour, (np.array(RED) * 0.5 + np.array(BLUE) * 0.2) / 0.7)
    assert colours(found)[1:] == [GREEN]
    assert found[0].origin == (0, 2)
    named, _ = corrected(SEEN, Correction(merge=((2, 0),), colours={2: GOLD}))
    assert colours(named) == [GOLD, GREEN]


def test_merged_ranges_are_of_the_merged_region() -> None:
    found, _ = corrected(KNOWN, Correction(merge=((0, 1),)), RANGES)
    assert [entry.ranges for entry in found] == [(0, 1, 3), (2,)]


def test_a_removed_regions_ranges_go_to_the_neighbour_in_value() -> None:
    found, _ = corrected(KNOWN, Correction(remove=(1,)), RANGES)
    assert [entry.ranges for entry in found] == [(0, 1), (2, 3)]


def test_a_region_of_several_ranges_is_split_into_them() -> None:
    found, _ = corrected(KNOWN, Correction(split=(1,)), RANGES)
    assert [(entry.colour, entry.ranges) for entry in found] == [(RED, (0,)), (GREEN, (1,)), (GOLD, (3,)), (BLUE, (2,))]
    assert [entry.origin for entry in found] == [(0,), (1,), (1,), (2,)]


def test_an_added_colour_takes_its_range_from_a_region_that_has_others() -> None:
    found, said = corrected(KNOWN, Correction(add=((0.85, 0.7, 0.2),)), RANGES)
    assert [entry.ranges for entry in found] == [(0,), (1,), (2,), (3,)]
    assert "it is the range from 3 to 3.5" in said[0]


def test_an_added_colour_shares_a_range_that_is_a_region() -> None:
    found, said = corrected(KNOWN, Correction(add=((0.9, 0.3, 0.1),)), RANGES)
    assert [entry.ranges for entry in found] == [(0,), (1, 3), (2,), (0,)]
    assert "it shares the range from 0 to 0.5" in said[0]


@given(st.data())
def test_every_range_stays_somebodys(data: st.DataObject) -> None:
    """Whatever is corrected, each range is of at least one region, and each region of at least one range."""
    count = data.draw(st.integers(2, 8))
    owner = data.draw(st.permutations([*range(count), *data.draw(st.lists(st.integers(0, count - 1), max_size=4))]))
    rng = np.random.default_rng(data.draw(st.integers(0, 2**31)))
    ranges = [ValueRange(k, k + 0.5, tuple(rng.random(3))) for k in range(len(owner))]
    palette = [
        Entry(tuple(rng.random(3)), float(rng.random()), ranges=tuple(r for r, k in enumerate(owner) if k == number))
        for number in range(count)
    ]
    order = data.draw(st.permutations(range(count)))
    merged = data.draw(st.integers(0, count))
    removed = data.draw(st.integers(0, count - merged))
    correction = Correction(
        merge=(tuple(order[:merged]),) if merged > 1 else (),
        remove=tuple(order[count - removed :]),
        add=tuple(tuple(rng.random(3)) for _ in range(data.draw(st.integers(0, 2)))),
    )
    try:
        found, _ = corrected(palette, correction, ranges)
    except BadInput:
        return
    assert {r for entry in found for r in entry.ranges} == set(range(len(ranges)))
    assert all(entry.ranges for entry in found)
    assert sorted(old for entry in found for old in entry.origin) == sorted(set(range(count)) - set(correction.remove))


@pytest.mark.parametrize(
    ("correction", "ranges", "words"),
    [
        (Correction(), (), "Nothing to correct"),
        (Correction(remove=(3,)), (), "no region 3: the scene has the regions 0 to 2"),
        (Correction(merge=((0, -1),)), (), "no region -1"),
        (Correction(colours={5: RED}), (), "no region 5"),
        (Correction(merge=((1, 1),)), (), "merged with itself"),
        (Correction(merge=((1,),)), (), "merged with itself"),
        (Correction(merge=((0, 1), (1, 2))), (), "Region 1 is merged twice"),
        (Correction(remove=(0, 0)), (), "removed twice"),
        (Correction(remove=(0, 1, 2)), (), "last region"),
        (Correction(remove=(0,), merge=((0, 1),)), (), "removed and changed"),
        (Correction(merge=((0, 1),), colours={0: GOLD, 1: RED}), (), "set only one colour"),
        (Correction(add=(GREEN,)), (), "already contains #33cc33"),
        (Correction(add=(GOLD, GOLD)), (), "already"),
        (Correction(add=((0.0, 0.0, 1.5),)), (), "red, green and blue"),
        (Correction(colours={0: GREEN}), (), "Two colours would be #33cc33"),
        (Correction(split=(0,)), (), "are unknown"),
        (Correction(split=(0,)), RANGES, "a single range"),
        (Correction(split=(1,), colours={1: RED}), RANGES, "split and changed"),
        (Correction(add=tuple((0.1 * k, 0.0, 1.0) for k in range(6))), (), "9 colours; it can have at most 8"),
    ],
)
def test_corrections_that_cannot_be_are_one_sentence(correction: Correction, ranges: Any, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        corrected(KNOWN if ranges else SEEN, correction, ranges)


def test_known_ranges_may_have_one_colour() -> None:
    """What the views cannot tell apart, the volume does."""
    found, _ = corrected(KNOWN, Correction(colours={0: BLUE}), RANGES)
    assert colours(found) == [BLUE, GREEN, BLUE]
