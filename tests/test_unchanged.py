"""Tests that are kept as passed are left out only while nothing that they import has changed since they passed."""

from __future__ import annotations

import textwrap
from collections import Counter
from pathlib import Path

import pytest

from tests import unchanged
from tests.unchanged import KEPT, ROOT, is_kept, needed, passed_whole


def test_the_modules_are_there_and_need_what_they_test() -> None:
    """Each needs ``bench/``, ``campaign/`` or the GPU's kernels; nothing else may ever be left out."""
    for name in KEPT:
        files = {path.relative_to(ROOT).as_posix() for path in needed(ROOT / "tests" / f"{name}.py")}
        assert any(file.startswith(("bench/", "campaign/", "svv/kernels/triton/")) for file in files), name
    assert is_kept("tests/test_chart.py")
    assert not is_kept("tests/test_training.py") and not is_kept("tests/paraview/test_chart.py")


def test_what_is_imported_inside_functions_and_by_name_is_needed() -> None:
    files = {path.relative_to(ROOT).as_posix() for path in needed(ROOT / "tests/test_chart.py")}
    assert {
        "bench/svv_bench/chart/trial.py",
        "svv/__init__.py",
        "svv/train/run/loop.py",
    } <= files  # trial.py by its name
    assert "svv/cli/scene.py" in {path.relative_to(ROOT).as_posix() for path in needed(ROOT / "svv/cli/app.py")}
    assert not any(file.startswith("svv/pv/filters") for file in files)


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name, text in {
        "svv/__init__.py": "", "svv/used.py": "one = 1\n", "svv/other.py": "", "constraints.txt": "",
        "tests/conftest.py": "", "tests/test_chart.py": "def test_it():\n    from svv.used import one\n",
    }.items():  # fmt: skip
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(textwrap.dedent(text))
    monkeypatch.setattr(unchanged, "ROOT", tmp_path)
    monkeypatch.setattr(unchanged, "PACKAGES", {"svv": tmp_path, "tests": tmp_path})
    return tmp_path


def state() -> str:
    unchanged.direct.cache_clear()
    unchanged.public.cache_clear()
    unchanged.state.cache_clear()
    return unchanged.state("tests/test_chart.py")


@pytest.mark.parametrize("name", ["svv/used.py", "svv/__init__.py", "tests/test_chart.py", "constraints.txt"])
def test_a_change_of_what_it_needs_runs_it_again(project: Path, name: str) -> None:
    before = state()
    assert state() == before
    (project / "svv/other.py").write_text("two = 2\n")
    assert state() == before
    (project / name).write_text((project / name).read_text() + "# changed\n")
    assert state() != before


def test_only_a_module_of_which_all_tests_passed_is_kept() -> None:
    expected = Counter({"a": 3, "b": 2, "c": 1})
    assert passed_whole(expected, Counter({"a": 3, "b": 1, "c": 1 - 10**6})) == ["a"]


TESTS = "import pytest\n\ndef test_one():\n    pass\n\ndef test_two():\n    assert {right}\n"


@pytest.mark.parametrize("right", [True, False])
def test_what_passed_is_skipped_and_what_failed_is_run_again(
    tmp_path: Path, right: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of three runs without a change, the second and third skip what passed as a whole in the first."""
    folder = tmp_path / "tests"
    folder.mkdir()
    (folder / f"test_{'chart' if right else 'lines'}.py").write_text(TESTS.format(right=right))  # imported once each
    monkeypatch.setattr(unchanged, "state", lambda module: "as it is")
    monkeypatch.setenv("SVV_TESTS_UNCHANGED", "skip")

    class Configured:
        def __init__(self) -> None:
            self.outcomes: list[str] = []

        def pytest_configure(self, config: pytest.Config) -> None:
            config.pluginmanager.register(unchanged.Unchanged(config))

        def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
            if report.when == "call" or report.outcome == "skipped":
                self.outcomes.append(report.outcome)

    def run(*arguments: str) -> list[str]:
        watched = Configured()
        options = [
            "-q",
            "-p",
            "no:xdist",
            "-p",
            "no:randomly",
            "--rootdir",
            str(tmp_path),
            "-c",
            "/dev/null",
            "--import-mode=importlib",
        ]
        cached = ["-o", f"cache_dir={tmp_path / 'cache'}"]
        pytest.main([*options, *cached, str(folder), *arguments], plugins=[watched])
        return watched.outcomes

    assert run("-k", "one") == ["passed"]
    first = ["passed", "passed" if right else "failed"]
    assert run() == first
    assert run() == (["skipped", "skipped"] if right else first)
