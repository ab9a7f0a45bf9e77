"""How long a painting will take on this machine, for each preset: its speed is that of the last painting kept."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import Any

from svv.errors import BadInput
from svv.io.files.cache import Cache
from svv.measure import usable_cpus
from svv.options.making import ViewOptions
from svv.pv.results.stored import Stored

PRESETS = {"draft": ("a sketch", 40.0), "fast": ("good", 240.0), "balanced": ("better", 300.0)}
"""What a preset is for, and the seconds that views, training and painting take on two cores: 92 views of 800 x 800 of a
volume of 256 points along each side (docs/measurements/paraview.md)."""

LOOKED_AT = 20
"""Number of kept paintings that are looked at, the last ones."""

BUSY = 1.25
"""Ratio of the time of work to its processor time above which other programs have held it up, so that it tells nothing
of the machine's speed: alone, work takes a second of a processor, or of several, each second."""


def duration(seconds: float) -> str:
    """Return a duration as people say it: ``about 40 s`` or ``about 3 min``."""
    if seconds < 90:
        return f"about {max(5 * round(seconds / 5), 5)} s"
    return f"about {round(seconds / 60)} min"


def expected() -> str:
    """Return one line on how long a painting takes with each preset."""
    slowness = [2.0 / usable_cpus(), *_measured()][-1]
    told = [f"{preset} ({what}) {duration(seconds * slowness)}" for preset, (what, seconds) in PRESETS.items()]
    return f"On this machine: {', '.join(told)}."


def _measured() -> Iterator[float]:
    """Yield how much longer than in :data:`PRESETS` kept paintings of as many views took, the last one at the end."""
    try:
        place = Cache.of_user()
    except BadInput:  # the first work says so
        return
    files = [entry.path for entry in place.entries() if entry.path.name.startswith("painting-")]
    for file in files[-LOOKED_AT:]:
        with suppress(BadInput):  # another process has just removed it
            made = Stored.read(file).made
            seconds = _seconds(made)
            same = made.get("preset") in PRESETS and made.get("views") == ViewOptions().n
            if same and seconds is not None:
                yield seconds / PRESETS[made["preset"]][1]


def _seconds(made: dict[str, Any]) -> float | None:
    """Return the seconds that views, training and painting took; None if they are not known, or if it was held up."""
    try:
        views = float(made.get("source", {}).get("seconds") or 0.0)
        parts = [(float(part["seconds"]["total"]), float(part["cpu_seconds"])) for part in (made, made["stylized"])]
        held_up = any(seconds > BUSY * cpu for seconds, cpu in parts)
        return None if held_up else views + sum(seconds for seconds, _ in parts)
    except (KeyError, TypeError, ValueError):
        return None
