"""Coverage-guided fuzzing of our own parsers with Atheris, which watches the branches of svv that an input reaches.

Atheris mutates bytes; a number in front of them chooses a generated input of the campaign to begin with, so that it
also reaches what a header of several kilobytes opens.
"""

from __future__ import annotations

import resource
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from random import Random
from types import FunctionType

from campaign.running import Parser, kept, outcome

SEEDS = 200
"""Inputs that the generator gives Atheris to begin with."""


def _own_functions() -> list[FunctionType]:
    """Return the functions and methods of svv's modules that readers use; compiled ones have no branches to watch."""
    found: dict[int, FunctionType] = {}
    for name, module in list(sys.modules.items()):
        if not name.startswith("svv.") or name.startswith(("svv.kernels", "svv.train", "svv.cli")):
            continue
        for held in vars(module).values():
            every = [held, *(vars(held).values() if isinstance(held, type) else ())]
            every = [getattr(one, "__func__", getattr(one, "fget", one)) for one in every]
            own = [one for one in every if isinstance(one, FunctionType) and one.__module__ == name]
            found |= {id(one): one for one in own}
    return list(found.values())


def guide(names: Sequence[str], seconds: float, out: Path | None) -> int:
    """Attack one parser until the time is over; the number of kinds of failures is the exit code.

    Atheris runs one target in a process and ends it, so only the first name is used.
    """
    try:
        import atheris
    except ImportError:
        print("Atheris is not installed: pip install 'svv[campaign]' (Python 3.11 to 3.13).", file=sys.stderr)
        return 2
    from campaign import fuzz

    folder = Path(tempfile.mkdtemp(prefix="svv-guided-", dir="/dev/shm" if Path("/dev/shm").is_dir() else None))
    parser: Parser = fuzz.PARSERS[names[0]](folder)
    resource.setrlimit(resource.RLIMIT_AS, (fuzz.MEMORY, fuzz.MEMORY))
    corpus, random = folder / "corpus", Random(names[0])
    corpus.mkdir()
    for number in range(SEEDS):
        (corpus / str(number)).write_bytes(parser.make(random))
    seen: set[str] = set()

    def one(content: bytes) -> None:
        if not content:
            return
        kind, _ = outcome(parser.read, content)
        if kind is not None and kind not in seen:
            seen.add(kind)
            print(f"{names[0]}: {kind}: {kept(names[0], kind, content, out)}", flush=True)

    for function in _own_functions():
        atheris.instrument_func(function)
    limits = [f"-max_total_time={int(seconds)}", "-max_len=65536"]
    atheris.Setup([sys.argv[0], *limits, str(corpus)], one)
    atheris.Fuzz()
    return len(seen)
