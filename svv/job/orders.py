"""What a learner (:mod:`svv.job.learner`) and whoever orders from it tell each other, as JSON.

Nothing here takes long to load: ParaView's window orders, and never learns.
"""

from __future__ import annotations

from typing import Any, TypedDict

from svv.core.json_values import Json

LEARNED = 0.7
"""Fraction of the work when a scene that is to be painted is learned."""

STATE = "state.svv"
"""File in a learner's folder with the newest scene to be shown meanwhile."""


class Order(TypedDict, total=False):
    """What a learner is told, as JSON: a result that is to be made, or how to go on."""

    number: int
    """Number of the order."""
    scene: str
    """Name of the scene that is learned, or that is the input: an order with the same one has the same input."""
    result: str
    """Name of the painted or corrected scene; '' if the scene itself is the result."""
    asked: dict[str, Any]
    """What is asked for, as whoever orders it says it."""
    input: str
    """Folder with the input, if the process does not have it."""
    pause: bool
    """Whether to wait; such an order says nothing else."""
    stop: bool
    """To stop; such an order says nothing else."""


class Progressed(TypedDict, total=False):
    """What a learner says of an order."""

    order: int
    """Number of the order."""
    state: int
    """Number of scenes that it has given away for the order, the result included."""
    page: int
    """Number of the scene whose page is there."""
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
    """Whether the result is kept."""
    report: Json
    """The training's report, when the result is kept."""
    error: str
    """Why there will be none."""
