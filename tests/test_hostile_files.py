"""Files that are damaged or meant to harm: each once ended with a traceback, took memory, or touched other files."""

from __future__ import annotations

import io
import json
import os
import signal
import struct
import subprocess
import sys
import time
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from PIL import Image

from campaign.of_tables import LAUGHS, META, PRESET, SCRIPT, STATE, VTI
from campaign.of_views import HEADERS, PICKLE, SETS, npz, pose, prepared
from svv.bricks.formats.mapped import open_npy, open_vti
from svv.bricks.opened import open_bricks
from svv.core.geometry.cameras import Camera, CameraRig
from svv.core.json_values import parsed
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.errors import BadInput
from svv.io.cinema.shot import read_shot
from svv.io.cinema.table import read_table
from svv.io.pictures.mask_file import picture_size, read_mask, read_selection
from svv.io.pictures.style_picture import read_style
from svv.io.series_file import read_series
from svv.io.views.camera_file import read_camera
from svv.io.views.transforms import camera_in, file_in
from svv.io.views.view_images import decode
from svv.io.views.viewset import CLASSIFIED, ViewSet, read_classified
from svv.job.stages import Stages
from tests.any_json import any_json

DEEP = "[" * 100_000
HUGE = 10**400


@pytest.mark.parametrize("text", [DEEP, '{"a":' * 100_000, str(HUGE), f"[-{HUGE}]", "{", "\ud800"])
def test_json_is_a_value_or_no_json(text: str) -> None:
    with pytest.raises(ValueError, match=r"."):
        parsed(text)


READERS: dict[str, Callable[[Path], object]] = {
    "tf.json": TransferFunction.read, "camera.json": read_camera, "a.series": read_series, "a.json": read_shot,
    "mask.json": lambda path: read_selection(path.with_suffix(".png")),
    "transforms_train.json": lambda path: ViewSet.read(path.parent),
}  # fmt: skip


@pytest.mark.parametrize("name", READERS)
@pytest.mark.parametrize("text", [DEEP, '{"time": %s, "frames": [{"w": %s}]}' % (HUGE, HUGE)])  # noqa: UP031
def test_deep_and_huge_json_is_a_sentence(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(BadInput):
        READERS[name](tmp_path / name)


@settings(max_examples=200)
@given(content=any_json)
def test_any_json_is_a_function_or_a_sentence(content: object) -> None:
    for told in (content, {"RGBPoints": content}, {**PRESET, "Points": content}, {"bumps": content},
                 {**PRESET, "ScalarOpacityUnitDistance": content}, {**PRESET, "ColorSpace": content}):  # fmt: skip
        try:
            TransferFunction.from_dict(told).to_dict()
        except BadInput:
            continue


@pytest.mark.parametrize(
    ("preset", "says"),
    [
        ({**PRESET, "ScalarOpacityUnitDistance": 10**30}, None),
        ({**PRESET, "ScalarOpacityUnitDistance": HUGE}, "finite"),
        ({**PRESET, "RGBPoints": [HUGE, 0, 0, 0]}, "finite"),
        ({**PRESET, "Points": [-1e308, 0, 0.5, 0, 1e308, 1, 0.5, 0]}, "must lie between"),
        ({**PRESET, "Points": [float("nan"), 0, 0.5, 0]}, "finite"),
        ({**PRESET, "Points": [1, 0, 0.5, 0, 0, 1, 0.5, 0]}, "ascending"),
        ({**PRESET, "Points": [0, 0, 0.5, 0] * 100_000}, "resample"),
        ({"bumps": [{"centre": 1e308, "width": 1e308, "opacity": 1}]}, "finite"),
        ({"bumps": [{"centre": 0, "width": 1, "opacity": HUGE}]}, "numbers"),
        ({"bumps": [{"centre": k, "width": 1, "opacity": 1} for k in range(9000)]}, "leave some out"),
    ],
)
def test_functions_of_bad_numbers(preset: dict[str, Any], says: str | None) -> None:
    if says is None:
        TransferFunction.from_dict(preset)
    else:
        with pytest.raises(BadInput, match=says):
            TransferFunction.from_dict(preset)


FRAME = {"fl_x": 9.0, "transform_matrix": pose(3.0)}


@pytest.mark.parametrize(
    "frame",
    [{"fl_x": HUGE}, {"camera_angle_x": 5e-324, "fl_x": 0}, {"w": 1e308, "h": 1e308}, {"w": 10**18, "k1": 1},
     {"transform_matrix": [[HUGE] * 4] * 4}, {"transform_matrix": [[1e200] * 4] * 4}, {"fl_x": 1e-320, "k1": 1e308}],
)  # fmt: skip
def test_intrinsics_of_any_size_are_a_sentence(tmp_path: Path, frame: dict[str, Any]) -> None:
    with pytest.raises(BadInput):
        camera_in(tmp_path / "transforms.json", {}, {**FRAME, **frame}, 8, 8)


@pytest.mark.parametrize("width", [0, 65_537, 10**18])
def test_a_camera_has_an_image_that_can_be(width: int) -> None:
    with pytest.raises(BadInput, match="pixels"):
        Camera(np.array(pose(3.0)), 0.5, width, 8)


def test_a_rig_of_huge_numbers_is_a_rig() -> None:
    CameraRig.from_json({"centre": [10**30, 0, 0], "radius": 1, "fov_x": 0.5})


OUTSIDE = ("/etc/passwd", "../a", "a/../../b", "C:\\a.png", "\\\\host\\a", "~/a.png", "..\\a")


@pytest.mark.parametrize("name", OUTSIDE)
def test_names_that_leave_a_set_are_a_sentence(tmp_path: Path, name: str) -> None:
    (tmp_path.parent / "a.png").write_bytes(b"")
    with pytest.raises(BadInput, match="outside"):
        file_in(tmp_path / "transforms.json", {"file_path": name})


@pytest.mark.parametrize(
    "name", ["x" * 5000, "a\0b", "\ud800", "loop", "folder.png", "zero.png", "http://127.0.0.1:1/a"]
)
def test_names_that_no_file_has_are_a_sentence(tmp_path: Path, name: str) -> None:
    with pytest.raises(BadInput, match="no such file"):
        file_in(prepared(tmp_path) / "transforms.json", {"file_path": name})


def test_an_image_whose_name_is_no_text_is_in_no_list(tmp_path: Path) -> None:
    told = {"frames": [{"file_path": []}] * 3, "camera_angle_x": 0.5, "test_filenames": ["a"]}
    (tmp_path / "transforms.json").write_text(json.dumps(told))
    with pytest.raises(BadInput, match="without file_path"):
        ViewSet.read(tmp_path)


@pytest.mark.parametrize("read", [read_style, read_mask, decode])
def test_a_picture_of_too_few_bytes_is_not_decoded(tmp_path: Path, read: Callable[[Path], object]) -> None:
    """Some decoders fill what is missing, at any size that a header says."""
    file = io.BytesIO()
    Image.new("L", (20, 20)).save(file, "PNG")
    content = bytearray(file.getvalue())
    content[20:24] = struct.pack(">I", 4_000_000)  # the height, in the header
    content[29:33] = struct.pack(">I", zlib.crc32(content[12:29]))
    (tmp_path / "a.tif").write_bytes(content)
    with pytest.raises(BadInput, match="20 x 4000000 pixels, but it has"):
        read(tmp_path / "a.tif")


@pytest.mark.parametrize("absolute", [True, False])
def test_a_foreign_set_cannot_have_other_files_removed(tmp_path: Path, absolute: bool) -> None:
    """Writing a set removes the images of the one before it, but not those that it only claims to have."""
    folder = prepared(tmp_path / "set")
    precious = tmp_path / "precious.png"
    precious.write_bytes(b"precious")
    name = str(precious.with_suffix("")) if absolute else "../precious"
    (folder / "out").symlink_to(tmp_path)
    for path in (name, "out/precious"):
        told = {**SETS[0], "frames": [{"file_path": path, "transform_matrix": pose(3.0)}]}
        (folder / "transforms_test.json").write_text(json.dumps(told))
        (folder / "transforms_train.json").write_text(json.dumps(SETS[0]))
        ViewSet.read(folder).write(folder, "test")
        assert precious.read_bytes() == b"precious"


def archive(**members: bytes) -> bytes:
    """A classified volume with some members replaced."""
    file, whole = io.BytesIO(), zipfile.ZipFile(io.BytesIO(npz()[1]))
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as opened:
        for name in whole.namelist():
            opened.writestr(name, members.get(name.removesuffix(".npy"), whole.read(name)))
    return file.getvalue()


def saved(array: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


@pytest.mark.parametrize(
    "content",
    [
        *(archive(exponent=b"\x93NUMPY\x01\x00" + len(h).to_bytes(2, "little") + h.encode() + PICKLE) for h in HEADERS),
        archive(low=saved(np.zeros(1 << 17))), archive(exponent=saved(np.array(3))), archive(cells=saved(np.zeros(3))),
        archive(ranges=saved(np.zeros((1, 2)))), archive(owner=b""), b"", b"PK", npz()[0][:-30],
        archive(codes=saved(np.array(["a"]))), archive(low=saved(np.array([np.nan] * 3))),
    ],
)  # fmt: skip
def test_damaged_classified_volumes_are_a_sentence(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "transforms_train.json").write_text(json.dumps(SETS[2]))
    (tmp_path / CLASSIFIED).write_bytes(content)
    with pytest.raises(BadInput, match="make the views again"):
        read_classified(tmp_path)


def test_an_archive_that_declares_more_than_memory_is_refused_before(tmp_path: Path) -> None:
    """The directory says 8 TB; no byte of it is allocated."""
    header = HEADERS[1].encode()
    content = bytearray(archive(exponent=b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header))
    with zipfile.ZipFile(io.BytesIO(content)) as opened:
        place = content.rindex(b"exponent.npy") - 46
        assert content[place : place + 4] == b"PK\x01\x02" and opened.getinfo("exponent.npy")
    content[place + 24 : place + 28] = (0xFFFFFFF0).to_bytes(4, "little")  # its size, in the directory
    (tmp_path / "transforms_train.json").write_text(json.dumps(SETS[2]))
    (tmp_path / CLASSIFIED).write_bytes(content)
    with pytest.raises(BadInput, match=r"larger than its file can hold|more than this computer"):
        read_classified(tmp_path)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.pvsm", LAUGHS), ("a.pvsm", STATE.replace('index="0"', 'index="x"')), ("a.pvsm", "<a>" * 1000),
        ("a.py", "v.CameraPosition = " + "[" * 5000), ("a.py", "-" * 100_000 + "1"), ("a.py", "a\0b"),
        ("a.py", "v.CameraPosition = [1, 2, 'x']"), ("a.py", "v.CameraPosition = 1" + "+1" * 50_000),
        ("a.py", SCRIPT.replace("1.0, 2.0, -3.0e0", f"{HUGE}, 0, 0")),
        ("a.py", SCRIPT.replace("= 30", "= []").replace("-3.0e0", "(1, 2)")),
        ("a.py", SCRIPT.replace("2.0", "1e999")), ("a.json", '{"focal_point": [0, 0, 0], "distance": -1}'),
    ],
)  # fmt: skip
def test_damaged_cameras_of_paraview_are_a_sentence(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(BadInput):
        read_shot(tmp_path / name)


def test_a_script_of_paraview_is_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.py").write_text(SCRIPT)
    assert read_shot(tmp_path / "a.py").view_angle == 30.0
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("pattern", ["{phi.__class__}", "{phi:>999999999}", "{phi!r}", "{0}", "../{phi}"])
def test_patterns_of_names_only_name_arguments(tmp_path: Path, pattern: str) -> None:
    told = {"name_pattern": "{phi}_{theta}_" + pattern, "arguments": {n: {"values": ["1"]} for n in ("phi", "theta")}}
    if pattern.startswith(".."):
        told["name_pattern"] = "../{phi}_{theta}_"
    (tmp_path / "info.json").write_text(json.dumps(told))
    with pytest.raises(BadInput, match=r"not among its arguments|not in its folder"):
        read_table(tmp_path)


def test_arguments_of_a_database_do_not_explode(tmp_path: Path) -> None:
    arguments = {name: {"values": [str(k) for k in range(100)]} for name in ("phi", "theta", *"abcdefgh")}
    (tmp_path / "info.json").write_text(json.dumps({"name_pattern": "{phi}_{theta}_", "arguments": arguments}))
    with pytest.raises(BadInput, match="more than"):
        read_table(tmp_path)


@pytest.mark.parametrize("name", ["../../a.png", "/a.png", "a\0.png"])
def test_a_table_names_no_file_outside(tmp_path: Path, name: str) -> None:
    (tmp_path / "data.csv").write_text(f"phi,theta,FILE\n0,0,{name}\n")
    with pytest.raises(BadInput, match="not in its folder"):
        read_table(tmp_path)


@pytest.mark.parametrize("record", [{"train": 5}, {"train": {"key": 3}}, {"train": {"key": "k"}}, [1], 7])
def test_damaged_records_of_stages_are_done_again(tmp_path: Path, record: object) -> None:
    (tmp_path / "stages.json").write_text(json.dumps(record))
    assert Stages(tmp_path).do("train", "Training", {"a": 1}, [], lambda progress: None)


def test_points_in_a_picture_without_pixels_are_a_sentence(tmp_path: Path) -> None:
    told = {"svv": "selection", "size": [0, 8], "positive": [], "negative": [], "segmenter": "a", "grown": False}
    (tmp_path / "m.json").write_text(json.dumps(told))
    with pytest.raises(BadInput, match="points of a mask"):
        read_selection(tmp_path / "m.png")


@pytest.mark.parametrize(
    ("name", "text", "read"),
    [
        ("a.mha", META.replace("LOCAL", "x" * 5000), open_bricks),
        ("a.mha", META.replace("2 2 2", "-1 -1 8"), open_bricks),
        ("a.mha", META.replace("1 1 1\n", "1e308 1e308 1e308\n"), open_bricks),
        ("a.vti", VTI.replace('Extent="0 1 0 1 0 1"', 'Extent="0 1"'), lambda path: open_vti(path, None)),
        ("a.vti", VTI.replace('Spacing="1 1 1"', 'Spacing="1e308 1e308 1e308"'), lambda path: open_vti(path, None)),
        ("a.vti", VTI.replace('offset="0"', 'offset="-99"'), lambda path: open_vti(path, None)),
        ("a.npy", "\x93NUMPY\x01\x00\x05\x00(((((", open_npy),
    ],
)  # fmt: skip
def test_damaged_headers_of_mapped_volumes_are_a_sentence(
    tmp_path: Path, name: str, text: str, read: Callable[[Path], object]
) -> None:
    (tmp_path / name).write_bytes((text + "abcdefgh").encode("latin-1"))
    with pytest.raises(BadInput):
        read(tmp_path / name)


def tiff(size: tuple[int, int], **tags: Any) -> bytes:
    file = io.BytesIO()
    Image.new("L", size).save(file, "TIFF", **tags)
    return file.getvalue()


@pytest.mark.parametrize("read", [read_style, read_mask, decode, picture_size])
@pytest.mark.parametrize("content", [b"", b"\x89PNG\r\n\x1a\n", tiff((20, 20))[:40], b"DDS " + bytes(400), b"GIF89a"])
def test_damaged_pictures_are_a_sentence(tmp_path: Path, content: bytes, read: Callable[[Path], object]) -> None:
    (tmp_path / "a.png").write_bytes(content)
    with pytest.raises(BadInput):
        read(tmp_path / "a.png")


def test_a_bomb_for_a_mask_is_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 100)
    Image.new("L", (20, 20), 255).save(tmp_path / "a.png")
    with pytest.raises(BadInput, match="damaged"):
        read_mask(tmp_path / "a.png")


# --- volumes, in a process of their own -----------------------------------------------------------------------------


def volume(path: Path) -> Path:
    path.write_bytes(VTI.encode("latin-1"))
    return path


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_a_crash_of_a_reader_is_a_sentence_and_the_next_volume_is_read(tmp_path: Path) -> None:
    from svv.dvr.read.reader_process import apart
    from svv.dvr.read.volumes import read_volume

    good = volume(tmp_path / "a.vti")
    assert read_volume(good).GetDimensions() == (2, 2, 2)
    process = apart._process
    assert process is not None
    os.kill(process.pid, signal.SIGSEGV)
    while process.poll() is None:
        time.sleep(0.01)
    with pytest.raises(BadInput, match=r"a\.vti: VTK's reader crashed on it \(SIGSEGV\)"):
        read_volume(good)
    assert read_volume(good).GetDimensions() == (2, 2, 2)


def test_what_is_read_apart_is_what_is_read_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from svv.dvr.read.grids import index_to_world, to_array
    from svv.dvr.read.volumes import read_here, read_volume

    volume(tmp_path / "a.vti")
    monkeypatch.chdir(tmp_path)
    there, here = read_volume("a.vti", spacing=(1, 2, 3)), read_here(Path("a.vti"), spacing=(1, 2, 3))
    assert np.array_equal(to_array(there), to_array(here)) and to_array(there).dtype == to_array(here).dtype
    assert np.array_equal(index_to_world(there), index_to_world(here))
    with pytest.raises(BadInput, match=r"^a\.vti has no array 'b'"):
        read_volume("a.vti", array="b")


def test_an_nrrd_header_without_its_fields_is_not_given_to_vtk(tmp_path: Path) -> None:
    from svv.dvr.read.volumes import read_volume

    for text in ("NRRD0004\ntype: short\ndimension: 3\ns\0izes: 5 4 3\nencoding: raw\n\n", "NRRD0004\ntype: short\n\n"):
        (tmp_path / "a.nrrd").write_bytes(text.encode() + bytes(120))
        with pytest.raises(BadInput, match="damaged"):
            read_volume(tmp_path / "a.nrrd")


def test_a_numpy_file_with_a_damaged_header_is_a_sentence(tmp_path: Path) -> None:
    from svv.dvr.read.volumes import read_volume

    (tmp_path / "a.npy").write_bytes(b"\x93NUMPY\x01\x00\x05\x00(((((")
    with pytest.raises(BadInput, match="damaged"):
        read_volume(tmp_path / "a.npy")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
def test_a_fork_reads_from_a_process_of_its_own(tmp_path: Path) -> None:
    """Two processes must not ask, and read from, the same one."""
    script = """
import os, sys, warnings
warnings.simplefilter("ignore")
from svv.dvr.read.volumes import read_volume
read_volume(sys.argv[1])
forked = os.fork()
sides = read_volume(sys.argv[1]).GetDimensions()
if not forked:
    os._exit(0 if sides == (2, 2, 2) else 1)
assert os.waitpid(forked, 0)[1] == 0 and sides == (2, 2, 2)
"""
    subprocess.run(
        [sys.executable, "-c", script, volume(tmp_path / "a.vti")],
        check=True,
        timeout=600,
        cwd=Path(__file__).resolve().parents[1],
    )
