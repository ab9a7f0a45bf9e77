"""The wheel and the source distribution contain all that svv needs, tested in separate environments."""

from __future__ import annotations

import os
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from svv._version import __version__
from tests.cube import cube_scene

ROOT = Path(__file__).resolve().parents[1]
BUILD = "from setuptools.build_meta import build_sdist, build_wheel; import sys; build_%s(sys.argv[1])"


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with both, built from what git would hand out."""
    out, source = tmp_path_factory.mktemp("dist"), tmp_path_factory.mktemp("source")
    files = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.splitlines()
    for name in files:
        if (ROOT / name).is_file() and not name.startswith(("docs/images", "tests/", ".venv")):
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            (source / name).write_bytes((ROOT / name).read_bytes())
    for kind in ("sdist", "wheel"):
        subprocess.run([sys.executable, "-c", BUILD % kind, str(out)], cwd=source, check=True, capture_output=True)
    return out


def test_both_hold_the_package_the_plugin_and_its_types(built: Path) -> None:
    (wheel,), (sdist,) = built.glob("*.whl"), built.glob("*.tar.gz")
    assert wheel.name == f"svv-{__version__}-py3-none-any.whl" and sdist.name == f"svv-{__version__}.tar.gz"
    inside = zipfile.ZipFile(wheel).namelist()
    modules = {p.relative_to(ROOT).as_posix() for p in (ROOT / "svv").rglob("*.py")}
    viewer = {p.relative_to(ROOT).as_posix() for p in (ROOT / "svv/render/web/viewer").iterdir()}
    assert modules | viewer | {"svv/py.typed"} <= set(inside)
    assert not [name for name in inside if name.startswith(("tests/", "docs/"))]
    data = f"svv-{__version__}.data/data/share/svv"
    assert {f"{data}/constraints.txt", f"{data}/plugin/StyleRF.py"} <= set(inside)
    with tarfile.open(sdist) as file:
        packed = {name.partition("/")[2] for name in file.getnames()}
    assert modules | viewer | {"pyproject.toml", "LICENSE", "README.md"} <= packed


def test_the_wheel_runs_without_the_checkout(built: Path, tmp_path: Path) -> None:
    """Installed into an empty folder, beside the packages that it depends on."""
    (wheel,) = built.glob("*.whl")
    target = tmp_path / "site"
    install = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "-q",
        "--no-deps",
        "--no-index",
        "--target",
        str(target),
        str(wheel),
    ]
    subprocess.run(install, check=True, capture_output=True)
    environ = {**os.environ, "PYTHONPATH": str(target)}
    where = "import svv, svv.cli.app; print(svv.__file__)"
    done = subprocess.run(
        [sys.executable, "-c", where], cwd=tmp_path, env=environ, capture_output=True, text=True, check=True
    )
    assert Path(done.stdout.strip()).is_relative_to(target)
    command = [sys.executable, str(target / "bin" / "svv"), "--version"]
    said = subprocess.run(command, cwd=tmp_path, env=environ, capture_output=True, text=True, check=True)
    assert said.stdout.strip() == f"svv {__version__}"


@pytest.mark.slow
def test_pyvista_finds_the_reader_and_the_accessor_of_the_wheel(built: Path, tmp_path: Path) -> None:
    """By its entry points, without any import of svv."""
    pytest.importorskip("pyvista", minversion="0.48")
    (wheel,) = built.glob("*.whl")
    with zipfile.ZipFile(wheel) as file:
        file.extractall(tmp_path / "site")
    cube_scene().save(tmp_path / "cube.svv")
    program = (
        "import pyvista; grid = pyvista.read('cube.svv'); print(len(grid.svv.recolour(0, 'red').svv.scene.regions))"
    )
    environ = {**os.environ, "PYTHONPATH": str(tmp_path / "site")}
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, cwd=tmp_path, env=environ, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "3"
