"""Tests of what measures and of GPU kernels run only where something that they import has changed since they passed.

``make test`` sets ``SVV_TESTS_UNCHANGED=skip``; everything else runs all. What passed is kept in pytest's cache.
"""

from __future__ import annotations

import ast
import hashlib
import os
import platform
import re
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

KEPT = """
test_triton_cells test_triton_compiles test_triton_images test_triton_kernels test_triton_networks test_triton_strokes
test_triton_regions test_triton_tomography test_triton_variants
test_ablation test_bench_gpu test_blind test_campaign test_chart test_chart_figures test_compared test_consistency
test_exhibits test_flow test_frames test_frames_input test_legibility test_lines test_profile
test_rival_frames test_stability test_stability_bar
""".split()
"""Tests of the GPU's kernels in the interpreter, of ``bench/`` and of ``campaign/``; all others always run."""

PACKAGES = {"svv": ROOT, "svv_bench": ROOT / "bench", "campaign": ROOT, "tests": ROOT}

BY_NAME = {
    "svv/cli/app.py": "svv/cli", "svv/cli/added.py": "bench/svv_bench/cli",
    "svv/kernels/dispatch/__init__.py": "svv/kernels", "svv/styles/gallery/offered.py": "svv/styles/gallery",
    "campaign/small.py": "svv/cli",
}  # fmt: skip
"""Modules that import others by names which they put together, and the folder of those."""

WHOLE_NAME = re.compile(r"(svv|svv_bench|campaign|tests)(\.\w+)+")


def imported(path: Path) -> Iterator[str]:
    """Yield the dotted names of all that a module imports, inside functions as well, or names as text.

    ``svv/__init__.py`` names all of the public interface, of which a module needs what it takes from there.
    """
    text = path.read_text(encoding="utf-8")
    if re.search(r"^\s*(import svv$|from svv import )", text, re.MULTILINE):
        yield from public()
    for node in ast.walk(ast.parse("" if path == ROOT / "svv" / "__init__.py" else text)):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield from (f"{node.module}.{name.name}" for name in node.names)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and WHOLE_NAME.fullmatch(node.value):
            yield node.value


@cache
def public() -> tuple[str, ...]:
    """Return the names of the modules of the public interface."""
    text = (ROOT / "svv" / "__init__.py").read_text(encoding="utf-8")
    return tuple(sorted({match[0] for match in re.finditer(r"\bsvv(\.\w+)+", text)}))


def files_of(name: str) -> Iterator[Path]:
    """Yield the files of this repository that an import of a dotted name runs."""
    words = name.split(".")
    if words[0] in PACKAGES:
        for end in range(1, len(words) + 1):
            base = PACKAGES[words[0]].joinpath(*words[:end])
            yield from (path for path in (base / "__init__.py", base.with_suffix(".py")) if path.is_file())


@cache
def direct(path: Path) -> tuple[Path, ...]:
    """Return the files of this repository that a file imports, by name or by text."""
    found = {there for name in imported(path) for there in files_of(name)}
    if folder := BY_NAME.get(path.relative_to(ROOT).as_posix()):
        found |= set((ROOT / folder).rglob("*.py"))
    return tuple(sorted(found))


def needed(path: Path) -> set[Path]:
    """Return a file and all files of this repository that it imports, directly or through others."""
    found, left = {path}, [path]
    while left:
        for each in direct(left.pop()):
            if each not in found:
                found.add(each)
                left.append(each)
    return found


@cache
def state(module: str) -> str:
    """Return a hash of a test module, of all that it needs, and of the versions of Python and the packages."""
    files = needed(ROOT / module) | {ROOT / "tests" / "conftest.py", ROOT / "constraints.txt"}
    total = hashlib.sha256(f"{sys.version} {platform.machine()}".encode())
    for path in sorted(files):
        total.update(f"{path.relative_to(ROOT)}\0".encode() + path.read_bytes())
    return total.hexdigest()


def is_kept(module: str) -> bool:
    """Whether a test module, by its path, may be left out if nothing has changed."""
    return Path(module).stem in KEPT and Path(module).parent.name == "tests"


class Unchanged:
    """A plugin of pytest: skips such modules that are as when they passed, and keeps which pass now."""

    def __init__(self, config: pytest.Config) -> None:
        self.config = config
        self.skips = os.environ.get("SVV_TESTS_UNCHANGED") == "skip"
        self.whole = not config.option.keyword and not any("::" in argument for argument in config.args)
        self.expected: Counter[str] = Counter()
        self.passed: Counter[str] = Counter()

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Count the tests of each module before any are left out, and skip what is unchanged."""
        usual = [i for i in items if is_kept(module_of(i.nodeid)) and not i.get_closest_marker("slow")]
        self.expected = Counter(module_of(item.nodeid) for item in usual)
        if self.skips:
            same = {m for m in self.expected if self.config.cache and self.config.cache.get(key(m), "") == state(m)}
            mark = pytest.mark.skip(reason="nothing that it imports has changed since it passed")
            for item in usual:
                if module_of(item.nodeid) in same:
                    item.add_marker(mark)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Count what passes, and what is skipped in the test itself."""
        module = module_of(report.nodeid)
        if module in self.expected:
            self.passed[module] += report.when == "call" and report.outcome != "failed"
            self.passed[module] -= 10**6 * (report.outcome == "failed")

    def pytest_sessionfinish(self) -> None:
        """Keep the state of the modules all of whose tests have passed."""
        for module in passed_whole(self.expected, self.passed) if self.whole else ():
            if getattr(self.config, "cache", None):  # there is none with -p no:cacheprovider
                self.config.cache.set(key(module), state(module))


def passed_whole(expected: Counter[str], passed: Counter[str]) -> Iterable[str]:
    """Return the modules of which as many tests passed as there are."""
    return [module for module, count in expected.items() if 0 < count <= passed[module]]


def module_of(nodeid: str) -> str:
    """Return the path of a test's module."""
    return nodeid.partition("::")[0]


def key(module: str) -> str:
    """Return the name in pytest's cache."""
    return f"svv/passed/{Path(module).stem}"
