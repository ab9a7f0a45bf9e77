"""Volume formats of PyVista's readers: only in the standalone installation, with the same checks as the others."""

from __future__ import annotations

import struct
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

pyvista = pytest.importorskip("pyvista")

from svv.dvr.draw.views import make_views  # noqa: E402
from svv.dvr.read.grids import as_volume, index_to_world, to_array  # noqa: E402
from svv.dvr.read.volumes import read_here, read_volume  # noqa: E402
from svv.errors import BadInput  # noqa: E402

SHAPE = (4, 5, 6)
"""z, y, x"""


def values() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 1000, SHAPE).astype(np.int16)


def planes(axis: int, start: float, step: float) -> np.ndarray:
    return start + step * np.arange(SHAPE[::-1][axis])


def rectilinear(x: np.ndarray) -> Any:
    grid = pyvista.RectilinearGrid(x, planes(1, 0.0, 2.0), planes(2, 100.0, 0.3))
    grid["density"] = values().ravel()
    return grid


def dicom_element(group: int, element: int, kind: str, content: bytes) -> bytes:
    """One data element, explicit little-endian (DICOM PS3.5, 7.1.2)."""
    content += b" " * (len(content) % 2) if kind != "OW" else b""
    long = kind in ("OB", "OW")
    length = struct.pack("<2xI" if long else "<H", len(content))
    return struct.pack("<HH", group, element) + kind.encode() + length + content


def write_dicom(path: Path, pixels: np.ndarray, number: int) -> None:
    """A CT slice (rows, columns) int16 with spacing 0.5 x 0.25 and 3 between slices, written after the standard."""
    meta = dicom_element(2, 0x10, "UI", b"1.2.840.10008.1.2.1\0")
    rows, columns = pixels.shape
    body = [
        (0x08, 0x16, "UI", b"1.2.840.10008.5.1.4.1.1.2\0"),
        (0x18, 0x50, "DS", b"3"),
        (0x20, 0x0E, "UI", b"1.2.3\0"),
        (0x20, 0x13, "IS", str(number).encode()),
        (0x20, 0x32, "DS", f"0\\0\\{3 * number}".encode()),
        (0x20, 0x37, "DS", b"1\\0\\0\\0\\1\\0"),
        (0x28, 0x02, "US", struct.pack("<H", 1)),
        (0x28, 0x10, "US", struct.pack("<H", rows)),
        (0x28, 0x11, "US", struct.pack("<H", columns)),
        (0x28, 0x30, "DS", b"0.25\\0.5"),
        (0x28, 0x100, "US", struct.pack("<H", 16)),
        (0x28, 0x101, "US", struct.pack("<H", 16)),
        (0x28, 0x102, "US", struct.pack("<H", 15)),
        (0x28, 0x103, "US", struct.pack("<H", 1)),
        (0x7FE0, 0x10, "OW", pixels.astype("<i2").tobytes()),
    ]
    head = dicom_element(2, 0, "UL", struct.pack("<I", len(meta))) + meta
    path.write_bytes(bytes(128) + b"DICM" + head + b"".join(dicom_element(*one) for one in body))


def test_an_even_rectilinear_grid_is_a_volume(tmp_path: Path) -> None:
    rectilinear(planes(0, -1.0, 0.5)).save(tmp_path / "grid.vtr")
    volume = read_volume(tmp_path / "grid.vtr")
    np.testing.assert_array_equal(to_array(volume), values())
    np.testing.assert_allclose(volume.GetSpacing(), (0.5, 2.0, 0.3), rtol=1e-12)
    np.testing.assert_allclose(volume.GetOrigin(), (-1.0, 0.0, 100.0))


@pytest.mark.parametrize("name", ["grid.vtr", "grid.vtk"])
def test_an_uneven_one_is_resampled(tmp_path: Path, name: str) -> None:
    x = planes(0, 1.0, 0.5) ** 2
    rectilinear(x).save(tmp_path / name)
    volume = read_volume(tmp_path / name, resample_to=40)
    assert max(volume.GetDimensions()) == 40
    np.testing.assert_allclose(volume.GetBounds()[:2], (x[0], x[-1]), rtol=1e-4)
    assert values().min() <= to_array(volume).min() and to_array(volume).max() <= values().max()


def test_a_folder_of_dicom_slices_is_a_volume(tmp_path: Path) -> None:
    for number, pixels in enumerate(values()):
        write_dicom(tmp_path / f"slice{number}.dcm", pixels, number)
    volume = read_volume(tmp_path)
    np.testing.assert_allclose(volume.GetSpacing(), (0.5, 0.25, 3.0))
    np.testing.assert_array_equal(to_array(volume), values())


def test_what_is_no_regular_grid_is_refused(tmp_path: Path) -> None:
    pyvista.Sphere().save(tmp_path / "ball.stl")
    with pytest.raises(BadInput, match=r"ball\.stl is a vtkPolyData of points, lines or surfaces"):
        read_volume(tmp_path / "ball.stl")
    (tmp_path / "grid.vtr").write_text("nothing of the kind")
    with pytest.raises(BadInput, match="damaged"):
        read_volume(tmp_path / "grid.vtr")
    (tmp_path / "volume.what").write_text("1 2 3")
    with pytest.raises(BadInput, match="not have a supported format"):
        read_volume(tmp_path / "volume.what")


def test_inside_paraview_pyvista_is_not_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rectilinear(planes(0, -1.0, 0.5)).save(tmp_path / "grid.vtr")
    monkeypatch.setitem(sys.modules, "paraview", ModuleType("paraview"))
    with pytest.raises(BadInput, match="not have a supported format"):
        read_volume(tmp_path / "grid.vtr")


def test_an_image_of_pyvista_is_a_volume() -> None:
    image = pyvista.ImageData(dimensions=SHAPE[::-1], spacing=(0.5, 2.0, 3.0), origin=(1.0, 2.0, 3.0))
    image["density"] = values().ravel()
    volume = as_volume(image)
    np.testing.assert_array_equal(to_array(volume), values())
    np.testing.assert_allclose(index_to_world(volume), index_to_world(image))
    train, _ = make_views(image, None, n=12, size=16, mapper="cpu")
    assert len(train) == 12


def xdmf(path: Path, geometry: str, times: int = 1) -> Path:
    """Write a grid of 6 x 5 x 4 points as programs without PyVista do: without a time unless there are several."""
    spaces = {
        "ORIGIN_DXDYDZ": ('"3DCoRectMesh"', ["100 0 -1", "0.3 2 0.5"]),
        "VXVYVZ": ('"3DRectMesh"', [" ".join(map(str, planes(k, *at))) for k, at in enumerate(PLACES)]),
    }
    kind, items = spaces[geometry]
    data = "".join(f'<DataItem Dimensions="{len(i.split())}" Format="XML" Precision="8">{i}</DataItem>' for i in items)

    def grid(k: int) -> str:
        numbers = " ".join(str(x) for x in (values() + k).ravel())
        time = f'<Time Value="{k}"/>' if times > 1 else ""
        return (
            f'<Grid Name="g">{time}<Topology TopologyType={kind} Dimensions="4 5 6"/>'
            f'<Geometry GeometryType="{geometry}">{data}</Geometry>'
            '<Attribute Name="density" AttributeType="Scalar" Center="Node"><DataItem Dimensions="4 5 6"'
            f' NumberType="Int" Format="XML">{numbers}</DataItem></Attribute></Grid>'
        )

    grids = "".join(grid(k) for k in range(times))
    if times > 1:
        grids = f'<Grid Name="all" GridType="Collection" CollectionType="Temporal">{grids}</Grid>'
    path.write_text(f'<?xml version="1.0"?><Xdmf Version="3.0"><Domain>{grids}</Domain></Xdmf>')
    return path


PLACES = ((-1.0, 0.5), (0.0, 2.0), (100.0, 0.3))
"""First place and step along x, y, z."""


@pytest.mark.parametrize("read", [read_here, read_volume])
@pytest.mark.parametrize("geometry", ["ORIGIN_DXDYDZ", "VXVYVZ"])
@pytest.mark.parametrize("name", ["v.xdmf", "v.xmf", "V.XDMF"])
def test_xdmf_without_a_time(name: str, geometry: str, read: Any, tmp_path: Path) -> None:
    volume = read(xdmf(tmp_path / name, geometry))
    np.testing.assert_array_equal(to_array(volume), values())
    np.testing.assert_allclose(volume.GetSpacing(), [step for _, step in PLACES])
    np.testing.assert_allclose(volume.GetOrigin(), [start for start, _ in PLACES])


def test_time_points_of_a_reader_of_vtk_are_asked_for(tmp_path: Path) -> None:
    path = xdmf(tmp_path / "v.xdmf", "ORIGIN_DXDYDZ", times=3)
    with pytest.raises(BadInput, match=r"^v.xdmf has 3 time points \(0 to 2\): choose one with --time\.$"):
        read_volume(path)
    for k in range(3):
        np.testing.assert_array_equal(to_array(read_volume(path, time=k)), values() + k)
    with pytest.raises(BadInput, match="has no time point 3; it has 3 time points"):
        read_volume(path, time=3)
    with pytest.raises(BadInput, match="has neither channels nor time points: leave out --time"):
        read_volume(xdmf(tmp_path / "one.xdmf", "ORIGIN_DXDYDZ"), time=1)


def test_ensight_files_are_named_by_their_case(tmp_path: Path) -> None:
    """EnSight's readers have another name for the name of the file than all others."""
    (tmp_path / "v.case").write_text(
        "FORMAT\ntype: ensight gold\nGEOMETRY\nmodel: v.geo\nVARIABLE\nscalar per node: density v.scl\n"
    )
    sides = "".join(f"{n:10d}" for n in SHAPE[::-1])
    start, steps = ("\n".join(f"{place[k]:12.5e}" for place in PLACES) for k in (0, 1))
    (tmp_path / "v.geo").write_text(
        "a grid\nof points\nnode id assign\nelement id assign\npart\n         1\npart\nblock uniform\n"
        f"{sides}\n{start}\n{steps}\n"
    )
    numbers = "\n".join(f"{x:12.5e}" for x in values().ravel())
    (tmp_path / "v.scl").write_text(f"density\npart\n{1:10d}\nblock\n{numbers}\n")
    volume = read_volume(tmp_path / "v.case")
    ends = [(start, start + step * (n - 1)) for (start, step), n in zip(PLACES, SHAPE[::-1])]
    np.testing.assert_allclose(volume.GetBounds(), np.ravel(ends), atol=1e-4)


@pytest.mark.parametrize("raised", [TypeError("object of type 'NoneType' has no len()"), AttributeError()])
def test_an_exception_of_a_wrapper_is_no_damage(
    raised: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(*_: object, **__: object) -> None:
        raise raised

    rectilinear(planes(0, -1.0, 0.5)).save(tmp_path / "grid.vtr")
    monkeypatch.setattr(pyvista, "get_reader", failing)
    with pytest.raises(
        BadInput, match=rf"its reader failed \({type(raised).__name__}.*not mean that the file is damaged"
    ):
        read_here(tmp_path / "grid.vtr")
