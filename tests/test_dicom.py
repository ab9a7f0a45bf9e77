"""DICOM: slices and frames are placed by what they say, and what is no volume is refused."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("vtkmodules")
tifffile = pytest.importorskip("tifffile")
for package in ("h5py", "nibabel", "nrrd", "pydicom", "SimpleITK", "zarr"):
    pytest.importorskip(package)

from pydicom.dataset import Dataset  # noqa: E402
from pydicom.sequence import Sequence  # noqa: E402
from pydicom.uid import RLELossless  # noqa: E402

from svv.bricks.opened import open_bricks  # noqa: E402
from svv.dvr.read.grids import assumed_of, to_array  # noqa: E402
from svv.dvr.read.volumes import read_here  # noqa: E402
from svv.errors import BadInput  # noqa: E402
from tests.reference_files import dicom_slice  # noqa: E402

V = (np.arange(40 * 32 * 24) % 200).reshape(40, 32, 24).astype(np.int16)

SMALL = V[:4, :5, :6]


def scan(folder: Path, places: list[Any], change: Callable[[int, Any], None] = lambda k, data: None) -> Path:
    folder.mkdir(exist_ok=True)
    for k, place in enumerate(places):
        data = dicom_slice(SMALL[k % 4], place)
        data.InstanceNumber = k
        change(k, data)
        data.save_as(folder / f"IM{k}", enforce_file_format=True)
    return folder


def test_slices_are_in_the_order_of_their_places(tmp_path: Path) -> None:
    folder = scan(tmp_path / "scan", [(0, 0, 3 * k) for k in (0, 1, 2, 3)][::-1])
    (folder / "DICOMDIR").write_bytes(b"an index")
    volume = read_here(folder)
    np.testing.assert_array_equal(to_array(volume), SMALL[::-1])
    assert volume.GetSpacing() == (1.0, 1.0, 3.0)
    assert open_bricks(folder) is None


def test_slices_packed_by_run_lengths(tmp_path: Path) -> None:
    folder = scan(tmp_path / "scan", [(0, 0, k) for k in range(4)], lambda k, data: data.compress(RLELossless))
    np.testing.assert_array_equal(to_array(read_here(folder)), SMALL)


def test_the_frames_of_one_file_are_a_volume(tmp_path: Path) -> None:
    data = dicom_slice(SMALL, (1, 2, 3))
    data.NumberOfFrames, data.SpacingBetweenSlices = 4, "2.5"
    data.save_as(tmp_path / "frames", enforce_file_format=True)
    volume = read_here(tmp_path / "frames")
    np.testing.assert_array_equal(to_array(volume), SMALL)
    assert volume.GetSpacing() == (1.0, 1.0, 2.5) and volume.GetOrigin() == (1.0, 2.0, 3.0)


def test_every_frame_may_tell_its_own_place(tmp_path: Path) -> None:
    """Enhanced objects keep positions in groups for each frame, in any order."""

    def of(**values: Any) -> Any:
        item = Dataset()
        for name, value in values.items():
            setattr(item, name, value)
        return Sequence([item])

    order, data = [2, 0, 3, 1], dicom_slice(SMALL, (0, 0, 0))
    del data.ImagePositionPatient, data.ImageOrientationPatient, data.PixelSpacing
    data.NumberOfFrames, data.PixelData = 4, SMALL[order].astype("<i2").tobytes()
    places = [of(PlanePositionSequence=of(ImagePositionPatient=[1, 2, 3 + 2 * k]))[0] for k in order]
    data.PerFrameFunctionalGroupsSequence = Sequence(places)
    turn, size = of(ImageOrientationPatient=[1, 0, 0, 0, 1, 0]), of(PixelSpacing=[0.25, 0.5], SliceThickness=2)
    data.SharedFunctionalGroupsSequence = of(PlaneOrientationSequence=turn, PixelMeasuresSequence=size)
    data.save_as(tmp_path / "frames", enforce_file_format=True)
    volume = read_here(tmp_path / "frames")
    np.testing.assert_array_equal(to_array(volume), SMALL)
    assert volume.GetSpacing() == (0.5, 0.25, 2.0) and volume.GetOrigin() == (1.0, 2.0, 3.0)


def test_slices_at_the_same_places_are_time_points(tmp_path: Path) -> None:
    folder = scan(tmp_path / "scan", [(0, 0, k % 2) for k in range(4)])
    with pytest.raises(BadInput, match=r"^scan has 2 time points \(0 to 1\): choose one with --time\.$"):
        read_here(folder)
    np.testing.assert_array_equal(to_array(read_here(folder, time=1)), SMALL[2:])


def test_two_series_in_a_folder_are_listed(tmp_path: Path) -> None:
    def series(k: int, data: Any) -> None:
        data.SeriesInstanceUID, data.SeriesDescription = f"1.2.{k // 2}", ("thorax", "scout")[k // 2]

    folder = scan(tmp_path / "scan", [(0, 0, k % 2) for k in range(4)], series)
    with pytest.raises(
        BadInput, match=r"2 series \(0 thorax \(2 files\), 1 scout \(2 files\)\): choose one with --array"
    ):
        read_here(folder)
    for name in ("1", "scout", "1.2.1"):
        np.testing.assert_array_equal(to_array(read_here(folder, array=name)), SMALL[2:])


def test_slices_that_are_nearly_even_are_taken_as_even_and_that_is_said(tmp_path: Path) -> None:
    places = [(0, 0, 7.0 * z + 0.05 * (z % 3)) for z in range(7)]
    image = read_here(scan(tmp_path / "scan", places))
    assert "slices 6.9 to 7.05 mm apart are taken as even" in str(assumed_of(image))
    assert image.GetSpacing()[2] == pytest.approx(7.0, rel=0.01)
    image = read_here(scan(tmp_path / "other", [(0, 0, 7.0 * z + 0.02 * (z % 2)) for z in range(7)]))
    assert "even" not in str(assumed_of(image))
    with pytest.raises(BadInput, match="resample the volume to even ones"):
        read_here(scan(tmp_path / "third", [(0, 0, 7.0 * z + 0.8 * (z % 3)) for z in range(7)]))


def wide(k: int, data: Any) -> None:
    if k == 2:
        data.PixelSpacing = ["2", "2"]


BAD_SCANS: dict[str, tuple[list[Any], Callable[[int, Any], None], str]] = {
    "a slice is missing": (
        [(0, 0, z) for z in (0, 1, 3, 4)],
        lambda k, data: None,
        "uneven distances .1 to 2 mm.: 1 slice is missing, 1 between IM1 and IM2. Add what is missing",
    ),
    "slices are missing": (
        [(0, 0, 2.5 * z) for z in (0, 1, 3, 4, 5, 8, 9)],
        lambda k, data: None,
        "3 slices are missing, 1 between IM1 and IM2, 2 between IM4 and IM5",
    ),
    "uneven places": (
        [(0, 0, z) for z in (0, 1, 2.4, 3, 4.7)],
        lambda k, data: None,
        "resample the volume to even ones",
    ),
    "a tilted gantry": (
        [(0, k, k) for k in range(4)],
        lambda k, data: None,
        r"gantry .45.0 degrees.*not perp.*dcm2niix",
    ),
    "one slice": ([(0, 0, 0)], lambda k, data: None, "is a single slice: name the folder"),
    "other pixels": ([(0, 0, k) for k in range(4)], wide, "differs in size or direction"),
    "one place": ([(0, 0, 0)] * 4, lambda k, data: None, "at the same place"),
    "a place twice": ([(0, 0, z) for z in (0, 1, 2, 2)], lambda k, data: None, "places with several slices"),
    "colours": ([(0, 0, k) for k in range(4)], lambda k, data: setattr(data, "SamplesPerPixel", 3), "in colours"),
}


@pytest.mark.parametrize("case", BAD_SCANS)
def test_scans_that_are_no_volume_are_refused(tmp_path: Path, case: str) -> None:
    places, change, words = BAD_SCANS[case]
    with pytest.raises(BadInput, match=words):
        read_here(scan(tmp_path / "scan", places, change))


def test_the_package_that_dicom_needs_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = scan(tmp_path / "scan", [(0, 0, k) for k in range(4)])
    monkeypatch.setitem(sys.modules, "pydicom", None)
    with pytest.raises(BadInput, match=r"needs the package pydicom: pip install 'svv\[standalone\]'\.$"):
        read_here(folder)


def test_slices_without_sizes_are_said(tmp_path: Path) -> None:
    def without(keys: str) -> Callable[[int, Any], None]:
        def change(_: int, data: Any) -> None:
            for key in keys.split():
                if key in data:
                    delattr(data, key)

        return change

    places = [(0, 0, 3 * k) for k in range(4)]
    assert assumed_of(read_here(scan(tmp_path / "all", places))) is None
    volume = read_here(scan(tmp_path / "pixels", places, without("PixelSpacing")))
    assert "pixels: no voxel size found along x, y: 1 x 1 (--spacing" in str(assumed_of(volume))
    bare = without("PixelSpacing ImagePositionPatient SpacingBetweenSlices SliceThickness")
    volume = read_here(scan(tmp_path / "bare", places, bare))
    assert "bare: no voxel size found: 1 x 1 x 1 (--spacing" in str(assumed_of(volume))
