"""Tables of Cinema databases: any order of columns, quotes, blanks and line ends; incomplete ones are refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from svv.errors import BadInput
from svv.io.cinema.table import check_files, is_database, read_table, select
from tests.cinema_database import save_rows

COLUMNS = {"phi": ["000.00", "060.00"], "theta": ["30", "-30"], "producer": ["A view, with comma", 'a "b"'],
           "time": ["0.5", "1e-3"], "FILE_png": ["a b.png", "sub/c=1.png"]}  # fmt: skip
TEXT = st.text(st.characters(codec="utf-8", exclude_categories=("C", "Z")), min_size=1, max_size=8)


def cell(text: str, quoted: bool, before: str, after: str) -> str:
    if quoted or any(c in text for c in ',"'):
        return before + '"' + text.replace('"', '""') + '"'
    return before + text + after


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_layout_of_the_file_does_not_matter(tmp_path: Path, data: st.DataObject) -> None:
    columns = {**COLUMNS, "other": data.draw(st.lists(TEXT, min_size=2, max_size=2))}
    order = data.draw(st.permutations(list(columns)))
    blank, flag = st.sampled_from(["", " ", "  "]), st.booleans()
    lines = [
        ",".join(cell(text, data.draw(flag), data.draw(blank), data.draw(blank)) for text in row)
        for row in (list(order), *([columns[name][k] for name in order] for k in (0, 1)))
    ]
    end = data.draw(st.sampled_from(["\n", "\r\n", "\r"]))
    text = data.draw(st.sampled_from(["", "\ufeff"])) + end.join(lines) + data.draw(st.sampled_from(["", end, end * 2]))
    (tmp_path / "data.csv").write_bytes(text.encode())
    table = read_table(tmp_path)
    assert table.files == columns.pop("FILE_png")
    assert table.columns == columns


def test_a_hundred_thousand_rows_are_read(tmp_path: Path) -> None:
    lines = [f"{k % 360},{k // 360},0,V,{k}.png" for k in range(100_000)]
    (tmp_path / "data.csv").write_text("\r\n".join(["phi,theta,time,producer,FILE_png", *lines]))
    table, notes = select(read_table(tmp_path), {})
    assert len(table) == 100_000 and notes == []


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "no rows"),
        ("phi,theta,FILE\n", "no rows"),
        ("phi,theta,FILE\n1,2\n", "2 values in row 1, but 3 columns"),
        ("phi,theta\n1,2\n", "no column of images"),
        ("phi,theta,FILE\n1,2,mesh.vtp\n", "no column of images"),
        ("phi,PHI,FILE\n1,2,a.png\n", "two columns of the same name"),
    ],
)
def test_bad_tables(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "data.csv").write_text(text)
    with pytest.raises(BadInput, match=says):
        read_table(tmp_path)


def test_a_table_that_is_not_text(tmp_path: Path) -> None:
    (tmp_path / "data.csv").write_bytes(b"phi,theta,FILE\n\xff\xfe,1,a.png\n")
    with pytest.raises(BadInput, match="not a table"):
        read_table(tmp_path)


def rows(count: int = 3) -> list[dict[str, str]]:
    return [{"phi": str(k), "theta": "0", "FILE": f"{k}.png"} for k in range(count)]


def test_rows_and_files_belong_together(tmp_path: Path) -> None:
    save_rows(tmp_path, rows())
    for k in range(3):
        (tmp_path / f"{k}.png").touch()
    (tmp_path / "camera.json").touch()
    check_files(read_table(tmp_path))
    (tmp_path / "3.png").touch()
    with pytest.raises(BadInput, match=r"1 image that no row .* first is 3.png"):
        check_files(read_table(tmp_path))
    (tmp_path / "3.png").unlink()
    (tmp_path / "1.png").unlink()
    table, said = check_files(read_table(tmp_path))
    assert table.files == ["0.png", "2.png"] and table.columns["phi"] == ["0", "2"]
    assert said == "1 row of 3 has no image and is left out, the first is 1.png."
    (tmp_path / "0.png").unlink()
    with pytest.raises(BadInput, match=r"2 rows of 3 have no image, the first is 0.png"):
        check_files(read_table(tmp_path))


def test_a_row_without_a_file_is_named(tmp_path: Path) -> None:
    save_rows(tmp_path, [{**row, "FILE": "" if row["phi"] == "1" else row["FILE"]} for row in rows()])
    for k in (0, 2):
        (tmp_path / f"{k}.png").touch()
    table, said = check_files(read_table(tmp_path))
    assert table.files == ["0.png", "2.png"] and said is not None and "row 2, which names no file" in said


def test_layers_are_not_the_picture(tmp_path: Path) -> None:
    save_rows(tmp_path, [{"phi": "0", "FILE": "a.png", "FILE_depth": "d.png", "FILE_region_0": "r.png"}])
    table = read_table(tmp_path)
    assert table.files == ["a.png"] and table.all_files == {"a.png", "d.png", "r.png"}


def test_one_value_of_every_parameter(tmp_path: Path) -> None:
    save_rows(
        tmp_path,
        [
            {"phi": str(phi), "theta": "0", "time": f"{t}.0", "timestep": str(10 * t), "FILE": f"{t}{phi}.png"}
            for t in (0, 1)
            for phi in (0, 90)
        ],
    )
    table, notes = select(read_table(tmp_path), {})
    assert table.files == ["00.png", "090.png"] and table.chosen == (("time", "0.0"),)
    assert len(notes) == 1 and "time is 0.0, the first of 2" in notes[0]  # the time step follows
    later, notes = select(read_table(tmp_path), {"TIME": "1"})
    assert later.files == ["10.png", "190.png"] and later.columns["timestep"] == ["10", "10"] and notes == []
    assert select(read_table(tmp_path), {"timestep": "10"})[0].files == later.files
    with pytest.raises(BadInput, match=r"no time '7'; it has 0.0, 1.0"):
        select(read_table(tmp_path), {"time": "7"})
    with pytest.raises(BadInput, match="no column 'speed'"):
        select(read_table(tmp_path), {"speed": "7"})


def ascent(folder: Path, times: object = ("0.0", "1.0")) -> None:
    content = {
        "type": "simple",
        "version": "1.1",
        "metadata": {"type": "parametric-image-stack"},
        "name_pattern": "{time}/{phi}_{theta}_run.png",
        "arguments": {
            "time": {"default": "0.0", "values": times},
            "phi": {"default": "-180.0", "values": ["-180.0", "0.0"]},
            "theta": {"default": "0.0", "values": ["0.0", "90.0"]},
        },
    }
    folder.mkdir(exist_ok=True)
    (folder / "info.json").write_text(json.dumps(content))


def test_ascent(tmp_path: Path) -> None:
    assert not is_database(tmp_path)
    ascent(tmp_path)
    assert is_database(tmp_path) and is_database(tmp_path / "info.json")
    table = read_table(tmp_path)
    assert table.ascent and len(table) == 8 and table.files[5] == "1.0/-180.0_90.0_run.png"
    save_rows(tmp_path, rows())  # newer versions write both
    assert read_table(tmp_path).ascent and len(read_table(tmp_path)) == 3


def test_ascent_with_one_time(tmp_path: Path) -> None:
    ascent(tmp_path, "0.0")
    assert len(read_table(tmp_path)) == 4


@pytest.mark.parametrize("content", ["{", "[]", '{"name_pattern": 3}', '{"name_pattern": "{phi}.png"}'])
def test_other_info_files_are_no_databases(tmp_path: Path, content: str) -> None:
    (tmp_path / "info.json").write_text(content)
    assert not is_database(tmp_path)
    with pytest.raises(BadInput, match="not a Cinema database"):
        read_table(tmp_path)


def test_rows_that_were_not_selected_may_name_missing_folders(tmp_path: Path) -> None:
    (tmp_path / "data.csv").write_text("phi,theta,time,FILE\n0,0,0,a.png\n60,0,0,b.png\n0,0,1,http://127.0.0.1/c.png\n")
    for name in ("a.png", "b.png"):
        (tmp_path / name).touch()
    table, _ = select(read_table(tmp_path), {})
    assert table.files == ["a.png", "b.png"]
    check_files(table)
