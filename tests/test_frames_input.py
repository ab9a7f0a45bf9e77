"""``svv bench consistency FRAMES``: bad folders, guides, motions and options, each refused in a sentence."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from svv.cli import app as cli
from svv.errors import BadInput
from svv_bench.frames.measure import Compared
from svv_bench.frames.motion import read_flow
from svv_bench.frames.result import FolderJob, folder_consistency
from tests.frame_folders import NEAR, SIZE, alexnet, flows, pattern, shifted, write

__all__ = ["alexnet"]
pytestmark = pytest.mark.usefixtures("alexnet")


def empty(folder: Path) -> None:
    folder.mkdir()


def one_frame(folder: Path) -> None:
    write(folder, [pattern()])


def two_sizes(folder: Path) -> None:
    write(folder, [pattern(), pattern(), pattern(60)])


def broken(folder: Path) -> None:
    path = write(folder, shifted(3)) / "frame01.png"
    path.write_bytes(path.read_bytes()[:200])


def no_picture(folder: Path) -> None:
    (write(folder, shifted(3)) / "frame01.png").write_text("thesis")


def only_text(folder: Path) -> None:
    folder.mkdir()
    (folder / "notes.txt").write_text("")


def a_movie(folder: Path) -> None:
    folder.mkdir()
    (folder / "orbit.mp4").write_bytes(b"")


def folders(folder: Path) -> None:
    write(folder / "ours", shifted(2))


def same_number(folder: Path) -> None:
    write(folder, shifted(2))
    write(folder, shifted(2), "frame{}.png")


def tiny(folder: Path) -> None:
    write(folder, [p[:8] for p in shifted(2)])


def animated(folder: Path) -> None:
    write(folder, shifted(2))
    first, *rest = (Image.fromarray(p) for p in shifted(3))
    first.save(folder / "frame02.tif", save_all=True, append_images=rest)


def some_alpha(folder: Path) -> None:
    write(folder, shifted(2))
    write(folder, [np.dstack([pattern(), pattern()[..., 0] // 2])])


def deep(folder: Path) -> None:
    write(folder, [pattern()[..., 0].astype(np.uint16) * 257] * 2)


def apart(folder: Path) -> None:
    write(folder, shifted(2), "{}.png")


@pytest.mark.parametrize(
    ("made", "job", "words"),
    [
        (lambda _: None, NEAR, "There is no folder"),
        (empty, NEAR, "holds no pictures"),
        (only_text, NEAR, "holds no pictures"),
        (a_movie, NEAR, "ffmpeg -i orbit.mp4"),
        (folders, NEAR, "give one of its folders, ours"),
        (one_frame, NEAR, "at least two"),
        (two_sizes, NEAR, "frame02.png has 60 x 48 pixels and frame00.png 48 x 48: give frames of one size"),
        (broken, NEAR, "frame01.png"),
        (no_picture, NEAR, "frame01.png"),
        (same_number, NEAR, "have the same number"),
        (tiny, NEAR, "at least 16 x 16"),
        (animated, NEAR, "holds 3 pictures"),
        (deep, NEAR, "save the frames with 8 bits"),
        (some_alpha, NEAR, "save all frames alike"),
        (apart, FolderJob(Compared((5, 7))), r"No two of the 2 frames in .* are 5 or 7 apart"),
    ],
)
def test_bad_folders(made: Callable[[Path], None], job: FolderJob, words: str, tmp_path: Path) -> None:
    made(tmp_path / "frames")
    with pytest.raises(BadInput, match=words):
        folder_consistency(tmp_path / "frames", tmp_path / "out", job)
    assert not (tmp_path / "out").exists()


def test_bad_guides_and_motions(tmp_path: Path) -> None:
    folder, out = write(tmp_path / "frames", shifted(3)), tmp_path / "out"
    fewer, other = write(tmp_path / "fewer", shifted(2)), write(tmp_path / "other", [pattern(60)] * 3)
    for guide, words in ((fewer, "no frame for frame02.png"), (other, "60 x 48 pixels and the others 48 x 48")):
        with pytest.raises(BadInput, match=words):
            folder_consistency(folder, out, FolderJob(Compared((1,)), guide=guide))
    with pytest.raises(BadInput, match="not both"):
        folder_consistency(folder, out, FolderJob(Compared((1,)), guide=folder, style=folder / "frame00.png"))
    with pytest.raises(BadInput, match="no folder"):
        folder_consistency(folder, out, FolderJob(Compared((1,)), motion=tmp_path / "nowhere"))
    given = flows(tmp_path / "flows", 1)
    with pytest.raises(BadInput, match=r"no flow for frame01\.png: it would be frame01\.flo"):
        folder_consistency(folder, out, FolderJob(Compared((1,)), motion=given))
    (given / "transforms.json").write_text(json.dumps({"camera_angle_x": 0.5, "frames": [{"file_path": "frame00"}]}))
    with pytest.raises(BadInput, match=r"no depth for frame01\.png"):
        folder_consistency(folder, out, FolderJob(Compared((1,)), motion=given))
    assert not out.exists()


def test_bad_flow_files(tmp_path: Path) -> None:
    good = flows(tmp_path, 1, name="{}.flo") / "0.flo"
    assert read_flow(good, (SIZE, SIZE)).shape == (SIZE, SIZE, 2)
    for content, words in ((good.read_bytes()[:-8], "truncated"), (b"PNG" * 40, "Middlebury")):
        (tmp_path / "bad.flo").write_bytes(content)
        with pytest.raises(BadInput, match=words):
            read_flow(tmp_path / "bad.flo", (SIZE, SIZE))
    np.save(tmp_path / "bad.npy", np.zeros((SIZE, SIZE)))
    with pytest.raises(BadInput, match="not a flow of 48 x 48 x 2"):
        read_flow(tmp_path / "bad.npy", (SIZE, SIZE))
    (tmp_path / "text.npy").write_text("0 1")
    with pytest.raises(BadInput, match="array of numbers"):
        read_flow(tmp_path / "text.npy", (SIZE, SIZE))


# --- the command -------------------------------------------------------------------------------------------------


def call(*arguments: str | Path, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(sys, "argv", ["svv", "bench", "consistency", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    return int(ended.value.code or 0)


def test_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write(tmp_path / "frames", shifted(3))
    arguments = (folder, "--intervals", "1,2", "--json", tmp_path / "c.json", "--out", tmp_path / "out")
    assert call(*arguments, monkeypatch=monkeypatch) == 0
    content = json.loads((tmp_path / "c.json").read_text())
    assert [r["interval"] for r in content["rows"]] == [1, 2] and len(content["pairs"]) == 3
    assert content["protocol"]["flow_from"] == "frames"
    assert "| frames/ tvl1 2 |" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["{f}", "--orbit", "11"], "--orbit: only for scenes"),
        (["{f}", "--oversample", "2", "--network", "pcn"], "--network and --oversample: only for scenes"),
        (["{f}", "--flows", "raft"], "--flows has no 'raft'"),
        (["{f}", "--flows", "depth"], "Frames have no depth"),
        (["{f}", "--style", "{p}", "--modes", "ours"], "no mode 'ours' that paints frames"),
        (["{f}", "--intervals", "0"], "--intervals"),
        (["{s}", "--guide", "{f}"], "--guide: only for folders of frames"),
        (["{p}"], "is a picture or a movie"),
    ],
)
def test_bad_use(
    arguments: list[str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    folder = write(tmp_path / "frames", shifted(3))
    given = [a.format(f=folder, p=folder / "frame00.png", s=tmp_path / "scene.svv") for a in arguments]
    assert call(*given, "--out", tmp_path / "out", monkeypatch=monkeypatch) == 2
    assert words in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "out").exists()
