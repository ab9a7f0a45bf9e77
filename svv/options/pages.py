"""Options of a scene's page for browsers (:mod:`svv.render.web`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from svv.options.described import Setting


@dataclass(frozen=True)
class PageOptions:
    """What a page holds besides what it shows, and in which units it says what is clicked on.

    >>> from svv.options.pages import PageOptions
    >>> PageOptions(value_unit="HU").values
    False
    """

    values: bool = False
    """Also keep the volume's values in a page (from `svv train --keep-values`) where they add over a fifth to it."""
    unit: Annotated[str | None, Setting(metavar="UNIT")] = None
    """Unit of the volume's lengths that clicks on a page say, such as mm or µm."""
    value_unit: Annotated[str | None, Setting(metavar="UNIT")] = None
    """Unit of the volume's values that clicks on a page say, such as HU."""
