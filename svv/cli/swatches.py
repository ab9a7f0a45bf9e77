"""Swatches of the parts of pictures that paint regions, on the terminal; see :mod:`svv.cli.app`."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from svv.fields.scene.region import Region


def print_swatches(divided: Mapping[str, Mapping[str, Any]], regions: Sequence[Region]) -> None:
    """Print on standard error three colours from dark to light and a label for each region with a part of a picture.

    The colours are blocks on a terminal that shows colours, unless NO_COLOR is set, and hex codes elsewhere.
    """
    from rich.console import Console
    from rich.text import Text

    from svv.fields.scene.region import swatches

    console = Console(stderr=True)
    coloured = console.is_terminal and console.color_system is not None and not console.no_color
    for colours, label in swatches(divided, regions):
        if coloured:
            console.print(Text.assemble(*(("   ", f"on {colour}") for colour in colours), f"  {label}"), soft_wrap=True)
        else:
            print(*colours, f" {label}", file=sys.stderr)
