"""Decides which build of torch is installed, and installs it: for the CPU alone, or with CUDA.

On Linux (x86-64) pip finds a build with CUDA, 5 GB that do nothing without an NVIDIA GPU. torch's own index has one
for the CPU alone. Needs nothing beyond Python's own library: ``make`` runs it before anything is installed.
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
from svv.pv import installer

INDEX = "https://download.pytorch.org/whl/cpu"
"""Where torch's builds without CUDA are; SVV_TORCH_INDEX names a mirror."""

CHOICES = ("auto", "cpu", "cuda", "keep")
OLDEST = (2, 2)
ANSWER_WITHIN = 6.0
"""Seconds after which an index that says nothing cannot be reached."""

ABOUT = {"cpu": "about 0.8 GB", "cuda": "about 5 GB where that has CUDA"}
"""On the disk, with the packages that come along."""


@dataclass(frozen=True)
class Torch:
    """A torch that is installed."""

    version: str
    """Such as 2.13.0+cpu."""
    cuda: bool
    """Whether it was built with CUDA."""

    @property
    def fits(self) -> bool:
        """Whether it is new enough."""
        return tuple(int(part) for part in re.findall(r"\d+", self.version)[:2]) >= OLDEST


@dataclass(frozen=True)
class Plan:
    """What is to be done about torch."""

    source: str
    """``keep`` what is there, ``index`` (torch's own), or ``pip`` (what it finds by itself)."""
    reason: str
    replace: bool = False
    """The other build of the same version is there, which pip would take for good."""


def wanted(choice: str | None = None, environ: Mapping[str, str] = os.environ) -> str:
    """The user's choice: the one given, else TORCH, else ``auto``.

    Raises:
        BadInput: it is none of CHOICES.
    """
    word = choice or environ.get("TORCH") or "auto"
    if word not in CHOICES:
        raise BadInput(f"There is no build of torch called '{word}': choose one of {', '.join(CHOICES)}.")
    return word


def installed(folders: Sequence[str | Path] | None = None) -> Torch | None:
    """The torch in the folders (else in those that Python searches); it is not imported."""
    path = [str(folder) for folder in folders] if folders is not None else sys.path
    found = next(iter(importlib.metadata.distributions(name="torch", path=path)), None)
    if found is None:
        return None
    try:
        text = Path(str(found.locate_file("torch/version.py"))).read_text()
    except OSError:
        return None  # half removed
    return Torch(found.version, re.search(r"^cuda\b[^=]*= *['\"]", text, re.MULTILINE) is not None)


def suits(torch: Torch | None, choice: str) -> bool:
    """Whether the torch that is there is what the user wants."""
    if torch is None or not torch.fits:
        return False
    return {"cpu": not torch.cuda, "cuda": torch.cuda or not _pip_finds_cuda()}.get(choice, True)


def has_nvidia_gpu(root: Path = Path("/"), path: str | None = None) -> bool:
    """Whether there is an NVIDIA GPU that a program could use."""
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
    """The address of the index with the builds without CUDA."""
    return (environ.get("SVV_TORCH_INDEX") or INDEX).rstrip("/")


def answers(address: str, within: float = ANSWER_WITHIN) -> bool:
    """Whether an index has torch; asked through the proxy that the environment variables name.

    A certificate that Python does not know counts as an answer: pip may know it, and is asked next.
    """
    found: list[bool] = []

    def ask() -> None:
        try:
            with urllib.request.build_opener().open(f"{address}/torch/", timeout=within):
                found.append(True)
        except urllib.error.URLError as error:
            found.append(isinstance(error.reason, ssl.SSLCertVerificationError))
        except (OSError, ValueError):
            found.append(False)

    # A name that nobody resolves and a host with many addresses take longer than one timeout.
    asking = threading.Thread(target=ask, daemon=True)
    asking.start()
    asking.join(within)
    return found == [True]


def plan(choice: str, there: Torch | None) -> Plan:
    """What to do about torch.

    Args:
        choice: One of CHOICES.
        there: The torch in the environment.

    Raises:
        BadInput: there is none to keep.
    """
    if choice == "keep" and not suits(there, choice):
        raise BadInput(f"There is no torch {'.'.join(map(str, OLDEST))} or newer to keep: choose cpu or cuda.")
    if suits(there, choice):
        return Plan("keep", "is there, and stays")
    replace = there is not None and there.fits
    if not _pip_finds_cuda():
        return Plan("pip", "for this system it has no CUDA anyway", replace)
    if choice == "cuda":
        return Plan("pip", "as you chose", replace)
    if choice == "auto" and has_nvidia_gpu():
        return Plan("pip", "as there is an NVIDIA GPU", replace)
    if answers(index()):
        return Plan("index", "as you chose" if choice == "cpu" else "as there is no NVIDIA GPU", replace)
    return Plan("pip", f"as {index()} cannot be reached", replace)


def install(choice: str, there: Torch | None, pin: str, *options: str) -> None:
    """Install torch alone, without what it depends on, as the user chose; say in a line what comes.

    Args:
        choice: One of CHOICES.
        there: The torch in the environment.
        pin: Requirement, such as torch==2.13.0.
        options: For pip, such as ``--target``.

    Raises:
        BadInput: that build, or any, cannot be had.
    """
    what = plan(choice, there)
    if what.source == "keep" and there is not None:
        _say(f"torch {there.version} {what.reason}; TORCH=cpu|cuda chooses another build.")
        return
    options = ("--no-deps", *options, *(["--force-reinstall"] if what.replace else []))
    if what.source == "index":
        _say(f"torch: its build for the CPU, {ABOUT['cpu']}, {what.reason}; TORCH=cuda chooses the other.")
        if installer.install([pin], "--index-url", index(), *options):
            return
        what = Plan("pip", f"as {index()} broke off")
    if choice == "cpu" and _pip_finds_cuda():
        # Only where pip is set up to look into places of the user's is there a build of that name.
        if "==" in pin and installer.install([f"{pin}+cpu"], *options, quiet=True):
            return
        raise BadInput(
            f"torch's build for the CPU cannot be had, {what.reason}: name a mirror of it with SVV_TORCH_INDEX, "
            "a proxy with https_proxy, or take what pip finds with TORCH=cuda."
        )
    about = f", {ABOUT['cuda' if _pip_finds_cuda() else 'cpu']}"
    _say(f"torch: what pip finds{about}, {what.reason}; TORCH=cpu chooses the other.")
    if not installer.install([pin], *options):
        raise BadInput("pip could not install torch; what it said stands above.")


def _pip_finds_cuda() -> bool:
    """Whether the build that pip finds has CUDA; elsewhere than on Linux with x86-64 it has none."""
    return sys.platform == "linux" and platform.machine() in ("x86_64", "AMD64")


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def main() -> int:
    """Install torch and what it depends on into the Python that runs us; the exit code.

    The one argument names a file: our constraints.txt with this torch pinned, so that nothing installed later brings
    another build.
    """
    file = installer.constraints_file()
    if file is None or len(sys.argv) != 2:
        print("usage: python -m svv.pv.torch_build FILE    (in a checkout)", file=sys.stderr)
        return 2
    pins = installer.pins(file, sys.version_info[:2])
    packages = Path(sysconfig.get_path("purelib"))
    before = installer.size(packages)
    try:
        there = installed()
        install(wanted(), there, next(pin for pin in pins if pin.startswith("torch==")))
        now = installed()
        if now is None:
            raise BadInput("pip has installed torch where this Python does not find it; report this, please.")
        pins = [f"torch=={now.version}" if pin.startswith("torch==") else pin for pin in pins]
        Path(sys.argv[1]).write_text("\n".join([*pins, ""]))
        if now != there:
            if not installer.install([f"torch=={now.version}"], "-c", sys.argv[1]):
                raise BadInput("pip could not install what torch needs; what it said stands above.")
            _say(f"torch {now.version}: {(installer.size(packages) - before) / 1e9:.1f} GB, with what it brings along.")
    except BadInput as error:
        print(f"svv: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
