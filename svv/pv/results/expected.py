"""How long a painting will take on this machine, for each preset: as long as the last one, if one is kept."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import Any

from svv.errors import BadInput
from svv.io.files.cache import Cache
from svv.measure import usable_cpus
from svv.pv.results.stored import Stored

PRESETS = {"draft": ("a sketch", 40.0), "fast": ("good", 240.0), "balanced": ("better", 300.0)}
"""What a preset is for, and the seconds that views, training and painting take on two cores: 92 views of 800 x 800 of a
volume of 256 points along each side (docs/measurements/paraview.md)."""

LOOKED_AT = 20
"""Number of kept paintings that are looked at, the last ones."""


def duration(seconds: float) -> str:
    """Return a duration as people say it: ``about 40 s`` or ``about 3 min``."""
    if seconds < 90:
        return f"about {max(5 * round(seconds / 5), 5)} s"
    return f"about {round(seconds / 60)} min"


def expected() -> str:
    """Return one line on how long a painting takes with each preset."""
    known = dict(_measured())
    cores = usable_cpus()
    told = []
    for preset, (what, seconds) in PRESETS.items():
        told.append(f"{preset} ({what}) {duration(known.get(preset, seconds * 2.0 / cores))}")
    return f"On this machine: {', '.join(told)}."


def _measured() -> Iterator[tuple[str, float]]:
    """Yield the presets of kept paintings with the seconds that these took, the last one at the end."""
    try:
        place = Cache.of_user()
    except BadInput:  # the first work says so
        return
    files = [entry.path for entry in place.entries() if entry.path.name.startswith("painting-")]
    for file in files[-LOOKED_AT:]:
        with suppress(BadInput):  # another process has just removed it
            made = Stored.read(file).made
            seconds = _seconds(made)
            if seconds is not None:
                yield str(made.get("preset")), seconds


def _seconds(made: dict[str, Any]) -> float | None:
    """Return the seconds that views, training and painting took; None if they are not known."""
    try:
        views = float(made.get("source", {}).get("seconds") or 0.0)
        return views + float(made["seconds"]["total"]) + float(made["stylized"]["seconds"]["total"])
    except (KeyError, TypeError, ValueError):
        return None
