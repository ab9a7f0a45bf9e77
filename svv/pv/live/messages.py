"""What filters and the processes beside ParaView's window tell each other, as JSON (:mod:`svv.io.files.worker`)."""

from __future__ import annotations

from typing import TypedDict

from svv.pv.panel_values import Values


class Order(TypedDict, total=False):
    """What a filter tells the process that learns: a result that is to be made, or how to go on."""

    number: int
    """Number of the order."""
    kind: str
    """Name of the filter's class."""
    scene: str
    """What the scene depends on: an order with the same one has the same input."""
    values: Values
    """The panel's values."""
    anew: bool
    """Whether the result is to be made even if it is there."""
    input: str
    """Folder with the input, if the process does not have it."""
    pause: bool
    """Whether to wait; such an order says nothing else."""
    stop: bool
    """To stop; such an order says nothing else."""


class Progressed(TypedDict, total=False):
    """What the process that learns says of an order."""

    order: int
    """Number of the order."""
    state: int
    """Number of scenes that it has given away for the order."""
    shown: str
    """What the newest one is, for the user."""
    fraction: float
    """How much of the work is done, from 0 to 1."""
    label: str
    """What it does."""
    left: float | None
    """Seconds that are left; None if that is not known."""
    paused: bool
    """Whether it waits."""
    done: bool
    """Whether the result is in the cache."""
    error: str
    """Why there will be none."""


class DrawOrder(TypedDict, total=False):
    """What a filter tells the process that draws."""

    number: int
    """Number of the order."""
    file: str
    """The scene's file."""
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
    """Number of the order."""
    drawn: list[int | bool] | None
    """Order of the newest image, and whether that is the sharp one."""
    edited: str
    """What to say of the panel's edits of the scene, after a space."""
    gone: bool
    """Whether the scene's file is no longer there."""
    error: str
    """Why there is no image."""
