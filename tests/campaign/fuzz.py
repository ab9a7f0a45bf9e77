"""Fuzzing of our own parsers, by command: ``python -m tests.campaign.fuzz --parser tf --inputs 1000000 --seed 1``.

Without ``--parser``, all are attacked in turn, each for its share of ``--seconds``; a line of JSON for each is added to
``--out``, and inputs that fail are kept beside it. With ``--guided``, the coverage-guided fuzzer Atheris chooses the
inputs (pip install atheris).
"""

from __future__ import annotations

import argparse
import json
import resource
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

from tests.campaign import of_scenes, of_tables, of_views
from tests.campaign.running import Parser, campaign, plain

PARSERS: Mapping[str, Callable[[Path], Parser]] = {**of_scenes.ALL, **of_views.ALL, **of_tables.ALL}

MEMORY = 8 << 30
"""Address space of the campaign: whoever asks for more gets a MemoryError, which is no sentence."""


def fast_folder() -> tempfile.TemporaryDirectory[str]:
    """Return a folder for inputs, in memory if there is such a place."""
    shared = Path("/dev/shm")
    return tempfile.TemporaryDirectory(prefix="svv-campaign-", dir=shared if shared.is_dir() else None)


def attacked(name: str, seed: int, inputs: int, seconds: float, out: Path | None) -> dict[str, object]:
    """Attack one parser, and return what was seen."""
    with fast_folder() as folder:
        own = Path(folder) / name
        own.mkdir()
        return {"parser": name, "seed": seed, **plain(campaign(PARSERS[name](own), seed, inputs, seconds, out))}


def main() -> int:
    """Run the command; its exit code is the number of kinds of failures."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--parser", action="append", choices=sorted(PARSERS), help="One of the parsers; repeatable.")
    options.add_argument("--inputs", type=int, default=1 << 62, help="Most inputs of each parser.")
    options.add_argument("--seconds", type=float, default=60.0, help="Most seconds of each parser.")
    options.add_argument("--seed", type=int, default=0, help="Seed of the inputs.")
    options.add_argument("--out", type=Path, help="Folder for results and inputs that fail.")
    options.add_argument("--guided", action="store_true", help="Let Atheris choose the inputs by their coverage.")
    asked = options.parse_args()
    if asked.out is not None:
        asked.out.mkdir(parents=True, exist_ok=True)
    if asked.guided:
        from tests.campaign.guided import guide

        return guide(asked.parser or sorted(PARSERS), asked.seconds, asked.seed, asked.out)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    failures = 0
    for name in asked.parser or PARSERS:
        found = attacked(name, asked.seed, asked.inputs, asked.seconds, asked.out)
        line = json.dumps(found)
        print(line, flush=True)
        if asked.out is not None:
            with (asked.out / "figures.jsonl").open("a") as file:
                file.write(line + "\n")
        failures += len(plain_failures(found))
    return min(failures, 100)


def plain_failures(found: Mapping[str, object]) -> dict[str, str]:
    """Return the failures among what was seen of a parser."""
    failures = found["failures"]
    assert isinstance(failures, dict)
    return failures


if __name__ == "__main__":
    sys.exit(main())
