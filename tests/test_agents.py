"""An assistant drives svv in one folder: the tools, their bounds, and a dialogue through the official client."""

from __future__ import annotations

import asyncio
import base64
import json
import os
import sys
import threading
import time
from collections.abc import Callable
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from svv.errors import BadInput, Cancelled, Progress
from svv.fields.scene.scene import Scene
from svv.io.pictures.output import write_png
from svv.job.agents import MOST_CHARACTERS, _server_for, _within
from svv.job.background import Jobs
from svv.job.workshop import TOOLS, Workshop
from tests.cube import cube_scene

MISSING = "the package mcp is missing: install svv[agents]"


@pytest.fixture
def workshop(tmp_path: Path) -> Workshop:
    """A folder with a scene."""
    (tmp_path / "root").mkdir()
    cube_scene().save(tmp_path / "root" / "cube.svv")
    return Workshop(tmp_path / "root")


def test_an_assistant_cuts_a_scene_open(workshop: Workshop) -> None:
    assert workshop.cut("cube.svv", "open.svv", ["x>50%", "1=y>0"]) == [
        "cut x > 0",
        "cut y > 0 of region 1",
        "open.svv",
    ]
    assert workshop.info("open.svv")["cuts"] == ["cut x > 0", "cut y > 0 of region 1"]
    said = workshop.cut("open.svv", "ball.svv", cut=["outside sphere:0,0,0:0.4"], uncut=True)
    assert said == ["cut all but ball of radius 0.4 at 0, 0, 0", "ball.svv"]
    with pytest.raises(BadInput, match="Nothing to cut"):
        workshop.cut("cube.svv", "a.svv")


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
    assert workshop.stylize("cube.svv", ["ink:stippling"], "inked.svv", "draft")[-1] == "inked.svv"
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
        agents.serve(workshop.root)


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
            assert {tool.name for tool in tools} == {*TOOLS, "job"} and all(tool.description for tool in tools)
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


def talk_in_memory(jobs: Jobs, talk: Callable[[Any], Any]) -> None:
    """A dialogue of the official client with the server in this process."""
    from mcp import Client

    async def run() -> None:
        async with Client(_server_for(jobs)) as client:
            await talk(client)

    asyncio.run(run())


@pytest.mark.skipif(find_spec("mcp") is None, reason=MISSING)
def test_long_tools_report_progress_and_stop_when_the_call_is_cancelled(
    workshop: Workshop, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The work is a stand-in that ends only if it is stopped; that tools pass progress on is tested with them below."""
    heard: list[tuple[float, float | None, str | None]] = []
    begun, stopped = threading.Event(), threading.Event()

    def train(self: Workshop, views: str, out: str, progress: Progress) -> str:
        """Train a scene."""
        if views == "bad":
            raise BadInput("These are no views.")
        begun.set()
        try:
            while out == "never" or not heard:
                progress(0.25, "half of a half")
                time.sleep(0.01)
            return out
        except Cancelled:
            stopped.set()
            raise

    async def listen(progress: float, total: float | None, message: str | None) -> None:
        heard.append((progress, total, message))

    async def talk(client: Any) -> None:
        monkeypatch.setattr("svv.job.agents.TELL_EVERY", 0.05)
        done = await client.call_tool("train", {"views": "v", "out": "soon"}, progress_callback=listen)
        assert done.content[0].text == "soon" and not done.is_error and len(heard) > 0
        refused = await client.call_tool("train", {"views": "bad", "out": "soon"})
        assert refused.is_error and refused.content[0].text.endswith("These are no views.")
        heard.clear()
        begun.clear()
        call = asyncio.create_task(client.call_tool("train", {"views": "v", "out": "never"}, progress_callback=listen))
        while not (begun.is_set() and len(heard) > 3):
            await asyncio.sleep(0.01)
        assert not stopped.is_set()
        call.cancel()
        while not stopped.is_set():
            await asyncio.sleep(0.01)
        fractions = [fraction for fraction, _, _ in heard]
        assert all(a < b for a, b in pairwise(fractions)), "the protocol wants it to grow"
        assert heard[-1][1:] == (1.0, "half of a half") and heard[-1][0] == pytest.approx(0.25, abs=1e-3)
        assert (await client.call_tool("files", {})).content[0].text == "cube.svv", "the server lives on"

    monkeypatch.setattr(Workshop, "train", train)
    talk_in_memory(Jobs(workshop), talk)


def test_every_long_tool_passes_the_progress_on(workshop: Workshop, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(fraction: float, label: str) -> None:
        raise Cancelled

    write_png(workshop.root / "style.png", np.random.default_rng(0).random((32, 32, 3)))
    np.save(workshop.root / "ball.npy", np.ones((8, 8, 8), np.float32) * np.arange(8, dtype=np.float32))
    workshop.views("ball.npy", "views", count=8, size=32)
    before = sorted(p.name for p in workshop.root.rglob("*"))
    for act in (
        lambda: workshop.views("ball.npy", "other", count=8, size=32, progress=stop),
        lambda: workshop.train("views", "a.svv", "draft", progress=stop),
        lambda: workshop.stylize("cube.svv", ["style.png"], "a.svv", "draft", progress=stop),
        lambda: workshop.edit("cube.svv", "region 0 as watercolour", "a.svv", progress=stop),
        lambda: workshop.apply_look("gallery:sunflower", "cube.svv", "a.svv", progress=stop),
        lambda: workshop.render("cube.svv", "a.png", size=32, progress=stop),
        lambda: workshop.figure(["cube.svv"], "a.png", progress=stop),
    ):
        with pytest.raises(Cancelled):
            act()
    assert sorted(p.name for p in workshop.root.rglob("*")) == before, "nothing is left half written"


@pytest.mark.skipif(find_spec("mcp") is None, reason=MISSING)
def test_a_tool_is_started_in_the_background_and_asked_after(workshop: Workshop) -> None:
    jobs = Jobs(workshop)

    async def talk(client: Any) -> None:
        async def ask(number: int, **more: object) -> tuple[dict[str, Any], list[Any]]:
            told = await client.call_tool("job", {"number": number, **more})
            assert not told.is_error, told.content
            return json.loads(told.content[0].text), told.content[1:]

        asked = {"scene": "cube.svv", "out": "cube.png", "size": 32, "background": True}
        started = await client.call_tool("render", asked)
        assert started.content[0].text == "Job 1 (render) is at work: ask for it with the tool job."
        twice = await client.call_tool("render", asked)
        assert twice.is_error and "Job 1 (render) is still at work" in twice.content[0].text
        while (told := await ask(1, wait=50))[0]["state"] == "running":
            pass
        ended = {"job": 1, "tool": "render", "state": "done", "fraction": 1.0, "label": "done", "result": "cube.png"}
        assert told[0].pop("seconds") > 0 and told[0] == ended
        assert [part.type for part in told[1]] == ["text", "image"] and (workshop.root / "cube.png").is_file()
        failing = await client.call_tool("train", {"views": "none", "out": "a.svv", "background": True})
        assert failing.structured_content == {"result": "Job 2 (train) is at work: ask for it with the tool job."}
        while (told := await ask(2, wait=50))[0]["state"] == "running":
            pass
        assert told[0]["state"] == "failed" and "none" in told[0]["error"]
        unknown = await client.call_tool("job", {"number": 3})
        assert unknown.is_error and "There is no job 3: 2 were started" in unknown.content[0].text

    talk_in_memory(jobs, talk)


@pytest.mark.slow
@pytest.mark.skipif(find_spec("mcp") is None, reason=MISSING)
def test_a_training_ends_when_it_is_stopped_and_when_the_client_leaves(workshop: Workshop) -> None:
    from mcp import Client, StdioServerParameters
    from mcp.client.stdio import stdio_client

    np.save(workshop.root / "ball.npy", np.ones((8, 8, 8), np.float32) * np.arange(8, dtype=np.float32))
    workshop.views("ball.npy", "views", count=8, size=32)
    before = {p.name for p in workshop.root.iterdir()}
    words = ["-m", "svv", "mcp", "--root", str(workshop.root)]
    started = StdioServerParameters(command=sys.executable, args=words, env={**os.environ, "MARK": str(workshop.root)})
    asked, mark = {"views": "views", "out": "a.svv", "preset": "best"}, f"MARK={workshop.root}"

    def at_work() -> list[int]:
        """Numbers of the server's process and those of its jobs, which have the environment that it was given."""
        return [int(p.parent.name) for p in Path("/proc").glob("[0-9]*/environ") if mark in read(p)]

    def read(path: Path) -> str:
        try:
            return path.read_bytes().decode(errors="replace")
        except OSError:
            return ""

    async def talk() -> None:
        async with Client(stdio_client(started)) as client:
            await client.call_tool("train", {**asked, "background": True})
            while (
                json.loads((await client.call_tool("job", {"number": 1, "wait": 1})).content[0].text)["fraction"] == 0
            ):
                pass
            told = json.loads((await client.call_tool("job", {"number": 1, "stop": True})).content[0].text)
            assert told["state"] == "stopped"
            assert {p.name for p in workshop.root.iterdir()} == before
            with pytest.raises(Exception, match=r"(?i)timed out"):
                await client.call_tool("train", asked, read_timeout_seconds=8.0)
            await client.call_tool("train", {**asked, "background": True})

    asyncio.run(talk())
    until = time.monotonic() + 60.0
    while at_work():
        assert time.monotonic() < until, "the server or a job works on"
        time.sleep(0.1)
    assert {p.name for p in workshop.root.iterdir()} == before


def test_a_picture_is_sent_smaller_rather_than_too_large(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (900, 600, 3), np.uint8)
    write_png(tmp_path / "noise.png", noise)
    write_png(tmp_path / "flat.png", np.full((900, 600, 3), 7, np.uint8))
    said, content = _within(tmp_path / "flat.png")
    assert (said, content) == ("", (tmp_path / "flat.png").read_bytes())
    said, content = _within(tmp_path / "noise.png")
    assert (
        len(base64.b64encode(content)) <= MOST_CHARACTERS < len(base64.b64encode((tmp_path / "noise.png").read_bytes()))
    )
    (tmp_path / "sent.png").write_bytes(content)
    with Image.open(tmp_path / "sent.png") as sent:
        width, height = sent.size
    assert said == f" has 600 x 900 pixels; it is shown at {width} x {height}, to be sent."
    assert width / height == pytest.approx(2 / 3, abs=0.01) and width > 300
    with Image.open(tmp_path / "noise.png") as whole:
        np.testing.assert_array_equal(np.asarray(whole), noise)
