"""The whole job: stages that resume, the pictures and the report page, and `svv demo` end to end on tiny data."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from svv.cli import app as cli
from svv.errors import BadInput, Cancelled, Progress
from svv.io.files.keyed_results import key_of
from svv.io.pictures.output import write_mp4, write_png
from svv.job.demo import run_demo
from svv.job.page import Page, Picture, Table, cost_table, write_page
from svv.job.run import run_job
from svv.job.source import ViewSource, VolumeSource
from svv.job.stages import Stages, fingerprint
from svv.job.steps import JobSettings
from svv.measure import measured
from svv.options.making import OrbitOptions, TrainOptions, ViewOptions
from svv.render.pictures import cropped, error_picture, over_white, sheet, shrunk
from svv.train.run.config import PRESETS, StylizeSettings
from tests.movies import frames_of


class Recipe:
    """Two stages, the second of which uses the first; notes which were done."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.done = folder, list[str]()

    def follow(self, first: int = 1, second: int = 1) -> list[str]:
        stages, self.done = Stages(self.folder), []
        files = {name: self.folder / f"{name}.txt" for name in ("first", "second")}

        def write(name: str) -> Callable[[Progress], None]:
            def work(progress: Progress) -> None:
                self.done.append(name)
                files[name].write_text("x")

            return work

        stages.do("first", "First", {"value": first}, [files["first"]], write("first"))
        stages.do("second", "Second", {"value": second}, [files["second"]], write("second"), ["first"])
        assert list(stages.costs) == ["first", "second"]
        return self.done


def test_a_stage_is_done_once_and_redone_with_what_depends_on_it(tmp_path: Path) -> None:
    recipe = Recipe(tmp_path)
    assert recipe.follow() == ["first", "second"]
    assert recipe.follow() == []
    assert recipe.follow(second=2) == ["second"]
    assert recipe.follow(first=2, second=2) == ["first", "second"]
    (tmp_path / "second.txt").unlink()
    assert recipe.follow(first=2, second=2) == ["second"]
    (tmp_path / "first.txt").unlink()
    assert recipe.follow(first=2, second=2) == ["first", "second"]
    (tmp_path / "stages.json").write_text("{ cut off")
    assert recipe.follow(first=2, second=2) == ["first", "second"]


def test_a_stopped_stage_is_not_done(tmp_path: Path) -> None:
    def stopped(progress: Progress) -> None:
        (tmp_path / "a").write_text("half")
        raise Cancelled

    with pytest.raises(Cancelled):
        Stages(tmp_path).do("a", "A", {}, [tmp_path / "a"], stopped)
    assert Stages(tmp_path).do("a", "A", {}, [tmp_path / "a"], lambda progress: None)


def test_a_job_that_fails_at_once_leaves_no_empty_folder(tmp_path: Path) -> None:
    (tmp_path / "noise.vti").write_text("no volume")
    with pytest.raises(BadInput, match=r"noise\.vti"):
        run_job(VolumeSource(tmp_path / "noise.vti"), [], tmp_path / "out", JobSettings())
    with pytest.raises(BadInput, match="no volume"):
        run_job(VolumeSource(tmp_path / "none.vti"), [], tmp_path / "out", JobSettings())
    with pytest.raises(BadInput, match="no views"):
        run_job(ViewSource(tmp_path), [], tmp_path / "out", JobSettings())
    assert [path.name for path in tmp_path.iterdir()] == ["noise.vti"]


def test_a_changed_file_has_another_fingerprint(tmp_path: Path) -> None:
    file = tmp_path / "a"
    file.write_text("one")
    before = key_of(fingerprint(file))
    os.utime(file, (1, 1))
    assert key_of(fingerprint(file)) == before
    file.write_text("three")
    assert key_of(fingerprint(file)) != before


@pytest.mark.parametrize(
    ("name", "header"),
    [
        ("a.mhd", "NDims = 3\nDimSize = 2 2 2\nElementType = MET_UCHAR\nElementDataFile = voxels.raw\n"),
        ("a.nhdr", "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 2\nencoding: raw\ndata file: voxels.raw\n"),
    ],
)
def test_a_volume_is_known_by_the_voxels_that_its_header_names(tmp_path: Path, name: str, header: str) -> None:
    (tmp_path / name).write_text(header)
    (tmp_path / "voxels.raw").write_bytes(b"12345678")
    source = VolumeSource(tmp_path / name)
    before = key_of(source.identity())
    assert key_of(source.identity()) == before
    (tmp_path / "voxels.raw").write_bytes(b"87654321")
    assert key_of(source.identity()) != before


def test_peak_memory_is_that_of_the_work_alone() -> None:
    with measured() as large:
        np.ones(40_000_000).sum()
    with measured() as small:
        np.ones(1000).sum()
    assert large.peak_rss_bytes > 320_000_000
    assert small.peak_rss_bytes < large.peak_rss_bytes - 250_000_000


def test_pictures_are_cropped_alike_and_nothing_seen_is_lost() -> None:
    pictures = [np.full((40, 50, 3), 255, np.uint8) for _ in range(2)]
    pictures[0][10, 20], pictures[1][30, 25] = (0, 0, 0), (255, 0, 255)
    ((a, b),) = cropped([pictures], margin=3)
    assert a.shape == b.shape == (21 + 2 * 3, 6 + 2 * 3, 3)
    assert (a[3, 3] == 0).all() and (b[-4, -4] == (255, 0, 255)).all()
    assert [p.shape for p in cropped([[pictures[0] * 0 + 255]])[0]] == [(40, 50, 3)]


def test_a_sheet_holds_its_pictures_unchanged() -> None:
    rng = np.random.default_rng(0)
    rows = [[rng.integers(0, 256, (40, 50, 3)).astype(np.uint8) for _ in range(3)] for _ in range(2)]
    picture = sheet(rows, ["truth", "network", "a label that is far too long for its column"], gap=4)
    head = picture.shape[0] - (2 * 44 - 4)
    assert picture.shape[1] == 3 * 54 - 4
    for r, row in enumerate(rows):
        for c, expected in enumerate(row):
            y, x = head + 44 * r, 54 * c
            np.testing.assert_array_equal(picture[y : y + 40, x : x + 50], expected)


def test_small_helpers_of_pictures() -> None:
    white, black = np.full((2, 2, 3), 255, np.uint8), np.zeros((2, 2, 3), np.uint8)
    assert (error_picture(white, white) == 255).all()
    assert (error_picture(white, black) == [150, 0, 20]).all()
    levels = np.array([[[255, 0, 0, 255], [0, 0, 255, 0]]], np.uint8)  # opaque red beside invisible blue
    np.testing.assert_array_equal(shrunk(levels, 1, 1)[0, 0], [255, 0, 0, 128])
    np.testing.assert_array_equal(over_white(levels), [[[255, 0, 0], [255, 255, 255]]])
    np.testing.assert_array_equal(over_white(levels.astype(np.float32) / 255), over_white(levels))


class Sources(HTMLParser):
    """Everything that a page would load, and the tags that stay open."""

    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.links += [value or "" for name, value in attributes if name in ("src", "href")]
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_a_page_needs_nothing_beside_it(tmp_path: Path) -> None:
    write_png(tmp_path / "a.png", np.zeros((8, 8, 3)))
    write_mp4(tmp_path / "a.mp4", [np.zeros((16, 16, 3), np.uint8)])
    cost = {"title": "Training <1>", "seconds": 70.0, "peak_rss_bytes": 2_000_000_000}
    parts: list[Picture | Table] = [
        Picture("Heading & more", "Text.", tmp_path / "a.png"),
        Table("Table", "Text.", ["Name", "Colour"], [["a", "#ff0000"]], swatch=(1,)),
        cost_table([cost]),
    ]
    write_page(tmp_path / "r.html", Page("A title", "Text", [("3", "things")], tmp_path / "a.mp4", parts, [("k", "v")]))
    text = (tmp_path / "r.html").read_text()
    sources = Sources()
    sources.feed(text)
    assert sources.open == []
    assert [link.split(",")[0] for link in sources.links] == ["data:video/mp4;base64", "data:image/jpeg;base64"]
    assert "url(" not in text
    assert 'aria-label="A title, seen from all around"' in text and 'alt="Heading &amp; more"' in text
    for expected in ("Heading &amp; more", "Training &lt;1&gt;", "1 min 10 s", "2.00 GB", "background:#ff0000"):
        assert expected in text


SMALL = JobSettings(
    ViewOptions(n=12, test=2, size=64, mapper="cpu"),
    TrainOptions("draft", change=("reconstruct.iterations=20", "recolour.iterations=10")),
    OrbitOptions(orbit=4, orbit_size=64),
    recolour=True,
)
PAINT = StylizeSettings(style_views=6, style_size=96)
RESOLUTION = 24


@dataclass
class Shown:
    """Notes which stages are shown; raises like Ctrl-C in one of them."""

    stop_in: str | None = None
    titles: list[str] = field(default_factory=list)

    @contextmanager
    def __call__(self, title: str) -> Iterator[Progress]:
        self.titles.append(title)

        def progress(fraction: float, label: str) -> None:
            assert -1e-9 <= fraction <= 1 + 1e-9
            if title == self.stop_in and fraction > 0.3:
                raise Cancelled

        yield progress


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory, broad_strokes: None) -> Iterator[Path]:
    """A tiny demo that was stopped in the middle of its training and then begun again."""
    out = tmp_path_factory.mktemp("demo") / "out"
    stopped, again = Shown(stop_in="Training"), Shown()
    with pytest.MonkeyPatch.context() as patched:
        patched.setitem(PRESETS, "draft", replace(PRESETS["draft"], stylize=PAINT))
        with pytest.raises(Cancelled):
            run_demo(out, SMALL, RESOLUTION, stopped)
        assert not (out / "scene.svv").exists()
        run_demo(out, SMALL, RESOLUTION, again)
        assert stopped.titles == ["Volume and styles", "Drawing 12 + 2 views", "Training"]
        assert again.titles[0] == "Training"
        yield out


def test_the_demo_leaves_what_it_promises(finished: Path) -> None:
    there = {path.name for path in finished.iterdir()}
    assert there >= {
        "volume.vti", "tf.json", "oil.png", "impasto.png", "watercolour.png", "views", "scene.svv",
        "recoloured.svv", "styled.svv", "orbit", "orbit.mp4", "contact.png", "unseen.png", "regions.png", "report.html",
        "scene.html",
    }  # fmt: skip
    assert 'href="scene.html"' in (finished / "report.html").read_text()
    assert not [name for name in there if name.endswith("checkpoint") or name.startswith(".")]
    orbits = {path.name: len(list(path.iterdir())) for path in (finished / "orbit").iterdir()}
    assert orbits == {"volume-rendering": 4, "palette-network": 4, "recoloured": 4, "styled": 4}
    frames = frames_of(finished / "orbit.mp4")
    assert len(frames) == 4
    assert frames.shape[2] >= 4 * 64


def test_the_figures_have_the_promised_keys(finished: Path) -> None:
    for name in ("train.json", "stylize.json"):
        report = json.loads((finished / name).read_text())
        assert report.keys() >= {
            "seconds", "peak_rss_bytes", "parameters", "scene_bytes", "device", "seed", "preset",
        }  # fmt: skip
        assert report["seconds"]["total"] > 0
    scores = json.loads((finished / "scores.json").read_text())
    for network in ("base", "pcn"):
        assert scores[network].keys() >= {
            "psnr", "psnr_foreground", "ssim", "flip", "lpips", "views", "size", "seconds_per_view", "network",
            "background",
        }  # fmt: skip
        assert scores[network]["views"] == 2
        assert scores[network]["psnr"] > 12  # an empty picture of this volume has about 10 dB


def test_the_variants_differ_where_they_should(finished: Path) -> None:
    def frame(name: str) -> np.ndarray:
        return over_white(np.asarray(Image.open(finished / "orbit" / name / "0001.png").convert("RGBA"))).astype(int)

    plain = frame("palette-network")
    assert np.abs(plain - frame("volume-rendering")).mean() < 40
    for name in ("recoloured", "styled"):
        assert np.abs(plain - frame(name)).max() > 20  # of 255


def test_the_same_demo_again_does_nothing(finished: Path) -> None:
    shown = Shown()
    run_demo(finished, SMALL, RESOLUTION, shown)
    assert shown.titles == []


def test_another_orbit_trains_nothing(finished: Path) -> None:
    shown = Shown()
    run_demo(finished, replace(SMALL, path=OrbitOptions(3, 64)), RESOLUTION, shown)
    assert [title.split(":")[0] for title in shown.titles] == ["Orbit", "Orbits", "Side by side"]


def test_commands_on_the_trained_scene(finished: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def svv(*arguments: str | Path) -> str:
        cli.app([str(a) for a in arguments], prog_name="svv", standalone_mode=False)
        return capsys.readouterr().out

    scene, red = finished / "scene.svv", tmp_path / "red.svv"
    assert "0: colour #" in svv("info", scene, "--json", tmp_path / "info.json")
    info = json.loads((tmp_path / "info.json").read_text())
    assert info["networks"] == ["base", "pcn"]
    svv("edit", scene, "--region", "0", "--colour", "#ff0000", "--opacity", "0.5", "--out", red)
    svv("info", red, "--json", tmp_path / "info.json")
    region = json.loads((tmp_path / "info.json").read_text())["regions"][0]
    assert (region["edited_colour"], region["opacity"]) == ([1.0, 0.0, 0.0], 0.5)
    for name in (scene, red):
        svv("render", name, "--size", "48", "--out", tmp_path / f"{name.stem}.png")
    before, after = (np.asarray(Image.open(tmp_path / f"{name}.png")).astype(int) for name in ("scene", "red"))
    assert np.abs(before - after).max() > 20
    svv("evaluate", scene, "--views", finished / "views", "--network", "base", "--json", tmp_path / "scores.json")
    assert json.loads((tmp_path / "scores.json").read_text())["network"] == "base"
    with pytest.raises(BadInput, match="no region 99"):
        svv("edit", scene, "--region", "99", "--opacity", "0", "--out", tmp_path / "none.svv")
    with pytest.raises(BadInput, match="styled"):
        svv("render", scene, "--network", "styled", "--out", tmp_path / "none.png")
    assert not list(tmp_path.glob("none*"))
