"""MINC files of both versions: values by their slices' ranges, and places, as nibabel has them."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("vtkmodules")
nibabel = pytest.importorskip("nibabel")
h5py = pytest.importorskip("h5py")
sitk = pytest.importorskip("SimpleITK")

from vtkmodules.vtkIOMINC import vtkMINCImageWriter  # noqa: E402

from svv.bricks.opened import open_bricks  # noqa: E402
from svv.dvr.read.grids import from_array, index_to_world, to_array  # noqa: E402
from svv.dvr.read.volumes import read_here, read_volume  # noqa: E402
from svv.errors import BadInput  # noqa: E402
from tests.letter import ORIGIN, SPACING, letter  # noqa: E402

TURN = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
"""Direction cosines of x, y, z, one column each."""


def minc2(path: Path, stored: np.ndarray, names: str, top: np.ndarray, **more: Any) -> Path:
    """Write a file in libminc's layout.

    Args:
        path: The file.
        stored: Values from 0 to 65535, an axis for each of ``names``.
        names: t (time), x, y, z.
        top: What 65535 means in each slice.
        more: Attributes that every axis in space has.
    """
    with h5py.File(path, "w") as file:
        for name, side in zip(names, stored.shape):
            whole = {"t": "time"}.get(name, f"{name}space")
            axis = file.create_dataset(f"minc-2.0/dimensions/{whole}", data=np.int32(0))
            axis.attrs.update(length=np.uint32(side), spacing=np.bytes_("regular__"))
            if name in "xyz":
                k = "xyz".index(name)
                told = {"step": SPACING[k], "start": ORIGIN[k], "direction_cosines": TURN[:, k], **more}
                axis.attrs.update(**told)
        order = ",".join({"t": "time"}.get(name, f"{name}space") for name in names)
        image = file.create_dataset("minc-2.0/image/0/image", data=stored)
        image.attrs.update(dimorder=np.bytes_(order), valid_range=np.array([0.0, 65535.0]))
        for key, values in (("image-min", np.zeros_like(top)), ("image-max", top)):
            file[f"minc-2.0/image/0/{key}"] = values
            file[f"minc-2.0/image/0/{key}"].attrs["dimorder"] = np.bytes_(",".join(order.split(",")[: top.ndim]))
    return path


def assert_placed(volume: Any, values: np.ndarray) -> None:
    np.testing.assert_allclose(to_array(volume), values, rtol=1e-6)
    np.testing.assert_allclose(index_to_world(volume)[:3, :3], TURN * SPACING, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(index_to_world(volume)[:3, 3], TURN @ ORIGIN, rtol=1e-12)


STORED = letter().astype(np.uint16) * 300
TOP = np.linspace(1.0, 2.0, 14)
VALUES = STORED * (TOP[:, None, None] / 65535.0)


@pytest.mark.parametrize("read", [read_here, read_volume])
def test_the_ranges_of_slices_scale_values(read: Any, tmp_path: Path) -> None:
    path = minc2(tmp_path / "a.mnc", STORED, "zyx", TOP)
    assert_placed(read(path), VALUES)
    np.testing.assert_allclose(VALUES, np.asarray(nibabel.load(path).dataobj))
    bricks = open_bricks(path)
    assert bricks is not None
    np.testing.assert_allclose(bricks.read(0, (2, 3, 4), (6, 9, 13)), VALUES[2:6, 3:9, 4:13], rtol=1e-6)


def test_every_order_of_axes_stands_at_the_same_place(tmp_path: Path) -> None:
    """Sagittal and coronal scans are stored x or y first: the axes of the image are those of the file."""
    stored = STORED.transpose(2, 0, 1)  # x, z, y
    path = minc2(tmp_path / "a.mnc", stored, "xzy", np.ones(22))
    volume = read_here(path)
    np.testing.assert_allclose(to_array(volume), stored / 65535.0, rtol=1e-6)
    place = index_to_world(volume)
    np.testing.assert_allclose(place[:3, :3], (TURN * SPACING)[:, [1, 2, 0]], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(place[:3, 3], TURN @ ORIGIN)


def test_time_points_are_asked_for(tmp_path: Path) -> None:
    path = minc2(tmp_path / "a.mnc", np.stack([STORED, STORED // 2]), "tzyx", np.ones(2))
    with pytest.raises(BadInput, match=r"^a.mnc has 2 time points \(0 to 1\): choose one with --time\.$"):
        read_here(path)
    assert_placed(read_here(path, time=1), STORED // 2 / 65535.0)


def test_files_of_itk_and_of_version_1(tmp_path: Path) -> None:
    image = sitk.GetImageFromArray(letter().astype(np.int16))
    image.SetSpacing(SPACING)
    image.SetOrigin(ORIGIN)
    sitk.WriteImage(image, str(tmp_path / "2.mnc"))
    writer = vtkMINCImageWriter()
    writer.SetInputData(from_array(letter(), SPACING, ORIGIN))
    writer.SetFileName(str(tmp_path / "1.mnc"))
    writer.Write()
    for name, kind in (("1.mnc", nibabel.Minc1Image), ("2.mnc", nibabel.minc2.Minc2Image)):
        assert isinstance(nibabel.load(tmp_path / name), kind)
        volume = read_here(tmp_path / name)
        np.testing.assert_allclose(to_array(volume), letter(), rtol=1e-6, atol=1e-5)
        np.testing.assert_allclose(volume.GetSpacing(), SPACING)
        np.testing.assert_allclose(volume.GetOrigin(), ORIGIN)


def test_what_nibabel_does_not_read_is_refused_with_its_reason(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    uneven = minc2(tmp_path / "a.mnc", STORED, "zyx", TOP, spacing=np.bytes_("irregular"))
    with pytest.raises(
        BadInput, match=r"^nibabel cannot read .*a.mnc \(Irregular spacing not supported\): it is damag"
    ):
        read_here(uneven)
    (tmp_path / "b.mnc").write_bytes(b"nothing of the kind")
    with pytest.raises(BadInput, match="nibabel cannot read"):
        read_here(tmp_path / "b.mnc")
    monkeypatch.setitem(sys.modules, "nibabel", None)
    with pytest.raises(BadInput, match=r"needs the package nibabel: pip install 'svv\[large\]'\.$"):
        read_here(uneven)
