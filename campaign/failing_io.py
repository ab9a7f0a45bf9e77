"""Lets every call of the file system of a command fail once: ``python -m campaign.failing_io --command train``.

Each call fails in a run of its own, with each of the errors. The command then has to end with one sentence, or go on
without what it could not read or write; it leaves no half-written file, and the next run ends well.
"""

from __future__ import annotations

import argparse
import errno
import itertools
import json
import os
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field
from pathlib import Path

from campaign import small
from campaign.calls import Seen, watched

ERRORS = ("ENOSPC", "EIO", "EACCES", "EROFS", "EDQUOT", "EINTR")

COMMANDS = ("train", "stylize", "run", "render", "movie", "edit", "views", "page", "cinema", "volume")


@dataclass
class Failure:
    """One call that failed."""

    command: str
    number: int
    """Number of the call."""
    kind: str
    path: str
    error: str
    code: int
    """Exit code of the command."""
    wrong: list[str] = field(default_factory=list)


_until_the_end = ExitStack()


def watching(folder: Path, seen: Seen) -> None:
    """Watch the rest of this process, which is a fork."""
    _until_the_end.enter_context(watched(str(folder.parent), seen))


def calls_of(name: str, inputs: Path, folder: Path) -> tuple[list[tuple[str, str]], dict[str, bytes]]:
    """Return the calls of a run of a command, as kind and path, and the files that it leaves."""
    small.fresh(inputs, folder)
    log = folder.with_name("calls")

    def before() -> None:
        file = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        watching(folder, lambda kind, path: os.write(file, f"{kind}\t{path}\n".encode()))

    done = small.ended(small.forked(small.COMMANDS[name], folder, before))
    assert done.code == 0, done.said
    calls = [line.split("\t") for line in log.read_text().splitlines()]
    return [(kind, path) for kind, path in calls], small.files_in(folder)


def hidden(name: str) -> bool:
    """Return whether a file is hidden, or in a hidden folder: what could not be removed may stay there."""
    return any(part.startswith(".") for part in Path(name).parts)


def failed_once(name: str, number: int, error: str, inputs: Path, folder: Path, known: dict[str, bytes]) -> Failure:
    """Let the call of this number fail in a run of a command, look at what it left, and run it again."""
    small.fresh(inputs, folder)
    before = small.files_in(folder)
    note = folder.with_name("failed")
    note.unlink(missing_ok=True)

    def fail() -> None:
        count = itertools.count()
        file = os.open(note, os.O_WRONLY | os.O_CREAT, 0o600)

        def seen(kind: str, path: str) -> None:
            if next(count) == number:
                os.write(file, f"{kind}\t{path}".encode())
                code = getattr(errno, error)
                raise OSError(code, os.strerror(code), *([path] if kind not in ("write", "fsync") else []))

        watching(folder, seen)

    done = small.ended(small.forked(small.COMMANDS[name], folder, fail))
    kind, _, path = note.read_text().partition("\t")
    found = Failure(name, number, kind, path.removeprefix(str(folder.parent)), error, done.code)
    if (
        done.code not in (0, 2)
        or "Traceback" in done.said
        or (done.code == 2 and not done.sentence.startswith("svv: "))
    ):
        found.wrong.append(f"{done.code} {done.said[-1500:]}")
    now = small.files_in(folder)
    found.wrong += [f"{file} is another file or gone" for file in before if now.get(file) != before[file]]
    found.wrong += [f"after the failure: {text}" for text in small.cannot_open(folder)]
    if done.code == 0 and {f for f in now if not hidden(f)} != set(known):
        found.wrong.append(f"it went on, but left other files: {sorted(set(now) ^ set(known))}")
    again = small.ended(small.forked(small.COMMANDS[name], folder))
    if again.code:
        found.wrong.append(f"the same command again: {again.code} {again.said[-800:]}")
    elif set(small.files_in(folder)) != set(known):
        found.wrong.append(f"in the end, other files: {sorted(set(small.files_in(folder)) ^ set(known))}")
    found.wrong += [f"in the end: {text}" for text in small.cannot_open(folder)]
    return found


def failures(
    names: Sequence[str], all_errors: bool, inputs: Path, folder: Path, until: float = float("inf"), every: int = 1
) -> Iterator[Failure]:
    """Let each call of commands fail: with each error, or with one, in turn."""
    for name in names:
        calls, known = calls_of(name, inputs, folder)
        print(name, len(calls), dict(Counter(kind for kind, _ in calls)), flush=True)
        for number in range(0, len(calls), every):
            for error in ERRORS if all_errors else [ERRORS[number // every % len(ERRORS)]]:
                if time.monotonic() > until:
                    return
                yield failed_once(name, number, error, inputs, folder, known)


def main() -> None:
    """Run the campaign and write its table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--command", default=",".join(COMMANDS))
    parser.add_argument("--one-error", action="store_true", help="let each call fail with one of the errors only")
    parser.add_argument("--every", type=int, default=1, help="leave out calls between each of this number")
    parser.add_argument("--minutes", type=float, default=float("inf"))
    parser.add_argument("--out", type=Path, default=Path("failing_io.json"))
    chosen = parser.parse_args()
    names = chosen.command.split(",")
    with tempfile.TemporaryDirectory() as place:
        small.be_small()
        inputs = small.prepare(Path(place) / "inputs", names)
        until = time.monotonic() + 60.0 * chosen.minutes
        done: list[Failure] = []
        work = Path(place) / "place" / "w"
        work.parent.mkdir()
        for one in failures(names, not chosen.one_error, inputs, work, until, chosen.every):
            done.append(one)
            if one.wrong:
                print(one, flush=True)
            if len(done) % 50 == 0:
                chosen.out.write_text(json.dumps([asdict(f) for f in done], indent=1))
        chosen.out.write_text(json.dumps([asdict(f) for f in done], indent=1))
    bad = sum(bool(one.wrong) for one in done)
    print(f"{len(done)} failed calls, {bad} with something wrong; exit codes {dict(Counter(one.code for one in done))}")
    sys.exit(bool(bad))


if __name__ == "__main__":
    small.in_one_thread("campaign.failing_io")
    main()
