"""An assistant drives svv in one folder: the tools, their bounds, and a dialogue through the official client."""

from __future__ import annotations

import asyncio
import os
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from svv.errors import BadInput
from svv.fields.scene.scene import Scene
from svv.job.workshop import TOOLS, Workshop
from tests.cube import cube_scene

MISSING = "the package mcp is missing: install svv[agents]"


@pytest.fixture
def workshop(tmp_path: Path) -> Workshop:
    """A folder with a scene."""
    (tmp_path / "root").mkdir()
    cube_scene().save(tmp_path / "root" / "cube.svv")
    return Workshop(tmp_path / "root")


@pytest.mark.slow
@pytest.mark.usefixtures("broad_strokes")
def test_tools_do_what_they_say(workshop: Workshop) -> None:
    assert workshop.files() == ["cube.svv"]
    assert workshop.name("cube.svv", {"0": "shell", "1": "ring"}, "named.svv") == "named.svv"
    assert [r["name"] for r in workshop.info("named.svv")["regions"]] == ["shell", "ring", None]
    said = workshop.edit("named.svv", "shell pale jade, hide the ring", "said.svv")
    assert said == ["shell: colour pale jade (#9ad5b6)", "ring: hide", "said.svv"]
    assert workshop.render("said.svv", "said.png", 30.0, 10.0, 32) == "said.png"
    assert workshop.save_look("said.svv", "look.json") == "look.json"
    assert workshop.apply_look("look.json", "cube.svv", "same.svv")[-1] == "same.svv"
    assert Scene.load(workshop.root / "same.svv").regions[1].hidden
    assert workshop.apply_look("gallery:terracotta", "cube.svv", "clay.svv")[0].startswith("Region 0 looks like")
    assert workshop.stylize("cube.svv", ["ink:stippling"], "inked.svv", "draft") == "inked.svv"
    assert "gallery:oil" in workshop.styles() and "jade" in workshop.styles()
    assert set(TOOLS) <= set(dir(Workshop)) and all(getattr(Workshop, tool).__doc__ for tool in TOOLS)


@pytest.mark.parametrize(
    "name", ["../cube.svv", "/etc/passwd", "a/../../cube.svv", "", " ", "link/cube.svv", "cube\0.svv", "link"]
)
def test_nothing_outside_the_folder_is_read_or_written(workshop: Workshop, name: str) -> None:
    outside = workshop.root.parent / "outside"
    outside.mkdir()
    cube_scene().save(outside / "cube.svv")
    (workshop.root / "link").symlink_to(outside)
    for act in (
        lambda: workshop.info(name),
        lambda: workshop.edit("cube.svv", "all red", name),
        lambda: workshop.render("cube.svv", name),
        lambda: workshop.stylize("cube.svv", [name], "a.svv"),
        lambda: workshop.apply_look(name, "cube.svv", "a.svv"),
        lambda: workshop.save_look("cube.svv", name),
        lambda: workshop.figure([name], "a.png"),
        lambda: workshop.train(name, "a.svv"),
        lambda: workshop.views(name, "views"),
        lambda: workshop.views("cube.svv", name),
    ):
        with pytest.raises(BadInput, match="not below the folder"):
            act()
    assert sorted(p.name for p in outside.iterdir()) == ["cube.svv"]
    assert "link/cube.svv" not in workshop.files()


def test_bad_arguments_are_one_sentence(workshop: Workshop) -> None:
    for act, words in (
        (lambda: workshop.edit("cube.svv", "frobnicate", "a.svv"), "was not understood"),
        (lambda: workshop.edit("cube.svv", "all red", "a.txt"), "A scene is a .svv"),
        (lambda: workshop.render("cube.svv", "a.jpg"), "A picture is a .png"),
        (lambda: workshop.render("cube.svv", "a.png", size=100_000), "16 to 2048 pixels"),
        (lambda: workshop.render("cube.svv", "a.png", elevation=100.0), "no side"),
        (lambda: workshop.name("cube.svv", {"x": "bone"}, "a.svv"), "no region's number"),
        (lambda: Workshop(workshop.root / "none"), "There is no folder"),
    ):
        with pytest.raises(BadInput, match=words):
            act()  # type: ignore[no-untyped-call]


def test_without_the_package_one_sentence_says_what_to_install(
    workshop: Workshop, monkeypatch: pytest.MonkeyPatch
) -> None:
    from svv.job import agents

    monkeypatch.setattr(agents, "find_spec", lambda name: None)
    with pytest.raises(BadInput, match="pip install 'svv\\[agents\\]'"):
        agents.server_for(workshop.root)


@pytest.mark.skipif(find_spec("mcp") is None, reason=MISSING)
def test_a_dialogue_through_the_official_client(workshop: Workshop) -> None:
    from mcp import ClientSession, StdioServerParameters
    from mcp.client.stdio import stdio_client

    words = ["-m", "svv", "mcp", "--root", str(workshop.root)]
    started = StdioServerParameters(command=sys.executable, args=words, env=dict(os.environ))

    async def talk() -> None:
        async with stdio_client(started) as (read, write), ClientSession(read, write) as session:
            await session.initialize()
            tools = (await session.list_tools()).tools
            assert {tool.name for tool in tools} == set(TOOLS) and all(tool.description for tool in tools)
            named = {"scene": "cube.svv", "names": {"0": "shell"}, "out": "named.svv"}
            assert not (await session.call_tool("name", named)).is_error
            told = {"scene": "named.svv", "say": "make the shell pale jade", "out": "jade.svv"}
            answer = await session.call_tool("edit", told)
            assert "shell: colour pale jade" in str(answer.content)
            seen = await session.call_tool("render", {"scene": "jade.svv", "out": "jade.png", "size": 32})
            assert [part.type for part in seen.content] == ["text", "image"] and not seen.is_error
            refused = await session.call_tool("info", {"scene": "../cube.svv"})
            assert refused.is_error and "not below the folder" in str(refused.content)
            unknown = await session.call_tool("edit", {**told, "say": "frobnicate"})
            assert unknown.is_error and "was not understood" in str(unknown.content)

    asyncio.run(talk())
    assert (workshop.root / "jade.png").is_file()
