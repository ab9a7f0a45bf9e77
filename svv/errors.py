"""Errors that the user can fix, and the progress callback of long-running work.

This module lies below every layer: it imports nothing else from the package and nothing heavy.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable

Progress = Callable[[float, str], None]
"""Called with the finished fraction in [0, 1] and a short label; raising an exception from it stops the work."""


class BadInput(ValueError):
    """Input that the program cannot work with; its message is one sentence that says what to do.

    The command line prints the message and exits with code 2; ParaView shows it in its Output Messages.

    >>> try:
    ...     svv.Ink("chalk")
    ... except svv.BadInput as error:
    ...     print(error)
    There is no 'ink:chalk'; choose one of ink:stippling, ink:hatching, ink:cross-hatching.
    """


class Cancelled(Exception):
    """The user stopped the work; finished results are kept (exit code 130).

    >>> def stop(part: float, label: str) -> None:
    ...     raise svv.Cancelled("stopped by the user")
    >>> try:
    ...     svv.train_scene(views, "draft", progress=stop)
    ... except svv.Cancelled as stopped:
    ...     print(stopped)
    stopped by the user
    """


class Elsewhere(Exception):
    """Another process of the same run says why it ends; this one ends silently, with the exit code ``code``."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


TORCH_SAYS = ("can't allocate memory", "not enough memory", "out of memory")
"""What PyTorch's errors contain if memory runs out."""


def is_lack_of_memory(error: BaseException) -> bool:
    """Return whether an error means that there is not enough memory; PyTorch has no type of its own for it on CPUs."""
    if isinstance(error, MemoryError):
        return True
    return isinstance(error, RuntimeError) and any(said in str(error) for said in TORCH_SAYS)


def silent(fraction: float, label: str) -> None:
    """Ignore the progress."""


def part(progress: Progress, start: float, stop: float) -> Progress:
    """Return the progress callback of a step that spans the fractions ``start`` to ``stop`` of a longer task."""
    return lambda fraction, label: progress(start + (stop - start) * fraction, label)


def warn_caller(sentence: str) -> None:
    """Warn of something at the line of the user's own code, and not at one of svv's.

    >>> import warnings
    >>> with warnings.catch_warnings(record=True) as found:
    ...     warnings.simplefilter("always")
    ...     warn_caller("Two regions look alike.")
    >>> str(found[0].message), "errors" in found[0].filename
    ('Two regions look alike.', False)
    """
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and str(frame.f_globals.get("__name__")).partition(".")[0] == "svv":
        frame, level = frame.f_back, level + 1
    warnings.warn(sentence, stacklevel=level)
