"""A folder of links to packages: it contains svv's dependencies and nothing else of an environment."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

import pytest

from svv.errors import BadInput
from svv.pv.launch import linked_packages, prepare, programs, torch_build
from tests.wheels import make_installed, make_torch, make_wheel


@pytest.fixture
def packages(tmp_path: Path) -> Path:
    """An environment in which VTK, pyvista and matplotlib stand beside what svv needs."""
    folder = tmp_path / "site-packages"
    make_torch(make_installed, folder, "2.13.0+cpu", None)
    make_installed(folder, "numpy", "2.3.5")
    make_installed(folder, "scikit-image", "0.26.0", ["numpy>=1.24", "Lazy_Loader", "matplotlib; extra == 'plot'"])
    make_installed(folder, "lazy-loader", "0.6", ["nothing-here; python_version < '3'", "numpy[fast]"])
    for name in ("vtk", "vtkmodules", "pyvista", "matplotlib"):
        make_installed(folder, name, "9")
    return folder


NEEDED = ["numpy>=1.24", "scikit-image>=0.22", "torch>=2.2", "numpy<2.4"]


def names(found: list) -> set[str]:
    return {package.metadata["Name"] for package in found}


def anything(package: object) -> bool:
    return True


def test_the_links_lead_to_what_is_needed_and_nothing_else(packages: Path, tmp_path: Path) -> None:
    fitting, missing = linked_packages.search(NEEDED, [str(packages)], anything)
    assert (names(fitting), missing) == ({"numpy", "scikit-image", "lazy-loader", "torch"}, [])
    folder = tmp_path / "environment"
    folder.mkdir()
    linked_packages.link(fitting, folder, programs.SECOND_VTK)
    modules = {"numpy", "scikit_image", "lazy_loader", "torch"}
    assert {name for name in os.listdir(folder) if not name.endswith("-info")} == modules
    assert not programs.holds_second_vtk(folder)
    ask = f"import {', '.join(sorted(modules))}, importlib.metadata; print(importlib.metadata.version('lazy_loader'))"
    command = [sys.executable, "-S", "-c", ask]
    done = subprocess.run(command, env={"PYTHONPATH": str(folder)}, capture_output=True, text=True)
    assert done.stdout == "0.6\n", done.stderr


def test_what_is_missing_or_does_not_fit_is_named_and_not_linked(packages: Path) -> None:
    make_installed(packages, "numba", "0.60", ["llvmlite", "numpy>=2"])
    fitting, missing = linked_packages.search([*NEEDED, "numba", "scipy>=1.11", "numpy<2.3"], [str(packages)], anything)
    numpy = ["numpy", "numpy<2.3", "numpy<2.4", "numpy>=1.24", "numpy>=2"]
    assert sorted(missing) == ["llvmlite", *numpy, "scipy>=1.11"]
    assert names(fitting) == {"numba", "scikit-image", "lazy-loader", "torch"}


def test_a_package_without_a_list_of_its_files_is_not_shared(packages: Path) -> None:
    (packages / "numpy-2.3.5.dist-info" / "RECORD").unlink()
    fitting, missing = linked_packages.search(["numpy>=1.24"], [str(packages)], anything)
    assert (fitting, missing) == ([], ["numpy>=1.24"])


def test_a_namespace_of_several_folders_is_put_together(tmp_path: Path) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    make_installed(one, "nvidia-cublas", "13", more={"nvidia/cublas/lib/libcublas.so": "1"})
    make_installed(one, "nvidia-cudnn", "9", more={"nvidia/cudnn/lib/libcudnn.so": "2"})
    make_installed(two, "nvidia-nccl", "2", more={"nvidia/nccl/lib/libnccl.so": "3"})
    folder = tmp_path / "environment"
    folder.mkdir()
    fitting, _ = linked_packages.search(
        ["nvidia-cublas", "nvidia-cudnn", "nvidia-nccl"], [str(one), str(two)], anything
    )
    linked_packages.link(fitting, folder, ())
    linked_packages.link(fitting, folder, ())
    assert sorted(os.listdir(folder / "nvidia")) == ["cublas", "cudnn", "nccl"]
    assert [(folder / f"nvidia/{n}/lib/lib{n}.so").read_text() for n in ("cublas", "cudnn", "nccl")] == ["1", "2", "3"]
    assert sorted(os.listdir(one / "nvidia")) == ["cublas", "cudnn"]


@pytest.fixture
def from_here(packages: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The options for a pip that knows what lies in a folder, and nothing else; the environment is the made-up one."""
    alone, real = tmp_path / "pip", importlib.util.find_spec("pip")
    alone.mkdir()
    if real is not None and real.origin is not None:  # else there is one on the PATH
        (alone / "pip").symlink_to(Path(real.origin).parent)
    monkeypatch.setattr("svv.pv.launch.prepare.sys.path", [str(packages), str(alone)])
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", (tmp_path / "wheels").as_uri())
    (tmp_path / "wheels").mkdir()
    (tmp_path / "environment").mkdir()
    return ["--target", str(tmp_path / "environment")]


def test_pip_adds_what_is_missing_with_all_that_this_needs(
    packages: Path, tmp_path: Path, from_here: list[str], capsys
) -> None:
    make_installed(packages, "numpy", "2.4.0")
    (packages / "numpy-2.3.5.dist-info" / "METADATA").unlink()
    make_wheel(tmp_path / "wheels", "numpy", "2.3.5", ["small>=2"])
    make_wheel(tmp_path / "wheels", "small", "2.1")
    folder = tmp_path / "environment"
    prepare._share(folder, NEEDED, [], "auto", from_here)
    assert {name for name in os.listdir(folder) if (folder / name).is_symlink() and "-info" not in name} == {
        "scikit_image",
        "lazy_loader",
        "torch",
    }
    assert "2.3.5" in (folder / "numpy" / "__init__.py").read_text()
    assert "2.1" in (folder / "small" / "__init__.py").read_text()
    assert [line.split(": ")[1] for line in capsys.readouterr().err.splitlines()] == ["numpy.", "small."]


def test_the_other_build_of_torch_is_not_linked_where_the_user_wants_this_one(
    packages: Path, tmp_path: Path, from_here: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    make_torch(make_installed, packages, "2.13.0+cpu", "13.0")
    make_torch(make_wheel, tmp_path / "wheels", "2.13.0+cpu", None)
    monkeypatch.setattr(torch_build, "answers", lambda address: False)
    folder = tmp_path / "environment"
    prepare._share(folder, NEEDED, ["torch==2.13.0"], "cpu", from_here)
    assert not (folder / "torch").is_symlink()
    assert "= None" in (folder / "torch" / "version.py").read_text()
    assert (folder / "numpy").is_symlink()


def test_what_cannot_be_had_is_one_sentence(packages: Path, tmp_path: Path, from_here: list[str]) -> None:
    with pytest.raises(BadInput, match="pip could not install"):
        prepare._share(tmp_path / "environment", [*NEEDED, "scipy"], [], "auto", from_here)


def test_a_paraview_with_another_python_gets_the_packages_themselves(
    tmp_path: Path, from_here: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch_build, "_pip_finds_cuda", lambda: False)
    wheels = tmp_path / "wheels"
    make_torch(make_wheel, wheels, "2.13.0", None, ["small>=2", "unwanted; extra == 'opt'"])
    make_wheel(wheels, "numpy", "2.3.5")
    make_wheel(wheels, "numpy", "2.4.0")
    make_wheel(wheels, "small", "2.1")
    folder = tmp_path / "environment"
    paraview = programs.ParaView(tmp_path, (6, 1), (3, sys.version_info.minor + 1))
    prepare._fill(paraview, folder, ["numpy>=1.24", "torch>=2.2", "numpy<2.4"], ["torch==2.13.0"], "auto")
    assert sorted(name for name in os.listdir(folder) if "-info" not in name) == [
        "constraints.txt",
        "numpy",
        "small",
        "torch",
    ]
    assert "2.3.5" in (folder / "numpy" / "__init__.py").read_text()


def test_only_a_python_of_the_same_kind_takes_compiled_packages(tmp_path: Path) -> None:
    program = tmp_path / "bin" / "pvpython"
    program.parent.mkdir()
    here = (sys.version_info.major, sys.version_info.minor)
    for suffix, python, takes in (
        (EXTENSION_SUFFIXES[0], here, True),
        (EXTENSION_SUFFIXES[0], (3, 9), False),
        (".cpython-314t-x86_64-linux-gnu.so", here, False),
    ):
        program.write_text(f"#!/bin/sh\necho 'svv: {suffix}'\n")
        program.chmod(0o755)
        assert prepare._takes_our_packages(programs.ParaView(program.parent, (6, 0), python)) is takes
