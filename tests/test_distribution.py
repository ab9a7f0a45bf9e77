"""The wheels and the source distribution contain all that svv and svv-bench need, tested in separate environments."""

from __future__ import annotations

import os
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Iterable
from itertools import takewhile
from pathlib import Path

import pytest

from svv._version import __version__
from svv.cli.added import MEASURES
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
    for kind, of in (("sdist", source), ("wheel", source), ("wheel", source / "bench")):
        subprocess.run([sys.executable, "-c", BUILD % kind, str(out)], cwd=of, check=True, capture_output=True)
    return out


def installed(wheels: Iterable[Path], target: Path) -> dict[str, str]:
    """Install wheels into an empty folder, beside the packages that they depend on; returns how to find them."""
    install = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--no-index", "--target", str(target)]
    subprocess.run([*install, *map(str, wheels)], check=True, capture_output=True)
    return {**os.environ, "PYTHONPATH": str(target)}


def test_both_hold_the_package_the_plugin_and_its_types(built: Path) -> None:
    (wheel,), (sdist,) = built.glob("svv-*.whl"), built.glob("*.tar.gz")
    assert wheel.name == f"svv-{__version__}-py3-none-any.whl" and sdist.name == f"svv-{__version__}.tar.gz"
    inside = zipfile.ZipFile(wheel).namelist()
    modules = {p.relative_to(ROOT).as_posix() for p in (ROOT / "svv").rglob("*.py")}
    viewer = {p.relative_to(ROOT).as_posix() for p in (ROOT / "svv/render/web/viewer").iterdir()}
    assert modules | viewer | {"svv/py.typed"} <= set(inside)
    assert not [name for name in inside if name.startswith(("tests/", "docs/", "bench/", "svv_bench/", "campaign/"))]
    data = f"svv-{__version__}.data/data/share/svv"
    assert {f"{data}/constraints.txt", f"{data}/plugin/StyleRF.py"} <= set(inside)
    with tarfile.open(sdist) as file:
        packed = {name.partition("/")[2] for name in file.getnames()}
    assert modules | viewer | {"pyproject.toml", "LICENSE", "README.md"} <= packed


def test_the_wheel_runs_without_the_checkout(built: Path, tmp_path: Path) -> None:
    target = tmp_path / "site"
    environ = installed(built.glob("svv-*.whl"), target)
    where = "import svv, svv.cli.app; print(svv.__file__)"
    done = subprocess.run(
        [sys.executable, "-c", where], cwd=tmp_path, env=environ, capture_output=True, text=True, check=True
    )
    assert Path(done.stdout.strip()).is_relative_to(target)
    command = [sys.executable, str(target / "bin" / "svv"), "--version"]
    said = subprocess.run(command, cwd=tmp_path, env=environ, capture_output=True, text=True, check=True)
    assert said.stdout.strip() == f"svv {__version__}"


def test_the_wheel_of_what_measures_holds_all_of_it_and_has_the_version_of_svv(built: Path) -> None:
    (wheel,) = built.glob("svv_bench-*.whl")
    assert wheel.name == f"svv_bench-{__version__}-py3-none-any.whl"
    with zipfile.ZipFile(wheel) as file:
        inside = set(file.namelist())
        metadata = file.read(f"svv_bench-{__version__}.dist-info/METADATA").decode()
    modules = {p.relative_to(ROOT / "bench").as_posix() for p in (ROOT / "bench" / "svv_bench").rglob("*.py")}
    assert modules | {"svv_bench/py.typed"} <= inside
    assert f"svv_bench-{__version__}.data/data/share/svv/paraview_scripts/compare_dvr_pcn.py" in inside
    assert f"Requires-Dist: svv=={__version__}" in metadata.splitlines()
    assert f"Summary: {MEASURES}" in metadata.splitlines()


def test_svv_bench_is_there_where_it_is_installed(built: Path, tmp_path: Path) -> None:
    """By its entry point, of which svv's help and its commands know."""
    target = tmp_path / "site"
    environ = installed([*built.glob("svv-*.whl"), *built.glob("svv_bench-*.whl")], target)

    where = "from importlib.metadata import entry_points as e; print(*(p.load() for p in e(group='svv.commands')))"
    for command, told in (
        (["-c", where], "<typer.main.Typer object"),
        ([str(target / "bin" / "svv"), "--help"], "Measure accuracy against time"),
        ([str(target / "bin" / "svv"), "bench", "profile", "--help"], "svv bench profile views"),
    ):
        done = subprocess.run(
            [sys.executable, *command], cwd=tmp_path, env=environ, capture_output=True, text=True, check=True
        )
        assert told in done.stdout


@pytest.mark.slow
def test_pyvista_finds_the_reader_and_the_accessor_of_the_wheel(built: Path, tmp_path: Path) -> None:
    """By its entry points, without any import of svv."""
    pytest.importorskip("pyvista", minversion="0.48")
    (wheel,) = built.glob("svv-*.whl")
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


def test_the_conda_recipe_has_the_version_and_the_requirements_of_the_project() -> None:
    tomllib = pytest.importorskip("tomllib", reason="Python 3.10 reads no TOML")
    recipe, project = (ROOT / "conda/recipe.yaml").read_text(), tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert f'version: "{__version__}"' in recipe

    def listed(heading: str) -> set[str]:
        lines = recipe.partition(f"  {heading}:\n")[2].splitlines()
        block = takewhile(lambda line: line.startswith("    - "), lines)
        return {line.removeprefix("    - ").replace(" ", "") for line in block}

    def requirement(text: str) -> str:
        return "pytorch" + text.removeprefix("torch") if text.startswith("torch>") else text

    needs = {requirement(text) for text in project["project"]["dependencies"]}
    assert listed("run") == needs | {f"python{project['project']['requires-python']}"}
    assert listed("host") == {
        f"python{project['project']['requires-python']}",
        "pip",
        *project["build-system"]["requires"],
    }
    assert listed("run_constraints") == set(project["project"]["optional-dependencies"]["standalone"])
    (command,) = (f"{name} = {value}" for name, value in project["project"]["scripts"].items())
    assert f"- {command}" in recipe
