"""One input at a time through a parser of ours: it must end normally or with a sentence, in time and memory."""

from __future__ import annotations

import resource
import signal
import time
import traceback
import tracemalloc
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from types import FrameType
from typing import Any

from svv.errors import BadInput

MOST_SECONDS = 1.0
"""Time after which a parser counts as hanging, beyond what the bytes that are declared and allowed take."""

BYTES_A_SECOND = 400e6
"""Rate at which declared bytes may be worked on: large pictures take their time."""

SLACK = 16 << 20
"""Bytes that any parser may take besides what its input declares: decoders' own tables and buffers."""

TRACED = 256
"""One input in so many is run again with every allocation traced; the resident memory is watched at each."""

CRASH = "a crash that became a sentence"

Read = Callable[[bytes], object]


def thrice(content: bytes) -> int:
    """Return how much memory an input may take unless its parser says otherwise: text becomes objects."""
    return 40 * len(content)


@dataclass(frozen=True)
class Parser:
    """A reader of user's files, and a generator of inputs for it."""

    name: str
    read: Read
    """Ends normally or with BadInput, whatever it is given."""
    make: Callable[[Random], bytes]
    declared: Callable[[bytes], int] = thrice
    """Bytes that the input declares, which may be allocated."""
    clock: Callable[[], float] = time.process_time
    """What its time is measured by: that of this process's own work, or all time if another process does it."""
    ready: Callable[[], object] = lambda: None
    """Called before each input: starts what a crash has ended, which is not the input's time."""


@dataclass
class Figures:
    """What was seen of one parser."""

    inputs: int = 0
    rejected: int = 0
    crashes: int = 0
    """Crashes of a library that became a sentence."""
    seconds: float = 0.0
    slowest: float = 0.0
    largest: int = 0
    """Largest allocation seen beyond what was held before, in bytes."""
    failures: dict[str, str] = field(default_factory=dict)
    """The first reproducer of each kind of failure: a kind -> a file or a description."""


class Hang(BaseException):
    """A parser took too long."""


def _stop(signum: int, frame: FrameType | None) -> None:
    raise Hang


def watched(seconds: float = 20.0) -> Callable[[bool], None]:
    """Return a function that starts and stops the alarm for a hang (main thread only)."""
    signal.signal(signal.SIGALRM, _stop)
    return lambda on: signal.setitimer(signal.ITIMER_REAL, seconds if on else 0.0) and None


def resident() -> int:
    """Return the most memory that this process has held, in bytes."""
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def outcome(read: Read, content: bytes) -> tuple[str | None, bool]:
    """Return the kind of failure (None: none), and whether the input was rejected with a sentence."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # a user would see it beside the sentence
            warnings.filterwarnings("ignore", module="PIL")  # what it says about a picture may be shown
            read(content)
    except BadInput as error:
        message = str(error)
        if not message.strip() or "Traceback" in message:
            return "a sentence that says nothing", True
        return CRASH if "crashed on it" in message else None, True
    except Hang:
        return "a hang", False
    except Exception as error:  # anything else is what the campaign looks for
        last = traceback.extract_tb(error.__traceback__)[-1]
        own = [frame for frame in traceback.extract_tb(error.__traceback__) if "/svv/" in frame.filename]
        where = own[-1] if own else last
        return f"{type(error).__name__} in {Path(where.filename).name}:{where.name}", False
    return None, False


def traced(read: Read, content: bytes) -> int:
    """Return the peak of a parser's own allocations for an input, in bytes."""
    tracemalloc.start()
    try:
        outcome(read, content)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@dataclass(frozen=True)
class Extent:
    """How far a campaign goes, and where it keeps what fails."""

    seed: object
    inputs: int
    seconds: float
    folder: Path | None = None
    """Folder for inputs that fail; None shows their beginning."""
    note: Path | None = None
    """File that holds the input in work, for parsers that may end the process."""


def campaign(parser: Parser, extent: Extent) -> Figures:
    """Attack a parser until a number of inputs or a time is reached; failures are kept as files."""
    figures, start, alarm = Figures(), time.perf_counter(), watched()
    random = Random(f"{parser.name} {extent.seed}")
    before = resident()
    while figures.inputs < extent.inputs and figures.seconds < extent.seconds:
        content = parser.make(random)
        if extent.note is not None:
            extent.note.write_bytes(figures.inputs.to_bytes(8, "little") + content)
        parser.ready()
        begun = parser.clock()
        alarm(True)
        kind, rejected = outcome(parser.read, content)
        alarm(False)
        taken, figures.seconds = parser.clock() - begun, time.perf_counter() - start
        figures.inputs += 1
        figures.rejected += rejected
        figures.slowest = max(figures.slowest, taken)
        if kind == CRASH:
            figures.crashes, kind = figures.crashes + 1, None
        if kind is None and taken > MOST_SECONDS + parser.declared(content) / BYTES_A_SECOND:
            kind = "slower than a second"
        held = resident()
        grown, before = held - before, held
        if grown > SLACK + 1.1 * parser.declared(content) or figures.inputs % TRACED == 1:
            grown = traced(parser.read, content)
            if grown > SLACK + 1.1 * parser.declared(content):
                kind = kind or "more memory than declared"
            before = resident()
        figures.largest = max(figures.largest, grown)
        if kind is not None and kind not in figures.failures:
            figures.failures[kind] = kept(parser.name, kind, content, extent.folder)
    return figures


def kept(name: str, kind: str, content: bytes, folder: Path | None) -> str:
    """Keep a reproducer in a file, and return where."""
    if folder is None:
        return repr(content[:300])
    plain = "".join(letter if letter.isalnum() else "-" for letter in f"{name} {kind}")[:120]
    path = folder / plain
    path.write_bytes(content)
    return str(path)


def plain(figures: Figures) -> dict[str, Any]:
    """Return figures as a line of JSON holds them."""
    return {
        "inputs": figures.inputs, "rejected": figures.rejected, "crashes": figures.crashes,
        "seconds": round(figures.seconds, 1),
        "slowest": round(figures.slowest, 3), "largest": figures.largest, "failures": figures.failures,
    }  # fmt: skip
