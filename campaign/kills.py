"""Kills every long command at random moments: ``python -m campaign.kills --times 40 --seed 0 --out kills.json``.

After each kill, what existed before must still open, no file with a final name may be half written, and no process may
go on. The same command then has to end well, with the files of an undisturbed run and no others.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path

from campaign import small

SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)

IN_A_ROW = 4
"""Kills of a command, each of which goes on where the one before stopped, before it may end."""

PATIENCE = 20.0
"""Seconds after which a command that was asked to stop must have ended."""


@dataclass
class Known:
    """An undisturbed run of a command."""

    seconds: float
    files: dict[str, bytes] = field(repr=False)


@dataclass
class Trial:
    """A command that was killed several times in a row, and then ran to its end."""

    command: str
    again: bool
    """Whether the command replaced its own earlier result."""
    kills: list[tuple[str, float, int]] = field(default_factory=list)
    """Signal, seconds into the command, and exit code of each kill."""
    repeated: float = 0.0
    """Seconds of work done twice per kill, at most: all runs together, less one undisturbed run."""
    wrong: list[str] = field(default_factory=list)


def undisturbed(name: str, inputs: Path, folder: Path) -> Known:
    """Run a command alone; the second of two runs is timed."""
    for _ in range(2):
        done = small.ended(small.forked(small.COMMANDS[name], small.fresh(inputs, folder)))
        assert done.code == 0, done.said
    return Known(done.seconds, small.files_in(folder))


def trial(name: str, moments: Sequence[tuple[signal.Signals, float]], known: Known, folder: Path) -> Trial:
    """Kill a command at moments, in seconds; look at what it left each time, and let it end."""
    before = small.files_in(folder)
    found, spent = Trial(name, any(Path(file).parts[0].startswith("out") for file in before)), 0.0
    for sent, after in moments:
        run = small.forked(small.COMMANDS[name], folder)
        time.sleep(after)
        with suppress(ProcessLookupError):
            os.kill(run.process, sent)
        done = small.ended(run, PATIENCE)
        found.kills.append((sent.name, after, done.code))
        found.wrong += [f"how it ended: {text}" for text in ended_badly(done, sent)]
        found.wrong += [f"after the kill: {text}" for text in lost(before, folder)]
        found.wrong += [f"process {number} goes on" for number in still_running(run.process)]
        spent += done.seconds
    last = small.ended(small.forked(small.COMMANDS[name], folder))
    if last.code:
        found.wrong.append(f"the same command again: {last.code} {last.said[-800:]}")
    else:
        found.wrong += [f"in the end: {text}" for text in differences(name, known, folder)]
    found.repeated = max(0.0, spent + last.seconds - known.seconds) / len(moments)
    return found


def ended_badly(done: small.Ended, sent: signal.Signals) -> Iterator[str]:
    """Say what is wrong with how a killed command ended: with the signal, or with one sentence, or as if not killed."""
    if done.code == 0 or done.code == -sent:  # before the command has begun, SIGTERM and SIGINT also kill
        return
    if done.code != 130 or "Traceback" in done.said:
        yield f"{done.code} {done.said[-800:]}"


def lost(before: dict[str, bytes], folder: Path) -> Iterator[str]:
    """Say which files of before are gone or no longer open, and which new ones do not open."""
    now = small.files_in(folder)
    for name in before:
        own = Path(name).parts[0].split(".")[0] == "out" or name.startswith(".")
        if not own and now.get(name) != before[name]:
            yield f"{name} is another file or gone"
    yield from small.cannot_open(folder)


def still_running(session: int) -> list[int]:
    """Return processes of the killed command that have not ended by themselves a while later."""
    limit = time.monotonic() + 10.0
    while (found := small.left_running(session)) and time.monotonic() < limit:
        time.sleep(0.05)
    return found


def differences(name: str, known: Known, folder: Path) -> Iterator[str]:
    """Say how the files of a command differ from those of an undisturbed run."""
    now = small.files_in(folder)
    if sorted(now) != sorted(known.files):
        yield f"other files: {sorted(set(now) ^ set(known.files))}"
    if name in small.DRAWN:
        same = (file for file in now if file.endswith((".png", ".vti")) and file in known.files)
        yield from (f"{file} has other pixels" for file in same if now[file] != known.files[file])
    yield from small.cannot_open(folder)


def trials(
    names: Sequence[str], times: int, seed: int, inputs: Path, folder: Path, until: float = float("inf")
) -> Iterator[Trial]:
    """Kill each command a number of times, in turn, until a moment of ``time.monotonic``."""
    at_random, known = random.Random(seed), {}
    for number in range(-(-times // IN_A_ROW)):
        for name in names:
            if time.monotonic() > until:
                return
            if name not in known:
                known[name] = undisturbed(name, inputs, folder)
            small.fresh(inputs, folder)
            if number % 4 == 3:  # on top of a finished result
                small.ended(small.forked(small.COMMANDS[name], folder))
                if name == "run":  # of other settings, or nothing would be done
                    record = json.loads((folder / "out" / "stages.json").read_text())
                    record["train"]["key"] = "other"
                    (folder / "out" / "stages.json").write_text(json.dumps(record))
            longest = 1.05 * known[name].seconds
            moments = [(at_random.choice(SIGNALS), at_random.uniform(0.0, longest)) for _ in range(IN_A_ROW)]
            yield trial(name, moments, known[name], folder)


def main() -> None:
    """Run the campaign and write its table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--command", default=",".join(small.COMMANDS))
    parser.add_argument("--times", type=int, default=100, help="kills of each command")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=float("inf"))
    parser.add_argument("--out", type=Path, default=Path("kills.json"))
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        small.be_small()
        inputs = small.prepare(Path(place) / "inputs", chosen.command.split(","))
        until = time.monotonic() + 60.0 * chosen.minutes
        done: list[Trial] = []
        for one in trials(chosen.command.split(","), chosen.times, chosen.seed, inputs, Path(place) / "w", until):
            done.append(one)
            if one.wrong:
                print(one, flush=True)
            if len(done) % 20 == 0:
                chosen.out.write_text(json.dumps([asdict(t) for t in done], indent=1))
        chosen.out.write_text(json.dumps([asdict(t) for t in done], indent=1))
    bad = sum(bool(one.wrong) for one in done)
    most = max((one.repeated for one in done), default=0.0)
    kills = sum(len(one.kills) for one in done)
    print(f"{kills} kills of {len(done)} commands, {bad} with something wrong; one repeated {most:.1f} s at most")
    sys.exit(bool(bad))


if __name__ == "__main__":
    small.in_one_thread("campaign.kills")
    main()
