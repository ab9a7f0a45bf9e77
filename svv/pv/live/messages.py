"""What filters and the process that draws beside ParaView's window tell each other, as JSON."""

from __future__ import annotations

from typing import TypedDict

from svv.pv.panel_values import Values


class DrawOrder(TypedDict, total=False):
    """What a filter tells the process that draws."""

    number: int
    file: str
    state: tuple[int, int]
    """What tells the scene from others that were in the same file."""
    finished: bool
    """Whether it is a result in the cache, and not a sketch."""
    values: Values
    """The panel's values on which an image depends."""
    warm: str
    """A scene's file, to be drawn for the sake of what that loads; such an order says nothing else."""


class DrawnOf(TypedDict, total=False):
    """What the process that draws says of an order."""

    number: int
    drawn: list[int | bool] | None
    """Order of the newest image, and whether that is the sharp one."""
    edited: str
    """What to say of the panel's edits of the scene, after a space."""
    gone: bool
    error: str
