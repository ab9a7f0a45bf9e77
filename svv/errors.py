"""What may go wrong in a way the user can mend, and how long work reports its progress.

This module stands below every layer: it imports nothing of ours and nothing heavy.
"""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[float, str], None]
"""Called with the finished fraction in [0, 1] and a short label; raising from it stops the work."""


class BadInput(ValueError):
    """Input that the program cannot work with; its message is one sentence that says what to do.

    The command line prints the message and exits with code 2; ParaView shows it in its Output Messages.
    """


class Cancelled(Exception):
    """The user stopped the work; what was finished before stays (exit code 130)."""


def silent(fraction: float, label: str) -> None:
    """Report progress to nobody."""


def part(progress: Progress, start: float, stop: float) -> Progress:
    """Progress of a step that covers the fractions from ``start`` to ``stop`` of a longer work."""
    return lambda fraction, label: progress(start + (stop - start) * fraction, label)
