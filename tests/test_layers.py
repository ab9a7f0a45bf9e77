"""Imports point down only: this test reads every module, including its lazy and relative imports."""

from __future__ import annotations

import ast
import importlib
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

import svv
from tests import arrows
from tests.arrows import PACKAGES, ROOT, imported, named, without_interface

MODULES = arrows.sources()
NAMES = {named(path) for path in MODULES}

BOTTOM = {"_version", "errors", "options"}
COLUMN = ["core", "kernels", "fields", "styles", "train", "render", "job"]
BELOW = {layer: BOTTOM | set(COLUMN[:level]) for level, layer in enumerate(COLUMN)}
BELOW["svv"] = {"_version", "environment", "own_symbols"}
BELOW["_version"] = BELOW["environment"] = BELOW["own_symbols"] = BELOW["idle_imports"] = set()
BELOW["errors"] = set()
BELOW["options"] = {"errors"}
BELOW["io"] = BOTTOM | {"core"}
BELOW["bricks"] = BOTTOM | {"core", "io"}
BELOW["dvr"] = BOTTOM | {"core", "io", "bricks", "measure"}
BELOW["progress"] = BELOW["measure"] = BELOW["ending"] = BOTTOM
BELOW["core"] -= {"options"}
BELOW["fields"] |= {"io"}  # such as the result of the check of a GPU
BELOW["styles"] |= {"io"}
BELOW["train"] |= {"io", "measure"}
BELOW["render"] |= {"io", "measure"}
BELOW["job"] |= {"io", "bricks", "dvr", "progress", "measure", "ending"}
BELOW["pv"] = BOTTOM | {*COLUMN, "io", "bricks", "dvr", "progress", "ending", "environment", "measure", "own_symbols"}
BELOW["cli"] = BOTTOM | {*COLUMN, "io", "bricks", "dvr", "progress", "measure", "ending", "pv", "idle_imports"}
BELOW["__main__"] = {"cli"}
BELOW["bench"] = BELOW["job"] | {"job", "svv"}  # svv_bench, a distribution of its own: nothing in svv imports it
BELOW["bench.cli"] = BELOW["cli"] | {"cli", "bench"}
BELOW["campaign"] = BELOW["bench.cli"] | {"bench.cli"}

ALLOWED = {
    "paraview": {"pv", "campaign"},
    "vtk": set(),  # loads all of VTK, and is not ParaView's
    "vtkmodules": {"dvr", "job", "bench", "pv", "campaign"},
    "pyvista": {"render", "cli"},
    "torch": {"core", "kernels", "fields", "styles", "train", "render", "job", "bench", "campaign"},
    **dict.fromkeys(("os", "pathlib", "io", "shutil", "tempfile", "PIL"), set(BELOW) - {"core"}),
}
"""Packages that only some layers may import: core touches no file, torch never meets VTK."""

EXCEPTED = {"svv.dvr.read.other_formats": {"pyvista"}, "svv.job.dataset": {"pyvista"}}
"""Modules that may import more than their layer: the reader of the standalone installation, scenes in PyVista."""


def layer_of(module: str) -> str:
    """The layer of a dotted module name: 'svv.core.colour.colour' is in 'core', all of svv_bench in 'bench'."""
    package, *rest = module.split(".")
    if package == "campaign":
        return package
    if package == "svv_bench":
        return "bench.cli" if rest[:1] == ["cli"] else "bench"
    return rest[0] if rest else "svv"


def plain(path: Path, source: str) -> str:
    """The source of a module, for ``svv/__init__.py`` without what it promises."""
    return without_interface(source) if path == Path("svv/__init__.py") else source


def violations(path: Path, source: str) -> list[str]:
    """What a module imports against the layers."""
    source = plain(path, source)
    own = layer_of(named(path))
    if own not in BELOW:
        return [f"{path}: '{own}' is no layer; name it in {Path(__file__).name}"]
    found, names = [], set(imported(path, source, text=False))
    names |= {name for name in imported(path, source) if layer_of(name) in BELOW}  # other texts only look like names
    for name in sorted(names):
        top = name.split(".")[0]
        if top in PACKAGES and layer_of(name) not in BELOW[own] | {own}:
            found.append(f"{path} ({own}) imports {name}")
        elif top in ALLOWED and own not in ALLOWED[top] and top not in EXCEPTED.get(named(path), ()):
            found.append(f"{path} ({own}) imports {name}")
    return found


def test_imports_point_down() -> None:
    found = [found for path, source in MODULES.items() for found in violations(path, source)]
    assert found == []


def test_no_folder_imports_itself_round_about() -> None:
    """The house is read from top to bottom: no two folders import each other, directly or through others."""
    graph = {folder: set(others) for folder, others in arrows.arrows(MODULES).items()}
    assert arrows.circles(graph) == []


def test_no_module_imports_itself_round_about() -> None:
    graph = {}
    for path, source in MODULES.items():
        names = imported(path, plain(path, source), text=False)
        graph[named(path)] = {name if name in NAMES else name.rpartition(".")[0] for name in names} & NAMES
        graph[named(path)] -= {named(path)}
    graph["campaign.fuzz"] -= {"campaign.guided"}  # which is a part of it with a library of its own
    assert arrows.circles(graph) == []


@pytest.mark.parametrize(
    "back",
    [
        "from svv.fields.b.b import B",
        "from svv.fields import b",
        "from ..b import b",
        "from ..b.b import B",
        "if TYPE_CHECKING:\n    from svv.fields.b.b import B",
        "def f():\n    from svv.fields.c.c import C",
        "COMMAND = 'from svv.fields.c.c import main; main()'",
        "COMMAND = ['python', '-m', 'svv.fields.c.c']",
        "def f(name):\n    import_module(f'svv.fields.c.{name}')",
    ],
)
def test_a_circle_of_folders_is_found(back: str) -> None:
    texts = {"a": back, "b": "from svv.fields.c.c import C", "c": "from svv.fields.a.a import A"}
    files = {Path(f"svv/fields/{name}/{name}.py"): source for name, source in texts.items()}
    files |= {Path(f"svv/fields/{name}/__init__.py"): "" for name in texts}
    named_too = "ac" if ".c." in back else "abc"
    assert arrows.circles(graph_of(files)) == [[f"svv.fields.{name}" for name in named_too]]
    for harmless in ("import svv.core.colour.colour", '"""The process is svv.fields.c.c."""', "from .other import x"):
        assert arrows.circles(graph_of({**files, Path("svv/fields/a/a.py"): harmless})) == []


def graph_of(files: Mapping[Path, str]) -> dict[str, set[str]]:
    return {folder: set(others) for folder, others in arrows.arrows(files).items()}


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
