"""Choose a build of torch, for the CPU alone or with CUDA, and install it, with Python's standard library alone.

On Linux (x86-64) pip finds a build with CUDA, 5 GB that are useless without an NVIDIA GPU; torch's own index has one
for the CPU alone. ``make`` runs this module before anything is installed.
"""

from __future__ import annotations

import importlib.metadata
import os
import platform
import re
import shutil
import ssl
import subprocess
import sys
import sysconfig
import threading
import urllib.error
import urllib.request
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from svv.errors import BadInput
from svv.pv.launch import installer

INDEX = "https://download.pytorch.org/whl/cpu"
"""Package index of torch's builds without CUDA; SVV_TORCH_INDEX names a mirror."""

CHOICES = ("auto", "cpu", "cuda", "keep")
OLDEST = (2, 2)
ANSWER_WITHIN = 6.0
"""Seconds after which an index that has not answered counts as unreachable."""

ABOUT = {"cpu": "about 0.8 GB", "cuda": "about 5 GB if it has CUDA"}
"""Size of each build on disk, with its dependencies."""


@dataclass(frozen=True)
class Torch:
    """An installed torch."""

    version: str
    """Version, such as 2.13.0+cpu."""
    cuda: bool
    """Whether it was built with CUDA."""

    @property
    def fits(self) -> bool:
        """Whether it is new enough."""
        return tuple(int(part) for part in re.findall(r"\d+", self.version)[:2]) >= OLDEST


@dataclass(frozen=True)
class Plan:
    """How to get torch."""

    source: str
    """``keep`` (the installed one), ``index`` (torch's own index), or ``pip`` (the build that pip finds)."""
    reason: str
    """Reason for the choice, as a part of a sentence."""
    replace: bool = False
    """Whether the other build of the same version must be replaced, which pip would not do by itself."""


def wanted(choice: str | None = None, environ: Mapping[str, str] = os.environ) -> str:
    """Return the user's choice: the argument, or the variable TORCH, or ``auto``; BadInput if it is no choice."""
    word = choice or environ.get("TORCH") or "auto"
    if word not in CHOICES:
        raise BadInput(f"There is no build of torch called '{word}': choose one of {', '.join(CHOICES)}.")
    return word


def installed(folders: Sequence[str | Path] | None = None) -> Torch | None:
    """Return the torch in the folders (by default those that Python searches), or None; it is not imported."""
    path = [str(folder) for folder in folders] if folders is not None else sys.path
    found = next(iter(importlib.metadata.distributions(name="torch", path=path)), None)
    if found is None:
        return None
    try:
        text = Path(str(found.locate_file("torch/version.py"))).read_text()
    except OSError:
        return None  # partly removed
    return Torch(found.version, re.search(r"^cuda\b[^=]*= *['\"]", text, re.MULTILINE) is not None)


def suits(torch: Torch | None, choice: str) -> bool:
    """Return whether the installed torch is what the user wants."""
    if torch is None or not torch.fits:
        return False
    return {"cpu": not torch.cuda, "cuda": torch.cuda or not _pip_finds_cuda()}.get(choice, True)


def has_nvidia_gpu(root: Path = Path("/"), path: str | None = None) -> bool:
    """Return whether there is an NVIDIA GPU that a program could use."""
    if any((root / "proc/driver/nvidia/gpus").glob("*")) or any((root / "dev").glob("nvidia[0-9]*")):
        return True
    program = shutil.which("nvidia-smi", path=path)
    if program is None:
        return False
    try:
        done = subprocess.run([program, "-L"], capture_output=True, text=True, timeout=30)
    except (OSError, subprocess.TimeoutExpired):
        return False
    return done.returncode == 0 and "GPU " in done.stdout


def index(environ: Mapping[str, str] = os.environ) -> str:
    """Return the address of the index with the builds without CUDA."""
    return (environ.get("SVV_TORCH_INDEX") or INDEX).rstrip("/")


def answers(address: str, within: float = ANSWER_WITHIN) -> bool:
    """Return whether an index has torch, or an unknown certificate: pip, which is called next, may know it."""
    found: list[bool] = []

    def ask() -> None:
        try:
            with urllib.request.build_opener().open(f"{address}/torch/", timeout=within):
                found.append(True)
        except urllib.error.URLError as error:
            found.append(isinstance(error.reason, ssl.SSLCertVerificationError))
        except (OSError, ValueError):
            found.append(False)

    # An unresolvable name or a host with many addresses would take longer than the timeout.
    asking = threading.Thread(target=ask, daemon=True)
    asking.start()
    asking.join(within)
    return found == [True]


def plan(choice: str, there: Torch | None) -> Plan:
    """Decide how to get torch, by one of CHOICES and what is there; raise BadInput if there is none to keep."""
    if choice == "keep" and not suits(there, choice):
        raise BadInput(f"There is no torch {'.'.join(map(str, OLDEST))} or newer to keep: choose cpu or cuda.")
    if suits(there, choice):
        return Plan("keep", "is installed already")
    replace = there is not None and there.fits
    if not _pip_finds_cuda():
        return Plan("pip", "which has no CUDA for this system", replace)
    if choice == "cuda":
        return Plan("pip", "as you chose", replace)
    if choice == "auto" and has_nvidia_gpu():
        return Plan("pip", "because there is an NVIDIA GPU", replace)
    if answers(index()):
        return Plan("index", "as you chose" if choice == "cpu" else "because there is no NVIDIA GPU", replace)
    return Plan("pip", f"because {index()} cannot be reached", replace)


def install(choice: str, there: Torch | None, pin: str, *options: str) -> None:
    """Install torch (``pin`` is its requirement) alone, as the user chose, and say which build; or raise BadInput."""
    what = plan(choice, there)
    if what.source == "keep" and there is not None:
        _say(f"torch {there.version} {what.reason}; TORCH=cpu|cuda selects another build.")
        return
    options = ("--no-deps", *options, *(["--force-reinstall"] if what.replace else []))
    if what.source == "index":
        _say(f"torch: the build for the CPU, {ABOUT['cpu']}, {what.reason}; TORCH=cuda selects the other build.")
        if installer.install([pin], "--index-url", index(), *options):
            return
        what = Plan("pip", f"because the download from {index()} failed")
    if choice == "cpu" and _pip_finds_cuda():
        # pip finds a build of that name only if the user has configured further package sources.
        if "==" in pin and installer.install([f"{pin}+cpu"], *options, quiet=True):
            return
        raise BadInput(
            f"torch's build for the CPU is not available, {what.reason}: name a mirror with SVV_TORCH_INDEX or a proxy "
            "with https_proxy, or choose the build that pip finds with TORCH=cuda."
        )
    about = f", {ABOUT['cuda' if _pip_finds_cuda() else 'cpu']}"
    _say(f"torch: the build that pip finds{about}, {what.reason}; TORCH=cpu selects the other build.")
    if not installer.install([pin], *options):
        raise BadInput("pip could not install torch; its messages are above.")


def _pip_finds_cuda() -> bool:
    """Return whether the build that pip finds has CUDA: it does on Linux with x86-64 only."""
    return sys.platform == "linux" and platform.machine() in ("x86_64", "AMD64")


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def main() -> int:
    """Install torch and its dependencies into the running Python; return the exit code.

    The only argument names an output file: svv's constraints.txt with this torch pinned, so that no later installation
    brings in another build.
    """
    file = installer.constraints_file()
    if file is None or len(sys.argv) != 2:
        print("usage: python -m svv.pv.launch.torch_build FILE    (in a checkout)", file=sys.stderr)
        return 2
    pins = installer.pins(file, sys.version_info[:2])
    packages = Path(sysconfig.get_path("purelib"))
    before = installer.size(packages)
    try:
        there = installed()
        install(wanted(), there, next(pin for pin in pins if pin.startswith("torch==")))
        now = installed()
        if now is None:
            raise BadInput("pip has installed torch where this Python does not find it: please report this.")
        pins = [f"torch=={now.version}" if pin.startswith("torch==") else pin for pin in pins]
        Path(sys.argv[1]).write_text("\n".join([*pins, ""]))
        if now != there:
            if not installer.install([f"torch=={now.version}"], "-c", sys.argv[1]):
                raise BadInput("pip could not install what torch needs; its messages are above.")
            _say(f"torch {now.version}: {(installer.size(packages) - before) / 1e9:.1f} GB, with its dependencies.")
    except BadInput as error:
        print(f"svv: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
