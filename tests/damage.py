"""Damage that every reader of volumes meets in one sentence: files that are cut off, and headers that are wrong."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest

from svv.dvr.read.volumes import read_here
from svv.errors import BadInput


def assert_cut_files_are_refused(file: Path, places: int = 10, named: Path | None = None, **how: str) -> None:
    """Cut a file off at even distances: each time, reading ``named`` (by default, the file) ends in one sentence."""
    whole = file.read_bytes()
    for k in range(places):
        file.write_bytes(whole[: len(whole) * k // places])
        _assert_refused(named or file, f"cut off at {k} of {places}", **how)
    file.write_bytes(whole)


def assert_wrong_headers_are_refused(file: Path, wrong: Mapping[bytes, bytes], **how: str) -> None:
    """Put other bytes in place of those of a header: each time, reading ends in one sentence."""
    whole = file.read_bytes()
    for there, other in wrong.items():
        assert there in whole, there
        file.write_bytes(whole.replace(there, other, 1))
        _assert_refused(file, f"{other!r} for {there!r}", **how)
    file.write_bytes(whole)


def _assert_refused(file: Path, damage: str, **how: str) -> None:
    with pytest.raises(BadInput) as caught:
        read_here(file, array=how.get("array"))
        pytest.fail(f"{file.name} was read, {damage}")
    assert "\n" not in str(caught.value), damage
