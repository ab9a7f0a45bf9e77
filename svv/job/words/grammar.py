"""From words to requests: which regions a sentence names, and what it wants of them.

A sentence is clauses between commas, semicolons and full stops, which "and" may join. A clause names regions and says
what they should look like, in any order; one that names none is about those of the clause before it.
"""

from __future__ import annotations

import difflib
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache

from svv.core.colour.hex_codes import to_hex
from svv.core.colour.matcaps import MATCAPS
from svv.errors import BadInput
from svv.fields.scene.region import Region
from svv.job.words.colours import MODIFIERS, colour_at, names
from svv.styles.gallery.offered import GALLERY, INKS

Value = tuple[float, ...] | float | str | bool

WORD = r"#[0-9a-f]{6}|\d*\.?\d+%?|[^\W\d_][\w'-]*|\S"
"""A colour's code, a number, a word, or any other sign."""

LONGEST = 2000
"""Largest number of characters of a sentence."""

IGNORED = frozenset(
    "make turn let set give paint painted draw drawn colour color coloured colored the a an to be become becomes into "
    "is are look looks its their please now me see with at on style and also bit little for so has have ! ? : \" ' ( )"
    "".split()
)
"""Words that carry no meaning here."""

OPACITY = {
    "thinner": 0.5, "fainter": 0.5, "see-through": 0.3, "thin": 0.3, "transparent": 0.3, "translucent": 0.3,
    "faint": 0.3, "thicker": 2.0, "denser": 2.0, "solid": 4.0, "opaque": 4.0,
}  # fmt: skip
"""Word -> factor on the opacity; for adjectives, the opacity itself."""

RELATIVE = ("thinner", "fainter", "thicker", "denser")
VISIBILITY = {
    "hide": "hide", "remove": "hide", "without": "hide", "drop": "hide", "show": "show", "unhide": "show",
    "only": "only", "just": "only", "isolate": "only", "alone": "only",
}  # fmt: skip
SIDES = {
    "left": (-60.0, 0.0), "right": (60.0, 0.0), "above": (0.0, 55.0), "top": (0.0, 55.0), "upper": (0.0, 40.0),
    "below": (0.0, -45.0), "bottom": (0.0, -45.0), "lower": (0.0, -35.0), "front": (0.0, 0.0), "camera": (0.0, 0.0),
    "behind": (180.0, 0.0),
}  # fmt: skip
"""Side that light comes from -> azimuth and elevation, degrees."""

WHOLE = ("all", "everything", "each", "every")
REST = ("rest", "others", "other")
EXCEPT = ("but", "except")
BACK = ("it", "them", "they", "that", "those")
OF = ("in", "of", "as", "like", "from")


@dataclass(frozen=True)
class Clause:
    """What a part of a sentence asks for."""

    regions: tuple[int, ...] = ()
    """Regions that it names."""
    wants: dict[str, Value] = field(default_factory=dict)
    """What it wants: ``colour``, ``change`` (a modifier), ``opacity``, ``factor``, ``lighting``, ``matcap``, ``style``,
    ``outline``, ``visible`` (hide, show or only), ``light`` (azimuth and elevation) and ``intensity``."""
    texts: tuple[str, ...] = ()
    """Its wants in words."""


def understood(text: str, regions: Sequence[Region]) -> list[Clause]:
    """Return what an English sentence asks for, clause by clause, each with its regions.

    It may use the names of the scene's regions; without one, "region 0". Raises BadInput if a word is unknown, no
    region is named, a clause wants two things at once, or there is nothing to do.
    """
    if len(text) > LONGEST:
        raise BadInput(f"A sentence has at most {LONGEST} characters, not {len(text)}: say less at once.")
    found: list[Clause] = []
    mentioned: set[int] = set()
    for piece in re.split(r"[,;\n]|\.(?!\d)|\bthen\b", _numbered(text, regions)):
        parts = [_read(words, regions, mentioned, found) for words in _joined_by_and(piece)]
        for clause in _merged([part for part in parts if part.regions or part.wants]):
            before = found[-1].regions if found else ()
            if not clause.wants and found:  # "hide the ring, the shell"
                found[-1] = replace(found[-1], regions=(*before, *clause.regions))
                continue
            own = clause.regions or (() if set(clause.wants) <= {"light", "intensity"} else before)
            if found and not found[-1].wants:  # "the shell, thinner"
                own = found.pop().regions + clause.regions
            if not own and len(regions) == 1:
                own = (0,)
            if not own and not set(clause.wants) <= {"light", "intensity"}:
                raise BadInput(f"'{' '.join(clause.texts)}' names no region: name {_choices(regions)}.")
            mentioned |= set(own)
            found.append(replace(clause, regions=own or before))
    if not any(clause.wants for clause in found):
        raise BadInput(f"'{text.strip()}' asks for nothing: say what should change, {_known(regions)}.")
    idle = next((clause for clause in found if not clause.wants), None)
    if idle is not None:
        named = ", ".join(_name(regions, k) for k in idle.regions)
        raise BadInput(f"Nothing is said about {named}: say what should change, {_known(regions)}.")
    return found


def _numbered(text: str, regions: Sequence[Region]) -> str:
    """Return a sentence in small letters with "region 0" in place of names, which may hold any signs and words."""
    numbers: dict[str, list[int]] = {}
    for number, region in enumerate(regions):
        if region.name is not None:
            numbers.setdefault(_key(region.name), []).append(number)
    text = _key(text)
    if not numbers:
        return text
    names = "|".join(re.escape(name) for name in sorted(numbers, key=len, reverse=True))
    said = {name: " ".join(f"region {number}" for number in own) for name, own in numbers.items()}
    return re.sub(rf"(?<!\w)(?:{names})(?!\w)", lambda found: f" {said[found[0]]} ", text)


def _key(text: str) -> str:
    return unicodedata.normalize("NFC", text).casefold()


def _joined_by_and(piece: str) -> list[list[str]]:
    words = re.findall(WORD, piece)
    parts: list[list[str]] = [[]]
    for word in words:
        word = {"paler": "pale", "deeper": "deep"}.get(word, word)
        if word == "and":
            parts.append([])
        else:
            parts[-1].append(word)
    return parts


def _merged(parts: Sequence[Clause]) -> list[Clause]:
    """Return clauses in which regions alone share what the next clause wants, or if there is none, the one before."""
    found: list[Clause] = []
    waiting: tuple[int, ...] = ()
    for part in parts:
        if not part.wants:
            waiting += part.regions
            continue
        found.append(replace(part, regions=(*waiting, *part.regions)))
        waiting = ()
    if waiting and found and found[-1].regions:
        found[-1] = replace(found[-1], regions=(*found[-1].regions, *waiting))
    elif waiting:
        found.append(Clause(waiting))
    return found


def _read(words: list[str], regions: Sequence[Region], mentioned: set[int], before: Sequence[Clause]) -> Clause:
    """Return what some words ask for."""
    reader = _Reader(words, regions, mentioned, before[-1].regions if before else ())
    while reader.at < len(words):
        reader.step()
    return Clause(tuple(dict.fromkeys(reader.found)), reader.wants, tuple(reader.texts))


class _Reader:
    """Reads the words of one clause."""

    def __init__(
        self, words: list[str], regions: Sequence[Region], mentioned: set[int], before: tuple[int, ...]
    ) -> None:
        self.words, self.regions, self.mentioned, self.before = words, regions, mentioned, before
        self.at, self.negated = 0, False
        self.found: list[int] = []
        self.wants: dict[str, Value] = {}
        self.texts: list[str] = []

    def step(self) -> None:
        """Read the next phrase."""
        for read in (self._region, self._light, self._opacity, self._material, self._colour, self._plain):
            if (count := read()) is not None:
                self.at += count
                return
        word = self.words[self.at]
        own = [part for region in self.regions if region.name for part in _key(region.name).split()]
        near = difflib.get_close_matches(word, own, 1, 0.75) or difflib.get_close_matches(word, _vocabulary(), 1, 0.75)
        hint = f" (did you mean '{near[0]}'?)" if near else ""
        raise BadInput(f"'{word}' was not understood{hint}: the words known are {_known(self.regions)}.")

    def _want(self, kind: str, value: Value, count: int, said: str | None = None) -> int:
        if kind in self.wants and self.wants[kind] != value:
            raise BadInput(
                f"'{' '.join(self.words)}' asks for two things at once ({self.texts[-1]} and "
                f"{' '.join(self.words[self.at : self.at + count])}): separate them by commas."
            )
        self.wants[kind] = value
        self.texts.append(said or " ".join(self.words[self.at : self.at + count]))
        return count

    def _next(self, offset: int = 0) -> str:
        return self.words[self.at + offset] if self.at + offset < len(self.words) else ""

    def _region(self) -> int | None:
        """Read a region's number, or a word such as all, the rest, or it."""
        word = self._next()
        if word in ("region", "regions"):
            if not self._next(1).isdigit():
                return 1
            return self._number(1)
        share = self._next(1) in ("%", "percent", "opaque", "opacity")
        if word.isdigit() and self.at == 0 and not share:  # "region 0 and 1"
            return self._number(0)
        if word in WHOLE:
            return self._add(list(range(len(self.regions))), 1)
        if word in REST:
            return self._add([k for k in range(len(self.regions)) if k not in self.mentioned], 1)
        if word in BACK:
            return self._add(list(self.before), 1)
        if word in EXCEPT:
            self.negated = True
            return 1
        return None

    def _number(self, offset: int) -> int:
        number = int(self._next(offset))
        if number >= len(self.regions):
            raise BadInput(f"There is no region {number}: the scene has the regions 0 to {len(self.regions) - 1}.")
        return self._add([number], offset + 1)

    def _add(self, regions: list[int], count: int) -> int:
        if self.negated:
            self.found = [k for k in self.found or range(len(self.regions)) if k not in regions]
        else:
            self.found += regions
        return count

    def _light(self) -> int | None:
        """Read where light comes from: 'light from the upper left'."""
        if self._next() not in ("light", "lit", "lamp"):
            if self._next() in ("brighter", "dimmer") and self._next(1) == "light":
                return self._want("intensity", 1.3 if self._next() == "brighter" else 0.7, 2)
            return None
        count = 1
        while self._next(count) in ("from", "the", "comes", "coming"):
            count += 1
        sides = []
        while self._next(count) in SIDES:
            sides.append(SIDES[self._next(count)])
            count += 1
        if not sides:
            return None
        azimuth, elevation = (sum(axis) for axis in zip(*sides, strict=True))
        return self._want("light", (max(-180.0, min(azimuth, 180.0)), max(-80.0, min(elevation, 80.0))), count)

    def _opacity(self) -> int | None:
        """Read an opacity: 'opacity 0.4', '40% opaque', 'half as opaque', 'thinner', 'more transparent'."""
        word, after = self._next(), self._next(1)
        if word == "opacity":
            skip = 2 if after in ("of", "to", "=") else 1
            value = _number_in(self._next(skip), self._next(skip + 1))
            if value is None:
                raise BadInput("An opacity needs a number: say opacity 0.4 or opacity 40%.")
            return self._want("opacity", value[0], skip + value[1])
        value = _number_in(word, after)
        if value is not None and self._next(value[1]) in ("opaque", "opacity"):
            return self._want("opacity", value[0], value[1] + 1)
        if word in ("half", "twice") and after == "as" and self._next(2) in ("opaque", "dense", "thick"):
            return self._want("factor", 0.5 if word == "half" else 2.0, 3)
        if word in ("more", "less") and after in ("transparent", "translucent", "opaque", "dense"):
            more = (word == "more") == (after in ("opaque", "dense"))
            return self._want("factor", 2.0 if more else 0.5, 2)
        if word in ("much", "far") and after in RELATIVE:
            return self._want("factor", OPACITY[after] ** 2, 2)
        if word in OPACITY:
            return self._want("factor" if word in RELATIVE else "opacity", OPACITY[word], 1)
        return None

    def _material(self) -> int | None:
        """Read a MatCap or a style: 'in jade', 'of bronze', 'as watercolour', 'hatching'."""
        offset = 1 if self._next() in OF else 0
        for count in (2, 1):
            name = "-".join(self.words[self.at + offset : self.at + offset + count])
            end = offset + count
            if name in MATCAPS and len(name.split("-")) <= count:
                material = self._next(end) in ("matcap", "material", "stone")
                if offset or material or " ".join(name.split("-")) not in names():
                    return self._want("matcap", name, end + material, f"MatCap {name}")
            if name in GALLERY or name in INKS:
                kind = "ink:" if name in INKS and not (offset == 0 and name in GALLERY) else "gallery:"
                return self._want("style", kind + name, end, f"style {name}")
        return None

    def _colour(self) -> int | None:
        """Read a colour, or a word that changes the one that is there: 'darker'."""
        found = colour_at(self.words, self.at)
        if found is not None:
            said = " ".join(self.words[self.at : self.at + found[1]])
            return self._want("colour", found[0], found[1], f"colour {said} ({to_hex(found[0])})")
        word = self._next()
        if word in ("more", "much") and self._next(1) in MODIFIERS:
            return self._want("change", self._next(1), 2)
        return self._want("change", word, 1) if word in MODIFIERS else None

    def _plain(self) -> int | None:
        """Read a word that stands for itself."""
        word = self._next()
        if word in ("no", "without") and self._next(1) in ("outline", "outlines", "matcap"):
            kind = "matcap" if self._next(1) == "matcap" else "outline"
            return self._want(kind, "none" if kind == "matcap" else 0.0, 2)
        if word in VISIBILITY:
            now = VISIBILITY[word]
            if {now, self.wants.get("visible")} == {"show", "only"}:
                self.wants["visible"] = now = "only"
            return self._want("visible", now, 1)
        if word in ("flat", "unlit"):
            return self._want("lighting", 0.0, 1)
        if word in ("shaded", "lit"):
            return self._want("lighting", 1.0, 1)
        if word in ("outline", "outlines", "outlined"):
            return self._want("outline", 1.0, 1)
        return 1 if word in IGNORED or word in OF else None


@cache
def _vocabulary() -> list[str]:
    """Return the words that mean something in any scene."""
    words = [*OPACITY, *VISIBILITY, *SIDES, *MODIFIERS, *MATCAPS, *GALLERY, *INKS, *WHOLE, *REST]
    return [*words, "opacity", "light", "flat", "outlined", *(word for name in names() for word in name.split())]


def _number_in(word: str, after: str) -> tuple[float, int] | None:
    """Return the number that words stand for, and how many they are: 0.4, 40%, 40 %, half."""
    if word == "half":
        return (0.5, 1) if after in ("opaque", "opacity") else None
    try:
        if word.endswith("%"):
            return float(word[:-1]) / 100.0, 1
        value = float(word)
    except ValueError:
        return None
    return (value / 100.0, 2) if after in ("%", "percent") else (value, 1)


def _name(regions: Sequence[Region], number: int) -> str:
    return regions[number].name or f"region {number}"


def _choices(regions: Sequence[Region]) -> str:
    named = [_name(regions, k) for k in range(len(regions))]
    return f"{', '.join(named)}, or all"


def _known(regions: Sequence[Region]) -> str:
    """Return the words that a sentence may use, for messages."""
    return (
        f"the regions {_choices(regions)}; colours of CSS and xkcd, also with {', '.join(MODIFIERS)}; "
        f"{', '.join(OPACITY)}, opacity 0.4; hide, show, only; flat, outlined; light from the left, right, above or "
        f"below; in {', '.join(MATCAPS)}; as {', '.join([*GALLERY, *INKS])}"
    )
