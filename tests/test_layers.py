"""Imports point down only: this test reads every module, including its lazy and relative imports."""

from __future__ import annotations

import ast
import importlib
import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

import svv
from svv.moved import MOVED

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = {"svv": ROOT, "svv_bench": ROOT / "bench"}
"""Where the import packages are; a module's path is given from there."""

MODULES = sorted(path.relative_to(above) for name, above in PACKAGES.items() for path in (above / name).rglob("*.py"))

BOTTOM = {"_version", "errors", "options"}
COLUMN = ["core", "kernels", "fields", "styles", "train", "render", "job"]
BELOW = {layer: BOTTOM | set(COLUMN[:level]) for level, layer in enumerate(COLUMN)}
BELOW["svv"] = {"_version", "environment", "moved", "own_symbols"}
BELOW["_version"] = BELOW["environment"] = BELOW["moved"] = BELOW["own_symbols"] = set()
BELOW["errors"] = set()
BELOW["options"] = {"errors"}
BELOW["io"] = BOTTOM | {"core"}
BELOW["bricks"] = BOTTOM | {"core", "io"}
BELOW["dvr"] = BOTTOM | {"core", "io", "bricks", "measure"}
BELOW["progress"] = BELOW["measure"] = BELOW["ending"] = BOTTOM
BELOW["kernels"] |= {"io"}  # the result of the check of a GPU is a file
BELOW["fields"] |= {"io"}
BELOW["styles"] |= {"io"}
BELOW["train"] |= {"io", "measure"}
BELOW["render"] |= {"io", "measure"}
BELOW["job"] |= {"io", "bricks", "dvr", "progress", "measure", "ending"}
BELOW["pv"] = BOTTOM | {*COLUMN, "io", "bricks", "dvr", "progress", "ending", "environment", "measure", "own_symbols"}
BELOW["cli"] = BOTTOM | {*COLUMN, "io", "bricks", "dvr", "progress", "measure", "ending", "pv"}
BELOW["__main__"] = {"cli"}
BELOW["bench"] = BELOW["job"] | {"job", "svv"}  # svv_bench, a distribution of its own: nothing in svv imports it
BELOW["bench.cli"] = BELOW["cli"] | {"cli", "bench"}

ALLOWED = {
    "paraview": {"pv"},
    "vtk": set(),  # loads all of VTK, and is not ParaView's
    "vtkmodules": {"dvr", "job", "bench", "pv"},
    "pyvista": {"render", "cli"},
    "torch": {"core", "kernels", "fields", "styles", "train", "render", "job", "bench"},
    **dict.fromkeys(("os", "pathlib", "io", "shutil", "tempfile", "PIL"), set(BELOW) - {"core"}),
}
"""Packages that only some layers may import: core touches no file, torch never meets VTK."""

EXCEPTED = {"svv.dvr.read.other_formats": {"pyvista"}}
"""Modules that may import more than their layer: the reader of the standalone installation."""


def source_of(path: Path) -> str:
    """The source of a module in one of the packages."""
    return (PACKAGES[path.parts[0]] / path).read_text()


def layer_of(module: str) -> str:
    """The layer of a dotted module name: 'svv.core.colour.colour' is in 'core', all of svv_bench in 'bench'."""
    package, *rest = module.split(".")
    if package == "svv_bench":
        return "bench.cli" if rest[:1] == ["cli"] else "bench"
    return rest[0] if rest else "svv"


def imported(path: Path, source: str) -> set[str]:
    """Dotted names that a module imports, relative ones made absolute, lazy ones included.

    'from svv.core.colour import light' is both 'svv.core.colour' and 'svv.core.colour.light': what it names may be a
    module.
    """
    package = [*path.with_suffix("").parts[:-1]]
    names = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            module = ".".join([*base, *([node.module] if node.module else [])])
            names |= {f"{module}.{alias.name}" for alias in node.names}
    return names


def without_interface(source: str) -> str:
    """The source of ``svv/__init__.py`` without the names that it promises to type checkers and never imports itself.

    They lie in layers above and are imported when somebody asks for them; that nothing heavy is loaded before is
    tested below.
    """
    tree = ast.parse(source)
    tree.body = [n for n in tree.body if not (isinstance(n, ast.If) and ast.unparse(n.test) == "TYPE_CHECKING")]
    return ast.unparse(tree)


def violations(path: Path, source: str) -> list[str]:
    """What a module imports against the layers."""
    if path == Path("svv/__init__.py"):
        source = without_interface(source)
    own = layer_of(named(path))
    if own not in BELOW:
        return [f"{path}: '{own}' is no layer; name it in {Path(__file__).name}"]
    found = []
    for name in sorted(imported(path, source)):
        top = name.split(".")[0]
        if top in PACKAGES and layer_of(name) not in BELOW[own] | {own}:
            found.append(f"{path} ({own}) imports {name}")
        elif top in ALLOWED and own not in ALLOWED[top] and top not in EXCEPTED.get(named(path), ()):
            found.append(f"{path} ({own}) imports {name}")
    return found


def named(path: Path) -> str:
    """The dotted name of a module: 'svv/core/colour/colour.py' is 'svv.core.colour.colour'."""
    return ".".join(path.with_suffix("").parts).removesuffix(".__init__")


def circle(sources: Mapping[Path, str]) -> list[str]:
    """Modules that import each other round about, in order, with the first at the end again; [] where none do."""
    names = {named(path) for path in sources}
    graph: dict[str, list[str]] = {}
    for path, source in sources.items():
        plain = without_interface(source) if path == Path("svv/__init__.py") else source
        modules = {name if name in names else name.rpartition(".")[0] for name in imported(path, plain)}
        graph[named(path)] = sorted(modules & names - {named(path)})
    finished: set[str] = set()

    def walk(name: str, way: list[str]) -> list[str]:
        if name in way:
            return [*way[way.index(name) :], name]
        if name not in finished:
            for other in graph[name]:
                if found := walk(other, [*way, name]):
                    return found
            finished.add(name)
        return []

    return next((found for name in sorted(graph) if (found := walk(name, []))), [])


def test_imports_point_down() -> None:
    assert MODULES
    assert [found for path in MODULES for found in violations(path, source_of(path))] == []


def test_no_module_imports_itself_round_about() -> None:
    assert circle({path: source_of(path) for path in MODULES}) == []


@pytest.mark.parametrize(
    "back",
    [
        "from svv.fields.b import B",
        "from svv.fields import b",
        "from . import b",
        "from .b import B",
        "if TYPE_CHECKING:\n    from svv.fields.b import B",
        "def f():\n    from svv.fields.c import C",
    ],
)
def test_a_circle_is_found(back: str) -> None:
    sources = {
        "a": back,
        "b": "from svv.fields.c import C",
        "c": "from svv.fields.a import A",
    }
    files = {Path(f"svv/fields/{name}.py"): source for name, source in sources.items()}
    assert set(circle(files)) == {f"svv.fields.{name}" for name in ("ac" if "c import" in back else "abc")}
    del files[Path("svv/fields/a.py")]
    assert circle({**files, Path("svv/fields/a.py"): "import svv.core.colour.colour"}) == []


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("svv/core/x.py", "from svv.io.files.atomic import atomic_path"),
        ("svv/core/x.py", "from ..fields import scene"),
        ("svv/core/x.py", "def f():\n    import svv.train.pipeline"),
        ("svv/core/x.py", "from svv import dvr"),
        ("svv/core/x.py", "from .. import dvr"),
        ("svv/core/x.py", "from pathlib import Path"),
        ("svv/io/x.py", "import torch.nn as nn"),
        ("svv/dvr/x.py", "from torch import nn"),
        ("svv/dvr/x.py", "import vtk"),
        ("svv/dvr/x.py", "import pyvista"),
        ("svv/train/x.py", "import pyvista"),
        ("svv/train/x.py", "from svv.dvr.draw.views import draw"),
        ("svv/train/x.py", "from vtkmodules.vtkCommonCore import vtkObject"),
        ("svv/job/x.py", "from paraview import simple"),
        ("svv/job/x.py", "from svv.cli.app import main"),
        ("svv/pv/x.py", "from svv_bench.chart import job"),
        ("svv/cli/x.py", "def f():\n    import svv_bench"),
        ("svv_bench/x.py", "from svv_bench.cli import app"),
        ("svv_bench/chart/x.py", "from svv.cli.options import Out"),
        ("svv/train/x.py", "from svv import __version__"),
        ("svv/errors.py", "from svv.core.colour import colour"),
        ("svv/elsewhere.py", ""),
        ("svv/__init__.py", "from svv.fields.scene.scene import Scene"),
        ("svv/__init__.py", "def f():\n    import svv.core.colour.colour"),
        ("svv/core/x.py", "if TYPE_CHECKING:\n    from svv.fields.scene.scene import Scene"),
    ],
)
def test_an_upward_import_is_found(path: str, source: str) -> None:
    assert len(violations(Path(path), source)) == 1


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("svv/core/x.py", "from .colour import to_hex\nfrom svv._version import __version__\nimport numpy, torch"),
        ("svv/dvr/__init__.py", "from .views import draw\nfrom ..core import cameras"),
        ("svv/dvr/x.py", "from vtkmodules.vtkCommonCore import vtkObject"),
        ("svv/pv/x.py", "from paraview import simple"),
        ("svv_bench/cli/x.py", "from svv.cli.options import Out\nfrom svv_bench.chart import job"),
        ("svv/__init__.py", "if TYPE_CHECKING:\n    from svv.fields.scene.scene import Scene as Scene"),
    ],
)
def test_a_downward_import_is_not(path: str, source: str) -> None:
    assert violations(Path(path), source) == []


@pytest.mark.parametrize(
    ("modules", "heavy"),
    [
        (["svv"], {"torch", "vtk", "vtkmodules", "numpy"}),
        (["svv.cli.app"], {"torch", "vtk", "vtkmodules"}),
        # inside ParaView there may be no torch, and there must be no second VTK
        (
            [
                ".".join(path.with_suffix("").parts).removesuffix(".__init__")
                for path in MODULES
                if path.parts[1] in ("io", "dvr")
            ],
            {"torch", "vtk", "pyvista", "paraview"},
        ),
    ],
    ids=["svv", "command line", "io and dvr"],
)
def test_importing_loads_nothing_heavy(modules: list[str], heavy: set[str]) -> None:
    script = f"import sys, importlib\nfor name in {modules}: importlib.import_module(name)\nprint(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True)
    loaded = {name.split(".")[0] for name in done.stdout.split()}
    assert "svv" in loaded
    assert loaded.isdisjoint(heavy)


def test_the_interface_is_what_it_promises() -> None:
    """Each name of ``svv`` is one object, the one that type checkers are told of."""
    tree = ast.parse((ROOT / "svv/__init__.py").read_text())
    (promised,) = (node for node in tree.body if isinstance(node, ast.If))
    imports = [node for node in promised.body if isinstance(node, ast.ImportFrom)]
    told = {alias.asname: node.module for node in imports for alias in node.names}
    assert told == svv.PUBLIC
    for name, module in svv.PUBLIC.items():
        assert getattr(svv, name) is getattr(importlib.import_module(module), name)
        assert name in dir(svv)
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = svv.nonsense


@pytest.fixture(scope="module")
def old_names() -> dict[str, tuple[bool, list[str]]]:
    """Of each old name whether it is the new module, and the warnings of its import, all in one fresh process."""
    script = f"""import importlib, json, warnings
found = {{}}
for old, new in {MOVED!r}.items():
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        module = importlib.import_module(old)
    said = [str(t.message) for t in told if t.category is DeprecationWarning]
    found[old] = module is importlib.import_module(new), said
print(json.dumps(found))
"""
    done = subprocess.run([sys.executable, "-c", script], check=True, cwd=ROOT, capture_output=True, text=True)
    return {old: (same, said) for old, (same, said) in json.loads(done.stdout).items()}


def test_old_names_work_with_a_warning(old_names: dict[str, tuple[bool, list[str]]]) -> None:
    assert old_names
    assert old_names == {old: (True, [f"{old} is now {new}."]) for old, new in MOVED.items()}


def test_the_scene_is_found_where_its_module_was() -> None:
    from svv.fields import scene

    with pytest.warns(DeprecationWarning, match="svv.fields.scene.Scene is now svv.Scene"):
        assert scene.Scene is svv.Scene
