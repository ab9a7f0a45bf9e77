"""Measurements: one file of results, pages made from its newest rows, and marks on what is older than its code."""

from __future__ import annotations

import re
import runpy
import subprocess
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from svv.cli import app
from svv.errors import BadInput
from svv_bench import results
from svv_bench.results import FILE, Figure, Result, append, cells, changed, newest, read, record
from svv_bench.stability import table as stability
from tests.frame_folders import alexnet, shifted, write

__all__ = ["alexnet"]

DOCS = Path(__file__).resolve().parents[1] / "docs"
TABLES = SimpleNamespace(**runpy.run_path(str(DOCS / "tables.py")))
PAGES = sorted(page for folder in TABLES.FOLDERS for page in folder.glob("*.md"))


def one(value: str, day: str, row: str = "head", column: str = "PSNR", **more: str) -> Result:
    return Result("page/table", row, column, value, "dB", day, "abc1234", "two cores", "svv bench chart", **more)


def test_what_is_appended_is_read_with_its_origin(tmp_path: Path) -> None:
    file = tmp_path / "results.csv"
    append(file, [Figure("chart/runs", "head | fast", "PSNR", "38.64", "dB")], "svv bench chart 'a, b'", "svv/train")
    append(file, [Figure("chart/runs", "head | fast", "SSIM", ".985")], "svv bench chart views")
    first, second = read(file)
    assert (first.what, first.value, first.unit) == (("chart/runs", "head | fast", "PSNR"), "38.64", "dB")
    assert (first.command, first.paths, second.paths) == ("svv bench chart 'a, b'", "svv/train", "svv")
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", first.date) and first.machine
    assert re.fullmatch(r"([0-9a-f]{7,}\+?)?", first.commit)


def test_a_command_records_only_where_it_is_told_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file, figures = tmp_path / "results.csv", cells("a/b", [("x", [0.1234, None])], [("y", "s", ".2f"), ("z", "", "")])
    record(figures)
    monkeypatch.setattr("sys.argv", ["/bin/svv", "bench", "--results", str(file), "chart", "views"])
    token = FILE.set(file)
    record(figures)
    FILE.reset(token)
    (found,) = read(file)
    assert (found.column, found.value, found.command) == ("y", "0.12", "svv bench chart views")


@pytest.mark.parametrize(
    "text",
    [
        "", "table,row\n", ",".join(results.COLUMNS) + "\na,b\n",
        ",".join(results.COLUMNS) + "\na,b,c,,dB,2026-11-27,,,,\n",
        ",".join(results.COLUMNS) + "\na,b,c,1,dB,27 November,,,,\n",
    ],
)  # fmt: skip
def test_what_is_no_file_of_results_is_a_sentence_and_stays(text: str, tmp_path: Path) -> None:
    file = tmp_path / "results.csv"
    file.write_text(text)
    with pytest.raises(BadInput, match=r"results\.csv"):
        append(file, [Figure("a/b", "c", "d", "1")], "command")
    assert file.read_text() == text


def test_the_newest_figure_counts_in_the_place_of_the_first() -> None:
    old, other, new = one("38.1", "2026-11-24"), one("35.0", "2026-11-24", "stent"), one("39.2", "2026-11-26")
    assert newest([old, other, new]) == [new, other]
    assert newest([new, other, old]) == [new, other]


def test_a_table_has_units_in_its_head_and_the_origin_below() -> None:
    rows = [one("38.1", "2026-11-24"), one(".98", "2026-11-24", column="SSIM")]
    page = "Words.\n\n<!-- table page/table: scene -->\n<!-- end -->\n\nMore.\n"
    made = TABLES.filled(page, rows)
    assert "| scene | PSNR, dB | SSIM, dB |\n|---|---|---|\n| head | 38.1 | .98 |\n" in made
    assert "*2026-11-24, `abc1234`, two cores*: `svv bench chart`" in made
    assert TABLES.filled(made, rows) == made
    with pytest.raises(KeyError):
        TABLES.filled(page.replace("page/table", "page/other"), rows)


def test_rows_of_several_origins_say_which_is_whose() -> None:
    rows = [one("38.1", "2026-11-24"), one("35.0", "2026-11-26", "stent")]
    made = TABLES.markdown(rows, ["scene"], lambda _: "")
    assert "| head¹ | 38.1 |" in made and "| stent² | 35.0 |" in made
    assert "\n¹ *2026-11-24," in made and "\n² *2026-11-26," in made


def test_keys_of_several_columns_are_not_repeated() -> None:
    rows = [one("1", "2026-11-24", "head | base"), one("2", "2026-11-24", "head | PCN")]
    made = TABLES.markdown(rows, ["scene", "network"], lambda _: "")
    assert "| head | base | 1 |\n|  | PCN | 2 |" in made


def test_figures_older_than_their_code_are_marked_and_others_are_not() -> None:
    last = {"svv/train": "2026-11-26", "svv/dvr": "2026-11-24", "svv/unknown": None}
    for day, paths, expected in (
        ("2026-11-25", "svv/train", "2026-11-26"), ("2026-11-26", "svv/train", ""), ("2026-11-25", "svv/dvr", ""),
        ("2026-11-25", "svv/unknown", ""),
    ):  # fmt: skip
        result = one("1", day, paths=paths)
        assert TABLES.older(result, last.get) == expected
        marked = TABLES.markdown([result], ["scene"], lambda r: TABLES.older(r, last.get))
        assert ("Older than the code that it measures, which changed on 2026-11-26" in marked) == bool(expected)


def test_git_says_when_code_changed_unless_history_is_cut_off(tmp_path: Path) -> None:
    def ask(*words: str, folder: Path = tmp_path) -> str | None:
        done = subprocess.run(["git", "-C", str(folder), *words], capture_output=True, text=True)
        return done.stdout.strip() if done.returncode == 0 else None

    assert changed("a", ask) is None  # no repository
    ask("init", "-q")
    for name, day in (("a", "2026-11-20"), ("b", "2026-11-25")):
        (tmp_path / name).write_text(day)
        ask("add", name)
        who = ("-c", "user.name=x", "-c", "user.email=x@y", "-c", "commit.gpgsign=false")
        monkey = {"GIT_COMMITTER_DATE": f"{day}T12:00:00", "GIT_AUTHOR_DATE": f"{day}T12:00:00"}
        with pytest.MonkeyPatch.context() as patch:
            for variable, value in monkey.items():
                patch.setenv(variable, value)
            ask(*who, "commit", "-qm", name)
    assert changed("a", ask) == "2026-11-20" and changed("a b", ask) == "2026-11-25"
    assert changed("missing", ask) is None
    shallow = tmp_path / "shallow"
    subprocess.run(["git", "clone", "-q", "--depth", "1", f"file://{tmp_path}", str(shallow)], check=True)
    assert changed("a", lambda *words: ask(*words, folder=shallow)) is None


# --- what commands record -------------------------------------------------------------------------------------------


def call(*arguments: str | Path, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr("sys.argv", ["svv", "bench", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        app.main()
    return int(ended.value.code or 0)


@pytest.mark.usefixtures("alexnet")
def test_a_command_appends_what_it_measures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frames, file = write(tmp_path / "frames", shifted(3)), tmp_path / "results.csv"
    measured = ("consistency", frames, "--intervals", "1", "--flows", "tvl1", "--out", tmp_path / "out")
    assert call("--results", file, *measured, monkeypatch=monkeypatch) == 0
    found = {one.column: one for one in read(file)}
    assert {one.table for one in found.values()} == {"painting/frames"}
    assert 0 <= float(found["rmse_part"].value) < 1
    assert found["mse"].command.startswith("svv bench consistency ") and "results.csv" not in found["mse"].command
    assert call(*measured, monkeypatch=monkeypatch) == 0
    assert len(read(file)) == len(found) and FILE.get() is None


def test_what_is_no_file_of_results_is_refused_before_anything_is_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.csv"
    file.write_text("a,b\n1,2\n")
    assert call("--results", file, "stability", "--list", monkeypatch=monkeypatch) == 2
    assert "is no file of results" in capsys.readouterr().err and file.read_text() == "a,b\n1,2\n"


def test_what_a_bench_records_takes_the_place_of_what_stands_on_its_page() -> None:
    """The newest rows of the same things: their keys and columns are those of the page."""
    stand = {one.what for one in read(TABLES.FILE)}
    row = stability.Row("easy", "fast", 3, 28.5, 0.2, -1.2, 0.95, 0.5, None, 10.0, {})
    assert {one.what for one in stability.figures([row])} <= stand
    failed = stability.figures([replace(row, case="wires", failed={"blurred": 3})])
    assert failed[-1].value == "blurred (3/3)" and {one.what for one in failed} <= stand


# --- the pages as they are ------------------------------------------------------------------------------------------


def test_the_committed_pages_are_those_of_the_results() -> None:
    found = newest(read(TABLES.FILE))
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        assert TABLES.filled(text, found) == text, f"run docs/tables.py's write() for {page.name}"


def test_every_table_of_the_results_stands_on_its_page() -> None:
    stand = [
        (page.stem, match[0]) for page in PAGES
        for match in re.findall(r"<!-- table (\S+): ([^\n]*?) -->", page.read_text(encoding="utf-8"))
    ]  # fmt: skip
    assert all(name.partition("/")[0] == page for page, name in stand)
    assert sorted(name for _, name in stand) == sorted({result.table for result in read(TABLES.FILE)})


def test_what_figures_measure_is_there() -> None:
    for paths in {result.paths for file in (TABLES.FILE, DOCS / "design" / "archive.csv") for result in read(file)}:
        assert all((DOCS.parent / path).exists() for path in paths.split()), paths


def test_a_table_has_a_paragraph_of_words_at_most() -> None:
    """Between headings, a page has no more paragraphs and lists than tables, or one where there is no table."""
    for page in PAGES:
        text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
        for section in re.split(r"^#+ .*$", text, flags=re.MULTILINE)[1:]:
            tables = len(TABLES.PLACE.findall(section))
            words = [w for w in TABLES.PLACE.sub("", section).split("\n\n") if w.strip() and w.strip()[0] not in "|!<"]
            if tables:
                assert len(words) <= tables, f"{page.name}: {words}"
