"""Whether the GPU can be used here, and why not: its driver, its memory, and a check of the kernels on its first use.

The check (:mod:`svv.fields.devices.gpu_check`) takes about 25 seconds, once: its result is kept for this card, driver,
versions and code. A process of its own runs it, because a fault in a kernel makes all its later work on the GPU fail.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import torch

from svv.errors import BadInput
from svv.io.files.cache import cache_folder
from svv.io.files.keyed_results import digest, key_of, read_record, write_record
from svv.io.files.temporary import work_folder
from svv.kernels import dispatch
from svv.kernels.dispatch import CPU

CHECK = """import sys
sys.path[:] = {paths!r}
from svv.fields.devices.gpu_check import main
main()
"""
"""Program that checks the GPU, for python and pvpython."""

PATIENCE = 300.0
"""Seconds after which a check counts as hung; a first one also compiles all kernels."""

LEAST_MEMORY = 1 << 30
"""Free bytes of GPU memory below which ``auto`` does not choose the GPU: training and images take up to as much."""

RECORDS = "training steps can be recorded"
"""Line of a check that has seen that."""

STOPPED = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL, signal.SIGHUP)
"""Signals that end a check without saying anything about the GPU."""

SKIP_CHECK = "SVV_GPU_CHECK"
"""Environment variable; ``0`` trusts the GPU unchecked, as the check itself must."""


@dataclass(frozen=True)
class Verdict:
    """Result of a check."""

    passed: bool
    """Whether the GPU computes what it should."""
    reason: str
    """What was found, in one sentence."""
    seconds: float = 0.0
    """Time that the check took."""
    records: bool = False
    """Whether training steps can be recorded there (:mod:`svv.kernels.recorded`)."""


def why_no_gpu() -> str | None:
    """Return why torch cannot use a GPU, as a part of a sentence; None if it can."""
    if torch.version.cuda is None:
        return "this torch was built without CUDA"
    if os.environ.get("CUDA_VISIBLE_DEVICES", "all").strip() in ("", "-1"):
        return "CUDA_VISIBLE_DEVICES hides all GPUs"
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        if torch.cuda.is_available():
            return None
        said = " ".join(str(warning.message) for warning in told)
        try:
            torch.cuda.init()
        except (RuntimeError, AssertionError) as error:  # torch says here what is wrong with the driver
            said += f" {error}"
    if "too old" in said or "insufficient" in said:
        return f"the NVIDIA driver is too old for this torch, which needs CUDA {torch.version.cuda}: update the driver"
    if "no NVIDIA driver" in said or "NVIDIA driver" in said:
        return "there is no NVIDIA driver"
    return "torch finds no GPU"


def current_gpu() -> torch.device:
    """Return torch's current GPU, with its number: ``cuda`` and ``cuda:0`` are different keys of dictionaries."""
    return torch.device("cuda", torch.cuda.current_device())


def describe_gpu(device: torch.device) -> str:
    """Return the name of a GPU, and its number if there are several."""
    count = torch.cuda.device_count()
    number = f", number {device.index} of {count}" if count > 1 else ""
    return f"{torch.cuda.get_device_name(device)}{number}"


def key_of_gpu(device: torch.device) -> str:
    """Return what the result of a check is kept for: card, driver, versions of torch and Triton, and our kernels."""
    driver = Path("/proc/driver/nvidia/version")
    known = driver.read_text(encoding="utf-8", errors="replace") if driver.is_file() else ""
    try:
        triton = version("triton")
    except PackageNotFoundError:
        triton = "none"
    capability = torch.cuda.get_device_capability(device)
    folder = Path(dispatch.__file__).parents[1]
    kernels = digest({path.relative_to(folder).as_posix(): path for path in sorted(folder.rglob("*.py"))})
    return key_of(torch.cuda.get_device_name(device), capability, known, torch.__version__, triton, kernels)


def known_verdict(device: torch.device) -> Verdict | None:
    """Return the result of an earlier check of this GPU; None if there was none."""
    record = read_record(_file(device), key_of_gpu(device))
    try:
        return None if record is None else Verdict(**{k: record[k] for k in ("passed", "reason", "seconds", "records")})
    except KeyError:  # written by something else: the GPU is checked again
        return None


def may_record(device: torch.device) -> bool:
    """Return whether training steps may be recorded on a device: a GPU whose check has seen that they are the same."""
    if device.type != "cuda":
        return False
    if os.environ.get(SKIP_CHECK) == "0":
        return True
    verdict = known_verdict(device)
    return verdict is not None and verdict.records


def check_gpu(device: torch.device) -> Verdict:
    """Check a GPU in a process of its own, and keep the result if it says something about the GPU."""
    python = _python()
    if python is None:
        return Verdict(False, "it has not been checked yet: run `svv render` or `svv train` once outside ParaView")
    environment = {**os.environ, SKIP_CHECK: "0", "SVV_COMPILE_AHEAD": "0", "CUDA_VISIBLE_DEVICES": _visible(device)}
    print(f"Checking the GPU ({describe_gpu(device)}), once: about 25 seconds.", file=sys.stderr)
    try:
        with work_folder() as folder:
            program = folder / "check_gpu.py"
            program.write_text(CHECK.format(paths=sys.path), encoding="utf-8")
            done = subprocess.run(
                [str(python), str(program)], env=environment, capture_output=True, text=True, timeout=PATIENCE
            )
    except subprocess.TimeoutExpired:
        return _keep(device, Verdict(False, f"its check did not end within {PATIENCE:.0f} s", PATIENCE))
    except OSError as error:  # no more processes or memory, which says nothing about the GPU
        return Verdict(False, f"its check could not be started ({error.strerror or error})")
    lines = done.stdout.strip().splitlines()
    if done.returncode == 0 and lines:
        return _keep(device, Verdict(True, lines[-1], _seconds(lines[-1]), RECORDS in lines))
    said = (lines or done.stderr.strip().splitlines() or [f"it ended with code {done.returncode}"])[-1]
    if "out of memory" in said.lower():  # by other programs, which says nothing about the GPU
        return Verdict(False, "its check found too little free memory on it")
    if -done.returncode in STOPPED:  # by the user, or by a system that is short of memory
        return Verdict(
            False, f"its check was stopped ({signal.Signals(-done.returncode).name}): it begins again next time"
        )
    return _keep(device, Verdict(False, f"its check failed ({said[:200]})"))


@cache
def chosen_device() -> torch.device:
    """Return the GPU if there is one that works here, otherwise the CPU; says which and why if there is a GPU."""
    reason = why_no_gpu()
    if reason is not None:
        if "driver is too old" in reason:
            print(f"svv runs on the CPU: {reason}.", file=sys.stderr)
        return torch.device("cpu")
    device = current_gpu()
    verdict = _usable(device)
    where = "GPU" if verdict.passed else "CPU"
    print(f"svv runs on the {where}: {describe_gpu(device)}, {verdict.reason}.", file=sys.stderr)
    return device if verdict.passed else torch.device("cpu")


def _usable(device: torch.device) -> Verdict:
    """Return whether a GPU may be chosen."""
    try:
        free, total = torch.cuda.mem_get_info(device)
    except RuntimeError as error:
        return Verdict(False, f"which is in use by another program or not usable ({_first_line(error)})")
    if free < LEAST_MEMORY:
        return Verdict(False, f"of whose {total / 1e9:.1f} GB only {free / 1e9:.1f} GB are free")
    if os.environ.get(SKIP_CHECK) == "0":
        return Verdict(True, "unchecked")
    return known_verdict(device) or check_gpu(device)


def device_named(name: str) -> torch.device:
    """Return the device for the option ``auto``, ``cpu`` or ``cuda``.

    ``auto`` is the GPU if there is one whose kernels pass a check, which takes 25 seconds on its first use; one line
    says which device it is and why if there is a GPU. ``cuda`` is not checked. Raises BadInput if the name is unknown,
    or it is ``cuda`` and torch cannot use a GPU.
    """
    if name not in ("auto", "cpu", "cuda"):
        raise BadInput(f"There is no device '{name}'; choose auto, cpu or cuda.")
    if name == "cpu":
        return CPU
    if name == "auto":
        return chosen_device()
    reason = why_no_gpu()
    if reason is not None:
        raise BadInput(f"CUDA cannot be used here, because {reason}; choose the device cpu or auto.")
    with gpu_errors(torch.device("cuda")):
        return current_gpu()


LOST = ("CUDA error", "CUDA driver error", "device-side assert", "cuBLAS", "NCCL error")
"""Words in the messages with which torch and Triton report that a GPU, or its context, is lost."""


@contextmanager
def gpu_errors(device: torch.device) -> Iterator[None]:
    """Turn a GPU's failure inside the block into BadInput, one sentence that says what to do.

    What was saved before, such as the checkpoint of a training, is whole; the same command goes on from there.
    """
    if device.type != "cuda":
        yield
        return
    go_on = "the same command goes on from what was saved last, with --device cpu on the CPU"
    try:
        yield
    except torch.cuda.OutOfMemoryError as error:
        free, total = _memory(device)
        raise BadInput(
            f"The GPU ran out of memory: {free} of {total} GB are free. End other programs that use it; {go_on}."
        ) from error
    except RuntimeError as error:
        if not any(word in str(error) for word in LOST):
            raise
        raise BadInput(f"The GPU failed ({_first_line(error)}): {go_on}.") from error


def _memory(device: torch.device) -> tuple[str, str]:
    """Return free and total memory of a GPU in GB."""
    try:
        free, total = torch.cuda.mem_get_info(device)
    except RuntimeError:
        return "unknown", "unknown"
    return f"{free / 1e9:.1f}", f"{total / 1e9:.1f}"


def _first_line(error: BaseException) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0][:160]


def _file(device: torch.device) -> Path:
    return cache_folder() / "gpu" / f"{key_of_gpu(device)}.json"


def _keep(device: torch.device, verdict: Verdict) -> Verdict:
    try:
        _file(device).parent.mkdir(parents=True, exist_ok=True)
        write_record(_file(device), key_of_gpu(device), asdict(verdict))
    except (BadInput, OSError) as error:
        print(f"The result of the GPU's check could not be kept ({error}).", file=sys.stderr)
    return verdict


def _python() -> Path | None:
    """Return the program that runs Python here; in ParaView's programs it is the pvpython beside them."""
    programs = [Path(sys.executable or ""), Path("/proc/self/exe").resolve()]
    found = [p for p in programs if p.name.startswith(("python", "pvpython"))]
    found += [p.with_name("pvpython") for p in programs if p.with_name("pvpython").is_file()]
    return found[0] if found else None


def _visible(device: torch.device) -> str:
    """Return the value of CUDA_VISIBLE_DEVICES with which a process sees this GPU alone."""
    own = [word.strip() for word in os.environ.get("CUDA_VISIBLE_DEVICES", "").split(",") if word.strip()]
    number = device.index or 0
    return own[number] if number < len(own) else str(number)


def _seconds(line: str) -> float:
    """Return the seconds that the check's last line names."""
    found = re.search(r"in ([\d.]+) s", line)
    return float(found[1]) if found else 0.0
