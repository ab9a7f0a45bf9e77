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
"""Time after which a parser counts as hanging."""

SLACK = 16 << 20
"""Bytes that any parser may take besides what its input declares: decoders' own tables and buffers."""

TRACED = 256
"""One input in so many is run again with every allocation traced; the resident memory is watched at each."""

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


@dataclass
class Figures:
    """What was seen of one parser."""

    inputs: int = 0
    rejected: int = 0
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


def watched(seconds: float = 5.0) -> Callable[[bool], None]:
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
            read(content)
    except BadInput as error:
        message = str(error)
        if not message.strip() or "Traceback" in message:
            return "a sentence that says nothing", True
        return None, True
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


def campaign(parser: Parser, seed: int, inputs: int, seconds: float, folder: Path | None = None) -> Figures:
    """Attack a parser until a number of inputs or a time is reached; failures are kept as files."""
    figures, start, alarm = Figures(), time.perf_counter(), watched()
    random = Random(f"{parser.name} {seed}")
    before = resident()
    while figures.inputs < inputs and figures.seconds < seconds:
        content = parser.make(random)
        begun = time.perf_counter()
        alarm(True)
        kind, rejected = outcome(parser.read, content)
        alarm(False)
        now = time.perf_counter()
        taken, figures.seconds = now - begun, now - start
        figures.inputs += 1
        figures.rejected += rejected
        figures.slowest = max(figures.slowest, taken)
        if kind is None and taken > MOST_SECONDS:
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
            figures.failures[kind] = _kept(parser.name, kind, content, folder)
    return figures


def _kept(name: str, kind: str, content: bytes, folder: Path | None) -> str:
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
        "inputs": figures.inputs, "rejected": figures.rejected, "seconds": round(figures.seconds, 1),
        "slowest": round(figures.slowest, 3), "largest": figures.largest, "failures": figures.failures,
    }  # fmt: skip
