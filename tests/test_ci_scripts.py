"""The scripts that install Debian packages, and make in paths with spaces: with tools that only record their calls."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
LOCKED = "E: Could not get lock /var/lib/apt/lists/lock. It is held by process 1 (apt-get)"


@pytest.fixture
def run(tmp_path: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run a script of .ci as root or not, with an apt-get that does what a test says."""

    def start(*arguments: str, apt: str, root: bool = True, **environ: str) -> subprocess.CompletedProcess[str]:
        folder = tmp_path / "bin"
        folder.mkdir()
        tools = {"id": f"echo {0 if root else 1000}", "apt-get": apt, "apt-cache": "exit 1"}
        for name, text in tools.items():
            (folder / name).write_text(f"#!/bin/sh\n{text}\n")
            (folder / name).chmod(0o755)
        for name in ("grep", "sleep", "sh", "ls"):
            (folder / name).symlink_to(next(p for p in (Path("/bin") / name, Path("/usr/bin") / name) if p.exists()))
        environ = {"PATH": str(folder), "LOG": str(tmp_path / "log"), **environ}
        script, *rest = arguments
        return subprocess.run([ROOT / ".ci" / script, *rest], env=environ, capture_output=True, text=True)

    return start


def test_another_apt_is_waited_for_and_a_line_says_so(run: Callable, tmp_path: Path) -> None:
    apt = f"""echo "$@" >> $LOG
        if [ ! -e $LOG.busy ]; then > $LOG.busy; echo '{LOCKED}' >&2; exit 100; fi"""
    done = run("apt", "xvfb", "cmake", apt=apt)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "Another program is installing packages: waiting for it, at most 600 seconds.\n"
    assert (tmp_path / "log").read_text().splitlines() == [
        "-qq update",
        "-qq update",
        "-qq install -y --no-install-recommends xvfb cmake",
    ]


def test_an_apt_that_stays_busy_is_not_waited_for_longer(run: Callable) -> None:
    done = run("apt", "xvfb", apt=f"echo '{LOCKED}' >&2; exit 100", SVV_APT_WAIT="0")
    assert done.returncode == 1
    assert LOCKED in done.stderr


def test_a_failing_apt_is_quoted_and_lists_that_fail_are_not_the_end(run: Callable) -> None:
    apt = "case $2 in update) echo 'E: no network' >&2; exit 100;; esac; echo 'E: Unable to locate xvfb' >&2; exit 100"
    done = run("apt", "xvfb", apt=apt)
    assert done.returncode == 1
    assert done.stderr.splitlines() == [
        "E: no network",
        "E: Unable to locate xvfb",
        "apt-get could not install xvfb; its messages are above.",
    ]


def test_who_may_not_install_is_told_how_to_get_paraview_without_root(run: Callable) -> None:
    done = run("paraview", apt="exit 100", root=False)
    assert done.returncode == 1
    missing, advice = done.stderr.splitlines()
    assert "sudo apt-get install paraview python3-paraview" in missing
    for word in ("Fedora", "conda-forge", "paraview.org/download", "make paraview PARAVIEW=DIR"):
        assert word in advice


def test_without_a_browser_the_tests_go_on(run: Callable, tmp_path: Path) -> None:
    done = run("browser", apt="exit 100", root=False)
    assert done.returncode == 0
    assert "sudo apt-get install chromium" in done.stderr and "skipped" in done.stderr


@pytest.mark.parametrize("target", ["install", "check", "paraview", "kernels", "demo", "clean"])
def test_make_quotes_paths_with_spaces(target: str, tmp_path: Path) -> None:
    venv, out = tmp_path / "my env", "my demo"
    (venv / "bin").mkdir(parents=True)
    (venv / "bin" / "python").touch()
    command = ["make", "-n", target, f"VENV={venv}", f"OUT={out}"]
    environ = {name: value for name, value in os.environ.items() if name not in ("MAKEFLAGS", "MFLAGS", "TORCH")}
    done = subprocess.run(command, cwd=ROOT, env=environ, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    words = subprocess.run(
        ["sh", "-c", 'for line; do eval "set -- $line"; printf "%s\\n" "$@"; done', "sh"]
        + [line for line in done.stdout.splitlines() if str(tmp_path) in line and "||" not in line and "*" not in line],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.splitlines()
    assert not any(word.endswith("/my") for word in words)
    assert any(str(venv) in word for word in words)
