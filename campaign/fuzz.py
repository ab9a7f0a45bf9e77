"""Fuzzing of everything that is read: ``python -m campaign.fuzz --parser tf --inputs 1000000 --seed 1``.

Without ``--parser``, all are attacked in turn, each for ``--seconds``; a line of JSON for each is added to
``figures.jsonl`` in ``--out``, and inputs that fail are kept beside it. With ``--guided``, the coverage-guided fuzzer
Atheris chooses the inputs of one of our own parsers (pip install atheris; Python 3.11 to 3.13).
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from campaign import of_pictures, of_scenes, of_tables, of_views
from campaign.running import Extent, Figures, Parser, campaign, kept, plain

PARSERS: Mapping[str, Callable[[Path], Parser]] = {**of_scenes.ALL, **of_views.ALL, **of_tables.ALL}
"""Our own parsers."""

IN_C: Mapping[str, Callable[[Path], Parser]] = of_pictures.ALL
"""Parsers that end in libraries written in C; each runs in a process that is started again after a crash."""

MEMORY = 8 << 30
"""Address space of the campaign: whoever asks for more gets a MemoryError, which is no sentence."""


def fast_folder() -> tempfile.TemporaryDirectory[str]:
    """Return a folder for inputs, in memory if there is such a place."""
    shared = Path("/dev/shm")
    return tempfile.TemporaryDirectory(prefix="svv-campaign-", dir=shared if shared.is_dir() else None)


def attacked(name: str, extent: Extent) -> dict[str, Any]:
    """Attack one parser in this process, and return what was seen."""
    with fast_folder() as folder:
        own = Path(folder) / name
        own.mkdir()
        parser = {**PARSERS, **IN_C}[name](own)
        return {"parser": name, "seed": extent.seed, **plain(campaign(parser, extent))}


def supervised(name: str, extent: Extent) -> dict[str, Any]:
    """Attack one parser in a process of its own, again and again after crashes, and return the sums."""
    whole: dict[str, Any] = {"parser": name, "seed": extent.seed, **plain(Figures()), "ended": 0}
    while whole["inputs"] < extent.inputs and whole["seconds"] < extent.seconds:
        with fast_folder() as folder:
            note = Path(folder) / "input"
            command = [sys.executable, "-m", "campaign.fuzz", "--parser", name, "--note", str(note)]
            command += ["--seed", f"{extent.seed}.{whole['ended']}", "--inputs", str(extent.inputs - whole["inputs"])]
            command += ["--seconds", str(extent.seconds - whole["seconds"])]
            command += [] if extent.folder is None else ["--out", str(extent.folder)]
            done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, check=False)
            if done.returncode >= 0 and done.stdout:
                found = json.loads(done.stdout.splitlines()[-1])
                _add(whole, found)
                break
            if not note.exists():
                raise RuntimeError(f"{' '.join(command)} does not start")
            content = note.read_bytes()
            whole["inputs"] += 1 + int.from_bytes(content[:8], "little")
            whole["ended"] += 1
            kind = f"a crash ({done.returncode})"
            whole["failures"].setdefault(kind, kept(name, kind, content[8:], extent.folder))
    return whole


def _add(whole: dict[str, Any], found: Mapping[str, Any]) -> None:
    for key in ("inputs", "rejected", "crashes", "seconds"):
        whole[key] += found[key]
    for key in ("slowest", "largest"):
        whole[key] = max(whole[key], found[key])
    whole["failures"] |= found["failures"]


def main() -> int:
    """Run the command; its exit code is the number of kinds of failures."""
    options = argparse.ArgumentParser(description=__doc__)
    every = sorted({**PARSERS, **IN_C})
    options.add_argument("--parser", action="append", choices=every, help="One of the parsers; repeatable.")
    options.add_argument("--inputs", type=int, default=1 << 62, help="Most inputs of each parser.")
    options.add_argument("--seconds", type=float, default=60.0, help="Most seconds of each parser.")
    options.add_argument("--seed", default="0", help="Seed of the inputs.")
    options.add_argument("--out", type=Path, help="Folder for results and inputs that fail.")
    options.add_argument("--guided", action="store_true", help="Let Atheris choose the inputs by their coverage.")
    options.add_argument("--note", type=Path, help=argparse.SUPPRESS)
    asked = options.parse_args()
    if asked.out is not None:
        asked.out.mkdir(parents=True, exist_ok=True)
    if asked.guided:
        from campaign.guided import guide

        return guide(asked.parser or sorted(PARSERS), asked.seconds, asked.out)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    failures = 0
    for name in asked.parser or (*PARSERS, *IN_C):
        extent = Extent(asked.seed, asked.inputs, asked.seconds, asked.out, asked.note)
        found = supervised(name, extent) if name in IN_C and asked.note is None else attacked(name, extent)
        line = json.dumps(found)
        print(line, flush=True)
        if asked.out is not None and asked.note is None:
            with (asked.out / "figures.jsonl").open("a") as file:
                file.write(line + "\n")
        failures += len(found["failures"])
    return min(failures, 100)


if __name__ == "__main__":
    sys.exit(main())
