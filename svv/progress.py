"""Progress of long-running commands: a bar with the time left, and a clean stop on Ctrl-C and SIGTERM."""

from __future__ import annotations

import gc
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from svv.errors import Cancelled, Progress

LINE_SECONDS = 15.0
"""Longest time between two progress lines where no terminal shows a bar, in seconds."""

LINE_STEP = 0.1
"""Fraction of the work after which a progress line is printed in any case."""

START_OBJECTS = 500_000
"""Objects after which Python looks for cycles of them while a command starts: torch and numba make fewer."""

_usual: list[tuple[int, int, int]] = []
"""When Python looks for cycles otherwise; empty unless a command is starting."""


def collect_later() -> None:
    """Let Python hardly look for cycles of objects until :func:`collect_again`, which work that is shown calls.

    Importing torch and numba makes 400,000 objects that stay. Looking through them for garbage a hundred times is a
    fifth of the processor time of a command that renders one view.
    """
    if not _usual and gc.isenabled():
        _usual.append(gc.get_threshold())
        gc.set_threshold(START_OBJECTS, *_usual[0][1:])


def collect_again() -> None:
    """Let Python look for cycles as usual, but not among the objects that there are now."""
    if _usual:
        gc.freeze()
        gc.set_threshold(*_usual.pop())


@contextmanager
def shown(title: str, quiet: bool = False) -> Iterator[Progress]:
    """Show the progress of one piece of work on standard error, or with ``quiet``, only listen to Ctrl-C.

    Yields the callable to pass down as ``progress``. On a terminal it draws a bar with the time left; elsewhere it
    prints a line from time to time. After the first Ctrl-C, its next call raises ``Cancelled``, so the work stops
    at a point where its files are consistent; a second Ctrl-C stops at once.
    """
    collect_again()
    with _stop_on_interrupt() as stopped:
        if quiet:
            yield _unseen(stopped)
        elif sys.stderr.isatty():
            with _bar(title, stopped) as progress:
                yield progress
        else:
            yield _lines(title, stopped)


@contextmanager
def _stop_on_interrupt() -> Iterator[threading.Event]:
    stopped = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield stopped
        return

    def interrupt(number: int, frame: FrameType | None) -> None:
        stopped.set()
        signal.signal(number, signal.default_int_handler)

    before = {signal.SIGINT: signal.signal(signal.SIGINT, interrupt)}
    if signal.getsignal(signal.SIGTERM) is signal.default_int_handler:  # of svv.ending; that of ranks is left alone
        before[signal.SIGTERM] = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield stopped
    finally:
        for number, handler in before.items():
            # None: the handler was set by a program that embeds Python, such as pvpython.
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
    if stopped.is_set():  # pressed after the last report: the work is done, but the user asked to stop
        raise Cancelled


@contextmanager
def _bar(title: str, stopped: threading.Event) -> Iterator[Progress]:
    from rich.console import Console
    from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.progress import Progress as Bars

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=None),
        TaskProgressColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[label]}", style="dim", markup=False),
    )
    with Bars(*columns, console=Console(stderr=True), expand=True, speed_estimate_period=60.0) as bars:
        task = bars.add_task(title, total=1.0, label="")

        def progress(fraction: float, label: str) -> None:
            bars.update(task, completed=min(max(fraction, 0.0), 1.0), label=label)
            if stopped.is_set():
                raise Cancelled

        yield progress
        bars.update(task, completed=1.0, label="")


def _unseen(stopped: threading.Event) -> Progress:
    def progress(fraction: float, label: str) -> None:
        if stopped.is_set():
            raise Cancelled

    return progress


def _lines(title: str, stopped: threading.Event) -> Progress:
    start = last_time = time.monotonic()
    last_step = -1

    def progress(fraction: float, label: str) -> None:
        nonlocal last_time, last_step
        now = time.monotonic()
        step = int(fraction / LINE_STEP + 1e-9)
        if step > last_step or now - last_time >= LINE_SECONDS:
            spent = now - start
            left = f", {duration(spent * (1 - fraction) / fraction)} left" if 0.02 < fraction < 1 else ""
            print(f"{title}: {fraction:4.0%} {label} ({duration(spent)}{left})", file=sys.stderr, flush=True)
            last_time, last_step = now, max(step, last_step)
        if stopped.is_set():
            raise Cancelled

    return progress


def duration(seconds: float) -> str:
    """Format seconds for people: 8 s, 3 min 20 s, 2 h 5 min."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"
