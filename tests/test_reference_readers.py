"""Volumes as the libraries read them that their formats' users trust: equal values, equal places of the corners."""

from __future__ import annotations

import itertools
import os
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("vtkmodules")
for package in ("h5py", "nibabel", "nrrd", "pydicom", "SimpleITK", "zarr"):
    pytest.importorskip(package)

from svv.bricks.formats.axes import Choice  # noqa: E402
from svv.bricks.formats.mapped import MappedSource  # noqa: E402
from svv.bricks.opened import open_bricks  # noqa: E402
from svv.dvr.read.grids import index_to_world, to_array  # noqa: E402
from svv.dvr.read.volumes import read_here  # noqa: E402
from svv.errors import BadInput  # noqa: E402
from tests.reference_files import MAKERS, Case  # noqa: E402

VARIANTS = int(os.environ.get("SVV_VARIANTS", "20"))


def assert_same(case: Case, values: np.ndarray, matrix: np.ndarray) -> None:
    assert values.shape == case.values.shape
    if case.exact:
        np.testing.assert_array_equal(values, case.values)
    else:
        np.testing.assert_allclose(values, case.values, rtol=2e-7, atol=2e-7 * np.abs(case.values).max())
    last = np.array(values.shape[::-1]) - 1
    corners = np.array([[*(np.array(corner) * last), 1] for corner in itertools.product((0, 1), repeat=3)])
    places, there = corners @ matrix[:3].T, corners @ case.matrix[:3].T
    diagonal = np.linalg.norm(np.ptp(there, axis=0))
    assert np.abs(places - there).max() < 1e-6 * diagonal


@pytest.mark.parametrize("seed", range(VARIANTS))
@pytest.mark.parametrize("form", MAKERS)
def test_values_and_corners_are_those_of_the_reference(form: str, seed: int, tmp_path: Path) -> None:
    case = MAKERS[form](np.random.default_rng(seed), tmp_path)
    image = read_here(case.path, **{k: str(v) if k == "channel" else v for k, v in case.options.items()})
    assert_same(case, to_array(image), index_to_world(image))
    channel = case.options.get("channel")
    choice = Choice(None if channel is None else str(channel), case.options.get("time"))
    source = open_bricks(case.path, choice=choice)
    if source is not None:
        level, matrix = source.levels[0], np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = level.axes, level.origin
        assert_same(case, source.read(0, (0, 0, 0), level.shape), matrix)


@pytest.mark.parametrize("form", MAKERS)
def test_damaged_files_are_a_sentence(form: str, tmp_path: Path) -> None:
    """Bytes are changed, added, or cut off, mostly in headers."""
    said: list[str] = []
    for seed in range(VARIANTS):
        rng, folder = np.random.default_rng(seed), tmp_path / str(seed)
        folder.mkdir()
        case = MAKERS[form](rng, folder)
        files = sorted(file for file in folder.rglob("*") if file.is_file())
        file = files[int(rng.integers(len(files)))]
        content = bytearray(file.read_bytes())
        place = int(rng.integers(min(len(content), 600)))
        if seed % 3 == 0:
            del content[place:]
        elif seed % 3 == 1:
            content[place:place] = rng.integers(32, 127, 5).astype(np.uint8).tobytes()
        else:
            content[place] ^= int(rng.integers(1, 256))
        file.write_bytes(content)
        try:
            read_here(case.path, **{k: str(v) if k == "channel" else v for k, v in case.options.items()})
        except BadInput as error:
            said.append(str(error))
    assert said and not any("\n" in text for text in said)


def test_what_our_readers_do_and_the_libraries_do_not(tmp_path: Path) -> None:
    """Why NIfTI and NRRD have readers of our own: a place of NaN is a sentence, and raw values stay in their file."""
    import nibabel
    import nrrd

    values = np.arange(24, dtype=np.int16).reshape(2, 3, 4)
    nibabel.save(nibabel.Nifti1Image(values, np.eye(4)), tmp_path / "a.nii")
    content = bytearray((tmp_path / "a.nii").read_bytes())
    content[280:284] = np.float32(np.nan).tobytes()
    (tmp_path / "a.nii").write_bytes(content)
    assert np.isnan(nibabel.load(tmp_path / "a.nii").affine).any()
    with pytest.raises(BadInput, match="must be positive"):
        open_bricks(tmp_path / "a.nii")

    nrrd.write(str(tmp_path / "a.nrrd"), values, {"encoding": "raw"})
    read = nrrd.read(str(tmp_path / "a.nrrd"))[0]
    assert not isinstance(read, np.memmap) and not isinstance(read.base, np.memmap)
    assert isinstance(open_bricks(tmp_path / "a.nrrd"), MappedSource)
