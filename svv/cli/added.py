"""Commands of other distributions: ``svv`` has them where they are installed, or their package is on Python's path.

An entry point in the group ``svv.commands`` gives a name and a Typer app, as that of ``svv bench`` does.
"""

from __future__ import annotations

from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from typing import Any

import typer

from svv.errors import BadInput

GROUP = "svv.commands"

BENCH = EntryPoint("bench", "svv_bench.cli:app", GROUP)
"""The commands that measure, in the folder ``bench`` of this repository."""

MEASURES = "Measure accuracy against time, stability, consistency between frames, and the effect of each part."
"""What ``svv bench`` does."""

MISSING = (
    "svv bench is a package of its own, which is not installed; install it with: pip install svv-bench, "
    "or pip install ./bench in a checkout of svv."
)


def added() -> dict[str, tuple[EntryPoint, str]]:
    """Return where the commands of other distributions are, and what they do, by name."""
    found = {BENCH.name: (BENCH, MEASURES)} if find_spec("svv_bench") else {}
    for point in entry_points(group=GROUP):
        (said, *_) = (point.dist and point.dist.metadata.get_all("Summary")) or [""]
        found[point.name] = point, said
    return found


def added_command(name: str) -> Any:
    """Return a command of another distribution, if one brings it.

    Raises BadInput if it does not fit, or bench is missing.
    """
    if name not in (found := added()):
        if name == BENCH.name:
            raise BadInput(MISSING)
        return None
    try:
        app = found[name][0].load()
    except ImportError as error:
        raise BadInput(f"svv {name} does not fit svv here ({error}): install both in the same version.") from error
    return typer.main.get_command(app)
