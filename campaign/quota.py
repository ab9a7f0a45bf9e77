"""Runs every command under a quota of a real file system: ``python -m campaign.quota --on DIR``.

DIR lies on Btrfs, whose quotas hold for everybody, root included:

    truncate -s 1G /var/tmp/quota.img && mkfs.btrfs -q /var/tmp/quota.img
    mkdir -p /mnt/quota && mount -o loop /var/tmp/quota.img /mnt/quota && btrfs quota enable /mnt/quota

A command may then write only a part of what it needs. It has to end with one sentence, leave what was there before as
it was and no half-written file, and end well once it may write all.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from campaign import small

PARTS = (0.0, 0.1, 0.25, 0.5, 0.75, 0.9)
"""Parts of what a command writes that it may write."""

COMMANDS = ("views", "train", "stylize", "edit", "render", "movie", "page", "cinema", "volume", "run")


def btrfs(*arguments: object) -> str:
    """Run a program of btrfs-progs."""
    return subprocess.run(["btrfs", *map(str, arguments)], check=True, capture_output=True, text=True).stdout


def used(folder: Path) -> int:
    """Return the bytes that a subvolume counts against its quota, after everything has been written."""
    btrfs("filesystem", "sync", folder)
    return int(btrfs("qgroup", "show", "--raw", "-f", folder).splitlines()[-1].split()[1])


def limit(folder: Path, quota: int | str) -> None:
    """Set a subvolume's quota in bytes; ``none`` for none."""
    number = btrfs("qgroup", "show", "--raw", "-f", folder).splitlines()[-1].split()[0]
    btrfs("qgroup", "limit", quota, number, folder.parent)  # a full subvolume cannot be asked itself


def refilled(inputs: Path, folder: Path) -> None:
    """Make a subvolume the command's folder as it is at first, without a quota."""
    limit(folder, "none")
    for path in folder.iterdir():
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    shutil.rmtree(folder.with_name(f"{folder.name}.home"), ignore_errors=True)
    shutil.copytree(inputs, folder, dirs_exist_ok=True)


def under(quota: int, name: str, inputs: Path, folder: Path, known: Sequence[str]) -> tuple[int, str, list[str]]:
    """Run a command under a quota, and then without; return its exit code, its sentence and what was wrong."""
    refilled(inputs, folder)
    before, wrong = small.files_in(folder), []
    limit(folder, quota)
    done = small.ended(small.forked(small.COMMANDS[name], folder))
    if done.code not in (0, 2) or "Traceback" in done.said:
        wrong.append(f"{done.code} {done.said[-1500:]}")
    if done.code == 2 and not done.sentence.startswith("svv: "):
        wrong.append(f"no sentence: {done.sentence}")
    now = small.files_in(folder)
    wrong += [f"{file} is another file or gone" for file in before if now.get(file) != before[file]]
    wrong += [f"under the quota: {text}" for text in small.cannot_open(folder)]
    limit(folder, "none")
    again = small.ended(small.forked(small.COMMANDS[name], folder))
    if again.code or sorted(small.files_in(folder)) != sorted(known):
        wrong.append(f"without it: {again.code} {again.said[-800:]} {sorted(set(small.files_in(folder)) ^ set(known))}")
    return done.code, done.sentence, wrong + [f"in the end: {text}" for text in small.cannot_open(folder)]


def main() -> None:
    """Run the campaign and write its table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--on", type=Path, required=True, help="a folder on Btrfs with quotas enabled")
    parser.add_argument("--command", default=",".join(COMMANDS))
    parser.add_argument("--out", type=Path, default=Path("quota.json"))
    given = parser.parse_args()
    names, found = given.command.split(","), list[dict[str, Any]]()
    folder = given.on.resolve() / "w"
    btrfs("subvolume", "create", folder)
    with tempfile.TemporaryDirectory() as place:
        small.be_small()
        inputs = small.prepare(Path(place) / "inputs", names)
        for name in names:
            refilled(inputs, folder)
            base = used(folder)
            done = small.ended(small.forked(small.COMMANDS[name], folder))
            assert done.code == 0, done.said
            known, whole = sorted(small.files_in(folder)), used(folder) - base
            for part in PARTS:
                code, sentence, wrong = under(base + int(part * whole), name, inputs, folder, known)
                found.append({"command": name, "part": part, "code": code, "sentence": sentence, "wrong": wrong})
                print(name, whole, part, code, sentence, *wrong, sep="  ", flush=True)
                given.out.write_text(json.dumps(found, indent=1))
    btrfs("subvolume", "delete", folder)
    bad = sum(bool(one["wrong"]) for one in found)
    print(f"{len(found)} runs, {bad} with something wrong; exit codes {dict(Counter(one['code'] for one in found))}")
    sys.exit(bool(bad))


if __name__ == "__main__":
    small.in_one_thread("campaign.quota")
    main()
