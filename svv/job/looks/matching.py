"""Which region of a scene gets the look of which region of a look: by name, by values, by colour, or in turn."""

from __future__ import annotations

import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from svv.errors import BadInput
from svv.fields.scene.region import Region, label_of
from svv.job.looks.look_content import LookContent, LookRegion, whole_of
from svv.train.paint.ink import Ink, StyleInput

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene

LEAST_OVERLAP = 0.25
"""Least fraction that two ranges of values share of what both cover, for their regions to be the same."""


@dataclass(frozen=True)
class Match:
    """A region of a scene, the region of the look that it gets, and why."""

    region: int
    source: int
    reason: str


@dataclass(frozen=True)
class Matches:
    """The matches of a look and a scene, and what is left over on both sides."""

    pairs: tuple[Match, ...]
    """In the order of the scene's regions."""
    left: tuple[int, ...]
    """Regions of the scene that keep their looks."""
    unused: tuple[int, ...]
    """Regions of the look that nothing gets."""

    def divided_anew(self, look: LookContent) -> StyleInput | None:
        """Return the picture that is divided anew among all regions of the scene; None if regions get what they match.

        It is that of a look which paints all of its regions with parts of one picture, or its only region with all of
        it, if regions of the scene or of the look are left over, and none was paired by the user.
        """
        names = [region.style for region in look.regions]
        if not (self.left or self.unused) or None in names or any(match.reason == ASKED for match in self.pairs):
            return None
        styles = [look.styles[name] for name in names if name is not None]
        pictures = [style.style for style in styles if not isinstance(style.style, Ink)]
        if len(pictures) < len(styles) or len({region.laid for region in look.regions}) > 1:
            return None
        if len(styles) > 1 and not all(
            style.divided and np.array_equal(picture, pictures[0])
            for style, picture in zip(styles, pictures, strict=True)
        ):
            return None
        return whole_of(styles[0]) if styles[0].divided else styles[0]

    def describe(self, look: LookContent, scene: Scene) -> list[str]:
        """Return a line for each region of both sides: what it gets, or that it gets nothing."""
        lines = [
            f"{_named(scene, m.region)} looks like {look.regions[m.source].label(m.source)}: {m.reason}"
            for m in self.pairs
        ]
        gets = "keeps its look" if self.divided_anew(look) is None else "gets a part of the look's picture"
        lines += [f"{_named(scene, region)} {gets}: nothing of the look is left for it" for region in self.left]
        return lines + [f"{look.regions[k].label(k)} is not used: no region of the scene is left" for k in self.unused]


def matched(look: LookContent, scene: Scene, mapping: Mapping[int, int] | None = None) -> Matches:
    """Match the regions of a look and a scene, one to one.

    Regions of the same name belong together; of the others, first those whose ranges of values overlap most, then those
    whose palette colours are nearest. Regions of a look that came from no scene are handed out in turn, the largest
    region of the scene first. A part that was split off looks like its whole unless its name is in the look.
    ``mapping`` gives the look's region for those of the scene that are not to be matched by themselves. Raises BadInput
    if the scene has no regions, a region does not exist, or nothing matches.
    """
    from scipy.optimize import linear_sum_assignment

    if not scene.regions:
        raise BadInput("The scene has no regions because it holds no palette network; train it again.")
    regions, sources = scene.regions, look.regions
    found = {k: Match(k, v, ASKED) for k, v in _validate_mapping(mapping or {}, len(regions), len(sources)).items()}
    used = {match.source for match in found.values()}

    for costs, most, why in (
        (_by_name, 0.0, NAME), (_by_values, 1.0 - LEAST_OVERLAP, VALUES), (_by_colour, 1e3, COLOUR),
        (_in_turn, 1e3, TURN),
    ):  # fmt: skip
        free = [k for k in range(len(regions)) if k not in found and (why == NAME or regions[k].part_of is None)]
        rest = [k for k in range(len(sources)) if k not in used]
        if free and rest:
            cost = costs([regions[k] for k in free], [sources[k] for k in rest])
            for row, column in zip(*linear_sum_assignment(np.minimum(cost, 1e6)), strict=True):
                if cost[row, column] <= most:
                    found[free[row]] = Match(free[row], rest[column], why.format(float(cost[row, column])))
                    used.add(rest[column])
    for number, region in enumerate(regions):
        if number not in found and region.part_of in found:
            found[number] = Match(number, found[region.part_of].source, f"as {label_of(regions, region.part_of)}")
    if not found:
        raise BadInput(
            "No region of the look fits one of the scene: pair them with --map 0=1 (region = look's region)."
        )
    left = tuple(k for k in range(len(regions)) if k not in found)
    return Matches(tuple(found[k] for k in sorted(found)), left, tuple(k for k in range(len(sources)) if k not in used))


ASKED, NAME, VALUES = "as asked", "the same name", "overlapping values"
COLOUR, TURN = "the nearest colour, {:.0f} apart", "in turn"


def _validate_mapping(mapping: Mapping[int, int], regions: int, sources: int) -> Mapping[int, int]:
    for region, source in mapping.items():
        if not 0 <= region < regions:
            raise BadInput(f"There is no region {region}: the scene has the regions 0 to {regions - 1}.")
        if not 0 <= source < sources:
            raise BadInput(f"The look has no region {source}: its regions are 0 to {sources - 1}.")
    return mapping


def _named(scene: Scene, region: int) -> str:
    name = scene.regions[region].name
    return f"Region {region}" if name is None else f"Region {region} ({name})"


def _key(name: str) -> str:
    return unicodedata.normalize("NFKC", name).casefold().strip()


def _by_name(regions: Sequence[Region], sources: Sequence[LookRegion]) -> NDArray[np.float64]:
    same = [[a.name is not None and b.name is not None and _key(a.name) == _key(b.name) for b in sources]
            for a in regions]  # fmt: skip
    return np.where(same, 0.0, 1e6)


def _by_values(regions: Sequence[Region], sources: Sequence[LookRegion]) -> NDArray[np.float64]:
    """Return 1 - the fraction that ranges share of what both cover, 1 where one is not known."""
    cost = np.ones((len(regions), len(sources)))
    for i, a in enumerate(regions):
        for j, b in enumerate(sources):
            if a.values is not None and b.values is not None:
                (low, high), (least, most) = sorted(a.values), sorted(b.values)
                both, whole = min(high, most) - max(low, least), max(high, most) - min(low, least)
                cost[i, j] = 1.0 - max(both, 0.0) / whole if whole > 0.0 else float(low != least)
    return cost


def _by_colour(regions: Sequence[Region], sources: Sequence[LookRegion]) -> NDArray[np.float64]:
    """Return the CIEDE2000 of palette colours, infinite where a look has none."""
    from svv.core.colour.colour import colour_differences

    own = np.array([region.colour for region in regions], np.float64)
    theirs = np.array([source.colour or (0.0, 0.0, 0.0) for source in sources], np.float64)
    return np.where([source.colour is None for source in sources], 1e6, colour_differences(own, theirs))


def _in_turn(regions: Sequence[Region], sources: Sequence[LookRegion]) -> NDArray[np.float64]:
    """Return costs that pair the regions from the largest with those of a look in their order."""
    rank = np.argsort(np.argsort([-region.share for region in regions], kind="stable"), kind="stable")
    cost = np.square(rank[:, None] - np.arange(len(sources))[None]).astype(np.float64)
    return np.where([source.colour is None for source in sources], np.minimum(cost, 1e3), 1e6)
