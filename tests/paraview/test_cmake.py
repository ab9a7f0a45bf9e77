"""CMake installs the plugin for the ParaView that it finds, and its own tests pass on that installation."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from svv.pv.launch import programs
from tests.nightly import nightly

ROOT = Path(__file__).resolve().parents[2]


def run(*command: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*map(str, command)], capture_output=True, text=True)


@pytest.mark.parametrize("test", nightly([False, True], False))
def test_configure_test_install(paraview: programs.ParaView, tmp_path: Path, test: bool) -> None:
    build, prefix = tmp_path / "build", tmp_path / "prefix"
    above = programs.environment_folder(paraview).parent
    done = run("cmake", "-S", ROOT, "-B", build, f"-DPARAVIEW_DIR={paraview.bin}", f"-DSVV_ENVIRONMENT={above}")
    assert done.returncode == 0, done.stdout + done.stderr
    if test:
        done = run("ctest", "--test-dir", build, "--output-on-failure")
        assert done.returncode == 0, done.stdout + done.stderr
        assert "0 tests failed out of 3" in done.stdout
    done = run("cmake", "--install", build, "--prefix", prefix)
    assert done.returncode == 0, done.stdout + done.stderr
    (plugins,) = (prefix / "lib").glob("paraview-*/plugins/StyleRF")
    assert [path.name for path in plugins.glob("*.py")] == ["StyleRF.py"]
    assert os.access(prefix / "bin" / "svv-paraview", os.X_OK)
    done = run(prefix / "bin" / "svv-paraview", "pvpython", "-c", "import svv; print(svv.__file__)")
    assert done.stdout.splitlines()[-1] == str(plugins / "svv" / "__init__.py"), done.stderr


@pytest.mark.parametrize("answer", ["", "paraview version 5.10.1"])
def test_a_paraview_of_no_use_is_refused(tmp_path: Path, answer: str) -> None:
    if answer:
        (tmp_path / "pvpython").write_text(f"#!/bin/sh\necho {answer}\n")
        (tmp_path / "pvpython").chmod(0o755)
    done = run("cmake", "-S", ROOT, "-B", tmp_path / "build", f"-DPARAVIEW_DIR={tmp_path}")
    assert done.returncode != 0
    assert "5.11 or newer" in done.stderr
