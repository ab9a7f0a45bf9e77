"""Keys of kept results: different content has a different key, and the same content the same key in any place."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from svv.errors import BadInput
from svv.io.files.keyed_results import digest, digest_of_file, key_of, make_keyed_folder, read_record, write_record
from svv_bench.keys import code

PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**53), 2**53) | st.floats(-1e300, 1e300) | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=8,
)


@given(PLAIN, PLAIN)
def test_values_have_the_same_hash_if_they_are_the_same(a: object, b: object) -> None:
    assert digest(a) == digest(a)
    assert (digest(a) == digest(b)) == (repr(_sorted(a)) == repr(_sorted(b)))


def _sorted(value: object) -> object:
    if isinstance(value, dict):
        return {"": sorted((k, repr(_sorted(v))) for k, v in value.items())}
    return [_sorted(v) for v in value] if isinstance(value, list) else value


@given(arrays(np.float32, (3, 4), elements=st.floats(0, 1, width=32)))
def test_an_array_counts_as_it_lies(picture: np.ndarray) -> None:
    """Its mirror image has the same sum, and is another picture."""
    assert digest(picture) == digest(picture.copy(order="F"))
    for other in (picture[:, ::-1], picture[::-1], picture.reshape(4, 3), picture.astype(np.float64)):
        same = other.shape == picture.shape and other.dtype == picture.dtype and other.tobytes() == picture.tobytes()
        assert (digest(other) == digest(picture)) == same


def test_kinds_of_content_do_not_pass_for_each_other(tmp_path: Path) -> None:
    file = tmp_path / "a"
    file.write_bytes(b"abc")
    kinds = (b"abc", "abc", file, str(file), np.frombuffer(b"abc", np.uint8), {"bytes": "abc"}, ["abc"])
    assert len({digest(kind) for kind in kinds}) == len(kinds)


def test_a_file_counts_by_its_content(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"one")
    (tmp_path / "b").write_bytes(b"one")
    assert digest(tmp_path / "a") == digest(tmp_path / "b")
    assert digest_of_file(tmp_path / "a") == digest_of_file(str(tmp_path / "b"))
    before, both = digest(tmp_path / "a"), digest(tmp_path)
    (tmp_path / "a").write_bytes(b"two!")
    assert digest(tmp_path / "a") != before and digest(tmp_path) != both
    with pytest.raises(BadInput, match="Cannot read"):
        digest(tmp_path / "none")


def test_keys_are_the_same_in_every_process() -> None:
    script = "from svv_bench.keys import code, key_of; print(key_of({'b': 1, 'a': [0.1]}), code())"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.split() == [key_of({"a": [0.1], "b": 1}), code()]


def test_a_key_depends_on_the_version(monkeypatch: pytest.MonkeyPatch) -> None:
    before = key_of("a")
    monkeypatch.setattr("svv.io.files.keyed_results.__version__", "9.9.9")
    assert key_of("a") != before


def test_a_record_is_read_under_its_own_key_alone(tmp_path: Path) -> None:
    file = tmp_path / "run.json"
    assert read_record(file, "k") is None
    write_record(file, "k", {"seconds": 1.5})
    assert read_record(file, "k") == {"seconds": 1.5, "key": "k"}
    assert read_record(file, "other") is None
    file.write_text(file.read_text()[:-5])
    assert read_record(file, "k") is None


def test_a_folder_holds_what_is_of_its_key(tmp_path: Path) -> None:
    folder = make_keyed_folder(tmp_path / "made", "one")
    (folder / "result").touch()
    assert (make_keyed_folder(folder, "one") / "result").exists()
    assert not (make_keyed_folder(folder, "two") / "result").exists()
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").touch()
    with pytest.raises(BadInput, match="contains other files"):
        make_keyed_folder(tmp_path / "mine", "one")
    assert (tmp_path / "mine" / "thesis.tex").exists()
