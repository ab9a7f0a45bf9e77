"""Code blocks of the documentation, and what they need to run: scenes, pictures, and a stand-in for the shell."""

from __future__ import annotations

import ast
import json
import re
import shlex
import sys
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import typer
from PIL import Image
from vtkmodules.vtkIOXML import vtkXMLImageDataWriter

from svv.cli.app import app
from svv.core.geometry.cameras import look_at
from svv.dvr.draw.views import make_views
from svv.fields.scene.scene import Scene
from svv.styles.gallery.offered import GALLERY
from svv_bench.stability.scenes import EASY
from tests.cinema_database import write as write_database
from tests.cinema_database import write_over
from tests.cube import cube_paint, cube_scene, lit_cube_scene

ROOT = Path(__file__).resolve().parents[1]

BLOCK = re.compile(r"(?:<!-- not run: ([^\n]+) -->\n\n?)?^```(\w+)\n(.*?)^```", re.MULTILINE | re.DOTALL)

QUICK = {"import", "export", "info", "edit", "render", "style-mask", "features", "cache"}
"""Commands that are run as they stand, but for the size and the number of their pictures, and of splats."""

LEARNING = {"run", "train", "palette", "stylize", "apply"}
"""Commands that are not run; a scene that nobody trained takes the place of what they would write."""

PROGRAMS = {
    "cd",
    "do",
    "done",
    "for",
    "cmake",
    "ctest",
    "conda",
    "export",
    "mpiexec",
    "paraview",
    "pip",
    "pytest",
    "sudo",
    "~/svv/bin/svv-paraview",
}
"""Other programs that pages may name; nothing about their lines is checked."""


@dataclass(frozen=True)
class Block:
    """A fenced block of a page: its language, its text, and why it is not run, if it is not."""

    page: Path
    line: int
    language: str
    text: str
    not_run: str | None

    def __str__(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"


def blocks(page: Path, *languages: str) -> Iterator[Block]:
    """The blocks of a page in the given languages, in order."""
    text = page.read_text(encoding="utf-8")
    for found in BLOCK.finditer(text):
        why, language, inside = found.groups()
        if language in languages:
            yield Block(page, text.count("\n", 0, found.start(2)) + 1, language, inside, why)


def commands(block: Block) -> Iterator[list[str]]:
    """The commands of a block for the shell: words without comments; a trailing backslash continues a line."""
    for line in re.sub(r"\\\n\s*", " ", block.text).splitlines():
        for command in re.split(r" && ", line):
            words = shlex.split(command, comments=True)
            if words:
                yield words


def fill(folder: Path) -> None:
    """Write what the examples start from: scenes, a volume with its transfer function, views and style pictures."""
    cube = cube_scene()
    cube.save(folder / "scene.svv")
    cube_scene(1).save(folder / "other.svv")
    lit_cube_scene().save(folder / "lit.svv")
    paint(cube, "styled", ()).save(folder / "styled.svv")
    for number, name in enumerate(("brush.png", "ink.png", "a.jpg", "b.jpg", "brush.jpg")):
        noise = np.random.default_rng(number).integers(0, 255, (64, 64, 3)).astype(np.uint8)
        Image.fromarray(noise).save(folder / name)
    volume, function = EASY.volume(32), EASY.transfer_function()
    writer = vtkXMLImageDataWriter(file_name=str(folder / "head.vti"), input_data_object=volume)
    writer.SetDataModeToBinary()
    assert writer.Write()
    (folder / "head.json").write_text(json.dumps(function.to_dict()))
    train, _ = make_views(volume, function, n=16, size=64, mapper="cpu")
    train.write(folder / "views")
    write_database(folder / "head.cdb")
    write_over(folder / "white.cdb", 255.0)
    write_over(folder / "black.cdb", 0.0)
    poses = [look_at(position, (0.0, 0.0, 0.0)).tolist() for position in ((0, 0, 4), (2, 0, 0))]
    (folder / "keys.json").write_text(json.dumps({"fov": 30, "frames": [{"camera_to_world": one} for one in poses]}))
    (shot,) = blocks(ROOT / "docs" / "how-to" / "movies.md", "json")
    (folder / "shot.json").write_text(shot.text)
    (folder / "head.pvsm").write_text(
        '<ParaView><Proxy group="views"><Property name="CameraPosition"><Element index="0" value="0"/>'
        '<Element index="1" value="0"/><Element index="2" value="6"/></Property></Proxy></ParaView>'
    )


def paint(scene: Scene, variant: str, keep: Collection[int]) -> Scene:
    """A scene painted at random under a variant's name, which may be there already, but for some regions."""
    if variant in scene.variants:
        scene = scene.without_variant(variant)
    styles = {region: "brush" for region in range(len(scene.regions)) if region not in keep}
    return scene.painted(cube_paint(scene, 1), styles, {}, variant)


def run(words: Sequence[str]) -> None:
    """Do what a line for the shell says, or check what can be known of it without doing it.

    Raises:
        AssertionError: A program, a target, a script or an option that is not there.
        svv.errors.BadInput: A command that does not accept what it is given.
    """
    program, *arguments = words
    if program in ("svv", ".venv/bin/svv"):
        _svv(arguments)
    elif program == "torchrun":
        command = arguments.index("svv")
        assert arguments[command - 1] == "-m", words
        _svv(arguments[command + 1 :])
    elif program == "make":
        targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
        assert {a for a in arguments if "=" not in a} <= set(targets), words
    elif program == ".venv/bin/python":
        _python(arguments)
    elif program == "mkdir":
        Path(arguments[0]).mkdir()
    else:
        assert program in PROGRAMS, f"Nothing is known of {program}: {shlex.join(words)}"


def _svv(arguments: Sequence[str]) -> None:
    name, rest = "svv", list(arguments)
    command: Any = typer.main.get_command(app)
    while hasattr(command, "commands") and rest and not rest[0].startswith("-"):
        name, *rest = rest
        command = command.get_command(None, name)
        assert command is not None, f"There is no command {name}."
    if name in ("pvpython", "pvbatch") and "paraview_scripts" in " ".join(rest):
        _script(rest)
        return
    if rest in (["--help"], ["-h"]):
        return
    context = command.make_context(name, list(rest))
    if name in QUICK and "--get" not in rest and "--from" not in rest:
        app(_smaller(name, arguments), prog_name="svv", standalone_mode=False)
    elif name in LEARNING:
        _stand_in(name, context.params)


def _smaller(name: str, arguments: Sequence[str]) -> list[str]:
    """The same command with small pictures, and few of them, or few splats."""
    words = [
        re.sub(r"^\d+$", "2", word) if before in ("--orbit", "--path") else word for before, word in _pairs(arguments)
    ]
    if name == "export" and Path(words[words.index("--out") + 1]).suffix in (".ply", ".spz", ".glb"):
        return [*words, "--splats", "300", "--steps", "3"]
    if name != "render":
        return words
    if "--size" in words:
        at = words.index("--size")
        del words[at : at + 2]
    return [*words, "--size", "32"]


def _pairs(words: Sequence[str]) -> Iterator[tuple[str, str]]:
    return zip(("", *words[:-1]), words, strict=True)


def _stand_in(name: str, parameters: dict[str, Any]) -> None:
    """Write a scene where a command that trains would."""
    if name == "run":
        parameters["out"].mkdir()
        paint(cube_scene(), "styled", ()).save(parameters["out"] / "styled.svv")
        return
    if name == "train":
        lit = getattr(parameters["lighting"], "value", parameters["lighting"]) in ("phong", "auto")
        made = lit_cube_scene() if lit else cube_scene()
    else:
        made = Scene.load(parameters["scene"])
        if name == "stylize":
            named = {style.removeprefix("gallery:") for style in parameters["style"] if style.startswith("gallery:")}
            assert named <= set(GALLERY), f"The gallery has no {named - set(GALLERY)}."
            made = paint(made, parameters["variant"] or "styled", parameters["keep"] or ())
    if parameters["out"] is not None:
        made.save(parameters["out"])


def _script(arguments: Sequence[str]) -> None:
    """A script of ours in pvpython: it is there, and has the options that it is given."""
    path, *rest = (a for a in arguments if a != "--")
    source = (ROOT / path).read_text()
    names = {node.value for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Constant)}
    shared = {
        node.value
        for node in ast.walk(ast.parse((ROOT / "svv/pv/scripts/__init__.py").read_text()))
        if isinstance(node, ast.Constant)
    }
    missing = {a for a in rest if a.startswith("--")} - names - shared - {"--help"}
    assert not missing, f"{path} has no {missing}"


def _python(arguments: Sequence[str]) -> None:
    option, *rest = arguments
    if option == "-c":
        exec(compile(rest[0], "-c", "exec"), {})
    else:
        assert option == "-m", arguments
        assert all((ROOT / a).exists() for a in rest if "/" in a), arguments
        assert rest[0] in (*sys.stdlib_module_names, "pytest", "sphinx", "docs.screenshots", "docs.pictures"), arguments
