"""Prepare the environment that provides ParaView with the packages that svv needs, once for each Python version.

It is a folder on PYTHONPATH. If ParaView's Python is compatible with the running one, it links the packages installed
here (:mod:`svv.pv.launch.linked_packages`), and pip adds what is missing; otherwise pip fills it (``--target``).
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.metadata import Distribution
from pathlib import Path

from svv.core.json_values import parsed
from svv.errors import BadInput
from svv.pv.launch import installer, torch_build
from svv.pv.launch.programs import SECOND_VTK, STAMP, ParaView, environment_folder, find, is_whole, python_path

TOO_NEW = "numpy<2.4"
"""numpy 2.4 and newer break ParaView's Calculator and Programmable Filter (tested with ParaView 5.11)."""

ROUNDS = 10
"""Maximum number of rounds in which pip installs the dependencies of the packages of the round before."""


def prepare(folder: str | Path | None = None, torch: str | None = None) -> str:
    """Fill the environment of a ParaView, unless that has been done already; return one line that describes it.

    See :func:`svv.pv.launch.programs.find` for the folder, and :func:`svv.pv.launch.torch_build.wanted` for torch.
    Raises BadInput if there is no ParaView, or the packages cannot be installed or do not work in it.
    """
    choice = torch_build.wanted(torch)
    paraview = find(folder)
    target = environment_folder(paraview)
    packages, pins = requirements(paraview)
    stamp = {
        "python": ".".join(map(str, paraview.python)),
        "packages": hashlib.sha256("\n".join([*packages, *pins]).encode()).hexdigest(),
    }
    line = f"ParaView {'.'.join(map(str, paraview.version))} in {paraview.bin}: its environment is {target}"
    if _read_stamp(target) == stamp and is_whole(target):
        if choice == "auto" or torch_build.suits(torch_build.installed([target]), choice):
            return line
    partial = target.with_name(f"{target.name}.partial")
    try:
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(parents=True)
        beside = _fill(paraview, partial, packages, pins, choice)
        _check(paraview, partial)
        (partial / STAMP).write_text(json.dumps(stamp))
        shutil.rmtree(target, ignore_errors=True)
        partial.replace(target)
    except OSError as error:
        raise BadInput(f"Cannot write the environment {target}: {error.strerror or error}.") from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return f"{line}, {installer.size(target) / 1e6:.0f} MB{beside}"


def requirements(paraview: ParaView) -> tuple[list[str], list[str]]:
    """Return the environment's requirements (svv's dependencies without its extras) and the exact versions for pip."""
    file = installer.constraints_file()
    return [*sorted(_dependencies()), TOO_NEW], installer.pins(file, paraview.python) if file else []


def _dependencies() -> list[str]:
    """Return svv's dependencies without its extras, according to the checkout or the installed package."""
    try:
        import tomllib

        with (Path(__file__).resolve().parents[3] / "pyproject.toml").open("rb") as file:
            return list(tomllib.load(file)["project"]["dependencies"])
    except (ImportError, OSError):
        pass
    try:
        found = importlib.metadata.requires("svv") or []
    except importlib.metadata.PackageNotFoundError as error:
        raise BadInput("The dependencies of svv are unknown: install svv with pip, or use a checkout.") from error
    return [line for line in found if "extra ==" not in line]


def _fill(paraview: ParaView, folder: Path, packages: list[str], pins: list[str], choice: str) -> str:
    """Fill an empty folder with packages, or with links to those installed here; return a note about the links."""
    constraints = folder / "constraints.txt"
    constraints.write_text("\n".join(pins))
    options = ["--target", str(folder), "-c", str(constraints)]
    if _takes_our_packages(paraview):
        _share(folder, packages, pins, choice, options)
        return f", and links to the packages in {sys.prefix}"
    print(f"Installing into {folder.with_suffix('')}: a few minutes, once.", file=sys.stderr, flush=True)
    if paraview.python != sys.version_info[:2]:
        options += ["--python-version", ".".join(map(str, paraview.python)), "--only-binary=:all:"]
    # Install torch separately, as its index has little else; then the other packages and torch's dependencies in one
    # call, because pip does not see what an earlier call has put into a --target.
    _install_torch(folder, pins, choice, options)
    (torch,) = importlib.metadata.distributions(name="torch", path=[str(folder)])
    others = [package for package in packages if not _is_torch(package)]
    others += [line for line in torch.requires or [] if "extra ==" not in line]
    if not installer.install(others, *options):
        raise BadInput("pip could not install what svv needs for ParaView; its messages are above.")
    return ""


def _share(folder: Path, packages: list[str], pins: list[str], choice: str, options: list[str]) -> None:
    """Link the packages that are installed here into a folder, and let pip add the others."""
    from svv.pv.launch import linked_packages

    def accept(package: Distribution) -> bool:
        if package.metadata["Name"] != "torch":
            return True
        return torch_build.suits(torch_build.installed([str(package.locate_file(""))]), choice)

    path = [str(folder), *(entry for entry in sys.path if entry)]
    for _ in range(ROUNDS):
        fitting, missing = linked_packages.search(packages, path, accept)
        if not missing:
            linked_packages.link(fitting, folder, SECOND_VTK)
            return
        names = sorted({re.split(r"[<>=!~]", requirement)[0] for requirement in missing})
        print(f"Installing packages that are missing or do not fit: {', '.join(names)}.", file=sys.stderr, flush=True)
        if any(map(_is_torch, missing)):
            _install_torch(folder, pins, choice, options)
            missing = [package for package in missing if not _is_torch(package)]
        if missing and not installer.install(missing, "--no-deps", *options):
            raise BadInput("pip could not install what svv needs for ParaView; its messages are above.")
    raise BadInput(
        f"The packages that svv needs for ParaView are not compatible with each other: {', '.join(missing)}."
    )


def _takes_our_packages(paraview: ParaView) -> bool:
    """Return whether the running Python's compiled packages load in ParaView's Python, and there are any."""
    if paraview.python != sys.version_info[:2] or importlib.util.find_spec("packaging") is None:
        return False
    ask = "from importlib.machinery import EXTENSION_SUFFIXES; print('svv:', EXTENSION_SUFFIXES[0])"
    bare = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PV_PLUGIN_PATH")}
    done = subprocess.run([paraview.program("pvpython"), "-c", ask], env=bare, capture_output=True, text=True)
    return f"svv: {EXTENSION_SUFFIXES[0]}" in done.stdout.splitlines()


def _install_torch(folder: Path, pins: list[str], choice: str, options: list[str]) -> None:
    pin = next(filter(_is_torch, pins), f"torch>={'.'.join(map(str, torch_build.OLDEST))}")
    torch_build.install(choice, None, pin, *options)


def _is_torch(requirement: str) -> bool:
    return requirement.startswith("torch") and not requirement[5:6].isalpha()


def _check(paraview: ParaView, folder: Path) -> None:
    """Check in ParaView itself that the packages work, and that they include no second VTK."""
    clash = [name for name in SECOND_VTK if (folder / name).exists()]
    if clash:
        raise BadInput(f"The environment contains a second VTK ({', '.join(clash)}): please report this.")
    environ = {**os.environ, "PYTHONPATH": os.pathsep.join(python_path(paraview, folder, {}))}
    environ.pop("PV_PLUGIN_PATH", None)
    script = "import vtkmodules, numpy, svv, torch, numba, skimage, scipy; print('svv: all there', svv.__file__)"
    done = subprocess.run([paraview.program("pvpython"), "-c", script], env=environ, capture_output=True, text=True)
    if "svv: all there" not in done.stdout:
        last = (done.stderr.strip().splitlines() or ["it ended without a message"])[-1]
        raise BadInput(f"The packages are installed, but ParaView's Python does not load them: {last}.")


def _read_stamp(target: Path) -> object:
    try:
        return parsed((target / STAMP).read_text())
    except (OSError, ValueError):
        return None
