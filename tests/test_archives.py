"""Archives: arrays in NumPy's ``.npz``, and Zarr in zip files, whose root is the store or its only folder."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from svv.bricks.opened import open_bricks
from svv.dvr.read.volumes import read_here
from svv.errors import BadInput
from tests.damage import assert_cut_files_are_refused
from tests.ell_volume import FIRST, STEP, assert_shown, ell

zarr = pytest.importorskip("zarr")

UNIT, ORIGIN = (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)

FORMATS = (2, 3) if zarr.__version__ >= "3" else (2,)


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_arrays_of_numpy(tmp_path: Path, save: Any) -> None:
    file = tmp_path / "a.npz"
    save(file, density=ell("u2"), times=np.zeros(3))
    assert_shown(file, UNIT, ORIGIN, says="no voxel size")
    assert open_bricks(file) is None
    save(file, density=ell("u2"), other=2 * ell("u2"))
    with pytest.raises(BadInput, match=r"several volumes; its arrays: density \(14, 18, 22\), other .*--array"):
        read_here(file)
    assert_shown(file, UNIT, ORIGIN, says="no voxel size", array="other", factor=2.0)
    with pytest.raises(BadInput, match="no volume 'none'"):
        read_here(file, array="none")


def test_damaged_archives_of_numpy_are_one_sentence(tmp_path: Path) -> None:
    file = tmp_path / "a.npz"
    np.savez(file, density=ell())
    assert_cut_files_are_refused(file)
    for array in (np.array([{}]), np.zeros((2, 2))):
        np.savez(file, density=array)
        with pytest.raises(BadInput, match=r"no arrays of numbers|no array with three axes"):
            read_here(file)


def store(folder: Path, version: int, as_image: bool) -> Path:
    """Write an L as OME-Zarr or as a plain array."""
    options = {"zarr_format": version} if zarr.__version__ >= "3" else {}
    if not as_image:
        array = zarr.open(str(folder), mode="w", shape=(14, 18, 22), chunks=(8, 8, 8), dtype="u2", **options)
        array[...] = ell("u2")
        return folder
    group = zarr.open_group(str(folder), mode="w", **options)
    array = zarr.open(str(folder / "0"), mode="w", shape=(14, 18, 22), chunks=(8, 8, 8), dtype="u2", **options)
    array[...] = ell("u2")
    steps = [
        {"type": "scale", "scale": STEP[::-1].tolist()},
        {"type": "translation", "translation": FIRST[::-1].tolist()},
    ]
    axes = [{"name": name, "type": "space", "unit": "micrometer"} for name in "zyx"]
    told = [{"axes": axes, "datasets": [{"path": "0", "coordinateTransformations": steps}], "version": "0.4"}]
    group.attrs.update({"multiscales": told} if version == 2 else {"ome": {"version": "0.5", "multiscales": told}})
    return folder


@pytest.mark.parametrize("version", FORMATS)
@pytest.mark.parametrize("in_folder", [False, True])
@pytest.mark.parametrize("ending", [".zarr", ".ome.zarr"])
def test_zarr_in_a_zip_file(tmp_path: Path, version: int, in_folder: bool, ending: str) -> None:
    for as_image, where, says in ((True, (STEP, FIRST), None), (False, (UNIT, ORIGIN), "no voxel size")):
        folder = store(tmp_path / f"a{as_image}{ending}", version, as_image)
        root, base = (tmp_path, folder.name) if in_folder else (folder, ".")
        file = Path(shutil.make_archive(str(folder), "zip", root, base))
        step, first = where
        assert_shown(file, step, first, says=says)
        assert open_bricks(file) is not None
        if as_image:
            assert_shown(file, step, first, array="0")


def test_damaged_zip_files_are_one_sentence(tmp_path: Path) -> None:
    folder = store(tmp_path / "a.zarr", FORMATS[-1], True)
    file = Path(shutil.make_archive(str(folder), "zip", folder))
    assert_cut_files_are_refused(file)
    shutil.rmtree(folder / "0")
    with pytest.raises(BadInput, match=r"do not follow OME-NGFF|0"):
        read_here(Path(shutil.make_archive(str(folder), "zip", folder)))
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "a.txt").write_text("a")
    with pytest.raises(BadInput, match="holds no Zarr array"):
        read_here(Path(shutil.make_archive(str(tmp_path / "other"), "zip", tmp_path / "other")))
