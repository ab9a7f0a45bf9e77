"""The parts of the measurement, one after the other, each in a process of its own and within a time of its own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from svv.errors import BadInput, Progress
from svv.fields.devices.gpu import SKIP_CHECK
from svv_bench.gpu.context import BEGUN, RESULTS, Context, add_result

LEAST_SECONDS = 5.0
"""Seconds of the time limit below which no further part is begun."""

LISTEN = 0.2
"""Seconds between two looks at a part's process."""

GRACE = 5.0
"""Seconds that a part has to end after it was told to."""


@dataclass(frozen=True)
class Part:
    """A part of the measurement."""

    name: str
    """Name of its function in :mod:`svv_bench.gpu.measure`, and in the results."""
    title: str
    """What it finds out, for the page."""
    seconds: float
    """Time after which it is stopped, on a GPU."""
    device: str | None = None
    """Device that it measures if it is not the command's."""


PARTS = (
    Part("versions", "Machine", 30),
    Part("kernels", "Kernels against plain torch", 120),
    Part("train", "Training, preset fast", 120),
    Part("train", "The same training on the CPU", 150, "cpu"),
    Part("compare", "Pictures of one scene", 40),
    Part("images", "Images", 40),
    Part("paint", "Painting", 60),
    Part("chart", "Accuracy against time", 90),
    Part("profile", "Steps: launches, waits, traces", 60),
    Part("poison", "Unwritten memory is NaN", 40),
    Part("memory", "Little memory", 40),
    Part("two_cards", "Two cards", 40),
)
"""All parts, in their order: what must be right comes before what is to be fast."""

SLOWER = 3.0
"""Factor on the parts' times where a CPU is measured."""


def parts_named(names: str) -> tuple[Part, ...]:
    """Return the parts with these names, separated by commas, in their own order; ``all`` are all.

    Raises:
        BadInput: There is no part of a name.
    """
    known = list(dict.fromkeys(part.name for part in PARTS))
    asked = known if names == "all" else [name.strip() for name in names.split(",")]
    for name in asked:
        if name not in known:
            raise BadInput(f"There is no part '{name}'; choose among {', '.join(known)}.")
    return tuple(part for part in PARTS if part.name in asked)


def run_parts(how: Context, limit: float, progress: Progress, parts: Sequence[Part] = PARTS) -> None:
    """Run all parts that fit into the time limit; a part that fails, hangs or is killed ends alone.

    Args:
        how: What is measured.
        limit: Seconds that all parts may take together.
        progress: Called several times a second; if it raises, the part that runs is stopped and no other begins.
        parts: The parts.
    """
    (how.out / RESULTS).unlink(missing_ok=True)
    (how.out / "tests.log").unlink(missing_ok=True)
    os.environ[BEGUN] = str(time.time())
    begin = time.monotonic()

    def tell(title: str) -> None:
        progress(min((time.monotonic() - begin) / limit, 0.99), title)

    for part in parts:
        device = part.device or how.device
        if part.device == how.device:  # what it would measure has been measured
            continue
        started = time.monotonic()
        left = limit - (started - begin)
        if left < LEAST_SECONDS:
            add_result(how.out, part.name, device, "ended", {"why": "left out: the time limit was reached"})
            continue
        most = min(left, part.seconds * (SLOWER if device == "cpu" else 1.0))
        why = _run(part, device, how, most, partial(tell, part.title))
        add_result(how.out, part.name, device, "ended", {"why": why, "seconds": time.monotonic() - started})


def _run(part: Part, device: str, how: Context, most: float, tell: Callable[[], None]) -> str:
    """Run a part; returns why it ended, empty if all is well."""
    environment = {
        **os.environ, SKIP_CHECK: "0", "SVV_OFFLINE": "1", "SVV_COMPILE_AHEAD": "0", "PYTHONUNBUFFERED": "1",
        "TRITON_CACHE_DIR": str((how.out / "triton").absolute()),
    }  # fmt: skip
    asked = json.dumps({"part": part.name, "out": str(how.out), "views": str(how.views), "device": device,
                        "shrink": how.shrink, "steps": how.steps})  # fmt: skip
    log = how.out / "log.txt"
    with log.open("a", encoding="utf-8") as file:
        file.write(f"\n===== {part.name} on {device}\n")
        file.flush()
        process = subprocess.Popen(
            [*command(part), asked], env=environment, stdin=subprocess.DEVNULL, stdout=file, stderr=file,
            start_new_session=True,
        )  # fmt: skip
        begin = time.monotonic()
        try:
            while process.poll() is None:
                if time.monotonic() - begin > most:
                    _stop(process)
                    return f"stopped after {most:.0f} s"
                tell()
                time.sleep(LISTEN)
        except BaseException:
            _stop(process)
            raise
    if process.returncode < 0:
        return f"killed ({signal.Signals(-process.returncode).name})"
    if process.returncode == 0:
        return ""
    last = [line.strip() for line in log.read_text(encoding="utf-8", errors="replace").splitlines() if line.strip()]
    return f"failed: {last[-1][:300]}" if last else f"failed with code {process.returncode}"


def command(part: Part) -> list[str]:
    """Return the command that runs a part; what it is to do follows as JSON."""
    return [sys.executable, "-m", "svv_bench.gpu.parts"]


def _stop(process: subprocess.Popen[bytes]) -> None:
    """Stop a part with all that it has started."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        try:
            os.killpg(process.pid, number)
        except ProcessLookupError:
            break
        try:
            process.wait(GRACE)
            break
        except subprocess.TimeoutExpired:
            continue
    process.wait()


def main() -> None:
    """Run the part that the last argument asks for, as JSON."""
    asked = json.loads(sys.argv[-1])
    from svv_bench.gpu import measure

    how = Context(Path(asked["out"]), Path(asked["views"]), asked["device"], asked["shrink"], asked["steps"])
    getattr(measure, asked["part"])(how)


if __name__ == "__main__":
    main()
