"""Atomic files and the scene container: round trips, and every way a file can be bad."""

from __future__ import annotations

import json
import resource
import signal
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from safetensors.numpy import save, save_file

from svv.core.colour.light import Lamp
from svv.core.geometry.cuts import Cut
from svv.errors import BadInput, Cancelled
from svv.fields.radiance.networks import FieldSettings
from svv.fields.radiance.rendering import Marching
from svv.fields.scene.region import Region
from svv.fields.scene.scene_validation import _KINDS
from svv.io import scene_file
from svv.io.files.atomic import atomic_path, check_writable, make_folder, to_json, write_json
from svv.io.scene_file import read_scene_file, write_scene_file

DTYPES = st.sampled_from([np.float16, np.float32, np.float64, np.uint8, np.int16, np.int32, np.int64, np.bool_])
ARRAYS = DTYPES.flatmap(lambda dtype: hnp.arrays(dtype, hnp.array_shapes(min_dims=0, min_side=0, max_side=5)))


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "scene.svv"
    write_scene_file(path, {"bounds": [0, 1]}, {"table": np.arange(1000, dtype=np.float32)})
    return path


def only_file(path: Path) -> bool:
    return sorted(path.parent.iterdir()) == [path]


@settings(deadline=None, max_examples=50)
@given(tensors=st.dictionaries(st.text(st.characters(codec="ascii", categories=["L", "N"]), min_size=1), ARRAYS))
def test_every_array_comes_back_as_it_was(
    tmp_path_factory: pytest.TempPathFactory, tensors: dict[str, np.ndarray]
) -> None:
    path = tmp_path_factory.mktemp("scene") / "scene.svv"
    write_scene_file(path, {"names": list(tensors)}, tensors)
    header, back = read_scene_file(path)
    assert header == {"names": list(tensors)}
    assert set(back) == set(tensors)
    for name, array in tensors.items():
        assert back[name].dtype == array.dtype and back[name].shape == array.shape
        np.testing.assert_array_equal(back[name], array)


@settings(deadline=None, max_examples=50)
@given(tensors=st.dictionaries(st.text(st.characters(exclude_categories=["Cs"]), min_size=1), ARRAYS))
def test_files_are_those_of_the_safetensors_package(tensors: dict[str, np.ndarray]) -> None:
    assume("__metadata__" not in tensors)
    metadata = {"svv": to_json({"version": scene_file.FORMAT_VERSION, "header": {"é": 1}, "deflated": {}})}
    arrays = {name: np.asarray(array, order="C") for name, array in tensors.items()}
    assert scene_file.scene_bytes({"é": 1}, tensors) == save(arrays, metadata=metadata)


def test_writing_takes_no_memory(tmp_path: Path) -> None:
    tensors = {f"moments.{k}": np.ones((1 << 20, 2), np.float32) for k in range(4)}
    write_scene_file(tmp_path / "a.svv", {}, {})  # what is imported then does not count
    tracemalloc.start()
    write_scene_file(tmp_path / "b.svv", {}, tensors)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 1 << 20 < (tmp_path / "b.svv").stat().st_size


def test_tables_of_bytes_are_smaller_in_files(tmp_path: Path) -> None:
    table = (100 * np.sin(np.arange(4000) / 50.0)[:, None] + [[100, 150]]).astype(np.uint8)
    write_scene_file(tmp_path / "s.svv", {}, {"t": table})
    assert (tmp_path / "s.svv").stat().st_size < 0.7 * table.nbytes
    np.testing.assert_array_equal(read_scene_file(tmp_path / "s.svv")[1]["t"], table)


@pytest.mark.parametrize("shape", [[4000, 1], [4001, 2], [3999, 2], [-1, 2], [0, 2], [4000], "ab", None, [1e9, 2]])
def test_deflated_tables_of_another_shape_are_damaged(tmp_path: Path, shape: object) -> None:
    table = np.random.default_rng(0).integers(0, 255, (4000, 2)).astype(np.uint8)
    content = scene_file.scene_bytes({}, {"t": table}, deflate=True)
    start = 8 + int.from_bytes(content[:8], "little")
    meta = json.loads(json.loads(content[8:start])["__metadata__"]["svv"])
    meta["deflated"]["t"] = shape
    save_file({"t": np.frombuffer(content[start:], np.uint8)}, tmp_path / "s.svv", {"svv": json.dumps(meta)})
    with pytest.raises(BadInput, match="damaged"):
        read_scene_file(tmp_path / "s.svv")


def test_arrays_that_are_not_contiguous_keep_their_values(tmp_path: Path) -> None:
    array = np.arange(24).reshape(2, 3, 4)
    tensors = {"turned": array.T, "skipped": array[:, ::2], "backwards": array[..., ::-1]}
    write_scene_file(tmp_path / "s.svv", {}, tensors)
    back = read_scene_file(tmp_path / "s.svv")[1]
    for name, value in tensors.items():
        np.testing.assert_array_equal(back[name], value)


def test_header_holds_numpy_numbers_and_nan_as_null(tmp_path: Path) -> None:
    header = {
        "n": np.int64(3),
        "x": np.float32(0.5),
        "a": np.eye(2),
        "nan": float("nan"),
        "path": Path("a/b"),
        "u": 'é\n"',
    }
    write_scene_file(tmp_path / "s.svv", header, {"t": np.zeros(1)})
    assert read_scene_file(tmp_path / "s.svv")[0] == {
        "n": 3,
        "x": 0.5,
        "a": [[1.0, 0.0], [0.0, 1.0]],
        "nan": None,
        "path": "a/b",
        "u": 'é\n"',
    }


@pytest.mark.parametrize("kind", [Cut, FieldSettings, Lamp, Marching, Region])
def test_every_field_in_a_header_is_read_by_its_annotation(kind: type) -> None:
    """One that nothing reads would make good files damaged ones."""
    plain = {name: str(annotation).partition(" | ")[0] for name, annotation in kind.__annotations__.items()}
    assert not {name: annotation for name, annotation in plain.items() if annotation not in _KINDS}


@settings(deadline=None, max_examples=40)
@given(keep=st.floats(0, 1, exclude_max=True))
def test_a_truncated_scene_is_one_sentence(tmp_path_factory: pytest.TempPathFactory, keep: float) -> None:
    path = tmp_path_factory.mktemp("scene") / "scene.svv"
    write_scene_file(path, {"a": 1}, {"table": np.arange(100, dtype=np.float32)})
    content = path.read_bytes()
    path.write_bytes(content[: int(keep * len(content))])
    with pytest.raises(BadInput, match=r"scene\.svv .*(truncated|not a scene file)"):
        read_scene_file(path)


@settings(deadline=None, max_examples=100)
@given(data=st.data())
def test_a_damaged_header_never_raises_anything_but_bad_input(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    path = tmp_path_factory.mktemp("scene") / "scene.svv"
    write_scene_file(path, {"a": 1}, {"table": np.arange(4, dtype=np.float32)})
    content = bytearray(path.read_bytes())
    where = data.draw(st.integers(0, len(content) - 17))
    content[where] ^= data.draw(st.integers(1, 255))
    path.write_bytes(content)
    try:
        read_scene_file(path)
    except BadInput:
        pass


def test_foreign_files_are_named_as_such(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("hello")
    (tmp_path / "empty.svv").write_bytes(b"")
    save_file({"w": np.zeros(3)}, tmp_path / "b.safetensors")
    for name in ("a.txt", "empty.svv", "b.safetensors"):
        with pytest.raises(BadInput, match="not a scene file of svv"):
            read_scene_file(tmp_path / name)
    with pytest.raises(BadInput, match="There is no scene file"):
        read_scene_file(tmp_path / "missing.svv")
    with pytest.raises(BadInput, match="is a folder"):
        read_scene_file(tmp_path)


def test_another_version_says_which(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scene_file, "FORMAT_VERSION", 7)
    with pytest.raises(BadInput, match="format 3, but this program reads format 7"):
        read_scene_file(scene)


def test_a_missing_folder_and_a_file_as_folder_are_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="folder does not exist"):
        write_scene_file(tmp_path / "none" / "s.svv", {}, {})
    (tmp_path / "file").write_text("x")
    with pytest.raises(BadInput, match="is a file, not a folder"):
        write_scene_file(tmp_path / "file" / "s.svv", {}, {})
    with pytest.raises(BadInput, match="it is a folder"):
        write_scene_file(tmp_path, {}, {})
    with pytest.raises(BadInput, match="is a file, not a folder"):
        make_folder(tmp_path / "file")
    assert only_file(tmp_path / "file")


def test_a_write_that_the_system_stops_leaves_the_old_scene(scene: Path) -> None:
    before = scene.read_bytes()
    old_limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    old_handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # the write fails, we live
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, old_limit[1]))
        with pytest.raises(BadInput, match=r"Cannot write .*scene\.svv: .*exceeds the system's limit"):
            write_scene_file(scene, {}, {"table": np.zeros(10_000)})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, old_limit)
        signal.signal(signal.SIGXFSZ, old_handler)
    assert scene.read_bytes() == before
    assert only_file(scene)


def test_a_full_disk_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"Cannot write .*out\.bin: the disk is full"):
        with atomic_path(tmp_path / "out.bin") as temporary:
            temporary.unlink()
            temporary.symlink_to("/dev/full")  # the system's own ENOSPC, without filling a disk
            temporary.write_bytes(b"x")
    assert list(tmp_path.iterdir()) == []


def test_cancelling_leaves_the_old_file_and_nothing_else(scene: Path) -> None:
    before = scene.read_bytes()
    with pytest.raises(Cancelled):
        with atomic_path(scene) as temporary:
            temporary.write_bytes(b"half")
            raise Cancelled
    assert scene.read_bytes() == before
    assert only_file(scene)


def test_an_error_about_another_file_is_not_blamed_on_this_one(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        with atomic_path(tmp_path / "out.txt"):
            (tmp_path / "input").read_text()


def test_written_files_have_the_usual_permissions(tmp_path: Path) -> None:
    (tmp_path / "plain").write_text("")
    write_json(tmp_path / "a.json", {})
    assert (tmp_path / "a.json").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_json_is_strict(tmp_path: Path) -> None:
    write_json(tmp_path / "a.json", {"psnr": float("inf"), "lpips": None, "n": np.int32(2), "xs": (1, np.float64(2))})
    text = (tmp_path / "a.json").read_text()
    assert json.loads(text, parse_constant=pytest.fail) == {
        "psnr": None,
        "lpips": None,
        "n": 2,
        "xs": [1, 2.0],
    }


def test_whether_a_place_can_be_written_is_known_beforehand(scene: Path) -> None:
    before = scene.read_bytes()
    check_writable(scene)
    assert scene.read_bytes() == before
    assert only_file(scene)
    with pytest.raises(BadInput, match="is a file, not a folder"):
        check_writable(scene / "a.json")
