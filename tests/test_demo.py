"""The whole job: stages that resume, the pictures and the page, and `svv demo` end to end on tiny data."""

from __future__ import annotations

from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from svv.errors import Cancelled, Progress
from svv.io.output import write_mp4, write_png
from svv.measure import measured
from svv.report.page import Page, Picture, Table, cost_table, write_page
from svv.report.pictures import error_picture, hex_colour, over_white, sheet, shrunk
from svv.report.stages import Stages, fingerprint


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


def test_a_changed_file_has_another_fingerprint(tmp_path: Path) -> None:
    file = tmp_path / "a"
    file.write_text("one")
    before = fingerprint(file)
    assert fingerprint(file) == before
    file.write_text("three")
    assert fingerprint(file) != before


def test_peak_memory_is_that_of_the_work_alone() -> None:
    with measured() as large:
        np.ones(40_000_000).sum()
    with measured() as small:
        np.ones(1000).sum()
    assert large.peak_rss_bytes > 320_000_000
    assert small.peak_rss_bytes < large.peak_rss_bytes - 250_000_000


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
    assert hex_colour((1.0, 0.5, 0.0)) == "#ff8000"
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
    parts = [
        Picture("Heading & more", "Text.", tmp_path / "a.png"),
        Table("Table", "Text.", ["Name", "Colour"], [["a", "#ff0000"]], swatch=1),
        cost_table([cost]),
    ]
    write_page(tmp_path / "r.html", Page("A title", "Text", [("3", "things")], tmp_path / "a.mp4", parts, [("k", "v")]))
    text = (tmp_path / "r.html").read_text()
    sources = Sources()
    sources.feed(text)
    assert sources.open == []
    assert [link.split(",")[0] for link in sources.links] == ["data:video/mp4;base64", "data:image/jpeg;base64"]
    assert "url(" not in text
    for expected in ("Heading &amp; more", "Training &lt;1&gt;", "1 min 10 s", "2.00 GB", "background:#ff0000"):
        assert expected in text
