"""HDF5 as programs lay it out: values, axes, places and units where each of them writes these."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("vtkmodules")
h5py = pytest.importorskip("h5py")

from vtkmodules.vtkCommonDataModel import vtkImageData  # noqa: E402

from svv.bricks.opened import data_files, open_bricks  # noqa: E402
from svv.dvr.draw.large import LargeVolume, open_volume  # noqa: E402
from svv.dvr.read.volumes import read_here  # noqa: E402
from svv.errors import BadInput  # noqa: E402
from tests.ell_volume import FIRST, STEP, assert_shown, ell, planes  # noqa: E402

TURN = np.array([[np.cos(0.5), -np.sin(0.5), 0], [np.sin(0.5), np.cos(0.5), 0], [0, 0, -1.0]])


# --- openPMD, ITK, NeXus, EMD, HyperSpy, VTKHDF -----------------------------------------------------------------------


def openpmd(path: Path, order: str, iterations: int = 1, **told: Any) -> Path:
    """A mesh (openPMD 1.1.0) whose axis labels are ``order``."""
    places = ["xyz".index(letter) for letter in order]
    with h5py.File(path, "w") as file:
        file.attrs.update(openPMD=np.bytes_("1.1.0"), basePath=np.bytes_("/data/%T/"), meshesPath=np.bytes_("meshes/"))
        for k in range(iterations):
            values = (k + 1) * ell().transpose(["zyx".index(letter) for letter in order])
            mesh = file.create_dataset(f"data/{100 * k}/meshes/rho", data=values)
            mesh.attrs.update(
                axisLabels=np.array([letter.encode() for letter in order]), gridSpacing=STEP[places] * 1e6,
                gridGlobalOffset=FIRST[places] * 1e6, gridUnitSI=1e-6, unitSI=1.0, geometry=np.bytes_("cartesian"),
            )  # fmt: skip
            mesh.attrs.update(told)
    return path


@pytest.mark.parametrize("order", ["zyx", "xyz"])
def test_openpmd(order: str, tmp_path: Path) -> None:
    assert_shown(openpmd(tmp_path / "v.h5", order))
    half = np.eye(3)["xyz".index(order[0])]
    path = openpmd(tmp_path / "v.h5", order, unitSI=2.0, position=[0.5, 0.0, 0.0])
    assert_shown(path, first=FIRST + 0.5 * half * STEP, factor=2.0)
    path = openpmd(tmp_path / "v.h5", order, gridUnitSI=[1e-6, 1e-6, 1e-6])  # as version 2 has it
    assert_shown(path)


def test_openpmd_in_fortrans_order(tmp_path: Path) -> None:
    """Labels, and what belongs to them, begin with the fastest axis."""
    assert_shown(
        openpmd(tmp_path / "v.h5", "zyx", dataOrder=np.bytes_("F"), axisLabels=np.array([b"x", b"y", b"z"]),
                gridSpacing=STEP * 1e6, gridGlobalOffset=FIRST * 1e6)
    )  # fmt: skip


def test_iterations_and_components_of_openpmd(tmp_path: Path) -> None:
    path = openpmd(tmp_path / "v.h5", "zyx", iterations=3)
    with pytest.raises(BadInput, match=r"3 time points \(0 to 2\): choose one with --time"):
        read_here(path)
    assert_shown(path, factor=3.0, time=2)
    assert_shown(path, factor=2.0, array="data/100/meshes/rho")
    with h5py.File(path, "a") as file:
        group = file.create_group("data/0/meshes/E")
        group.attrs.update(file["data/0/meshes/rho"].attrs)
        group["x"], group["y"] = ell(), 2 * ell()
    assert_shown(path, factor=2.0, array="E/y")
    with pytest.raises(BadInput, match=r"several volumes of one size.*meshes/E/x, meshes/E/y, meshes/rho"):
        read_here(path)


def test_cylindrical_meshes_of_openpmd_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="values in thetaMode coordinates"):
        read_here(openpmd(tmp_path / "v.h5", "zyx", geometry=np.bytes_("thetaMode")))


def test_itk_as_itself_writes_it(tmp_path: Path) -> None:
    itk = pytest.importorskip("SimpleITK")
    image = itk.GetImageFromArray(ell())
    image.SetSpacing(STEP.tolist())
    image.SetOrigin(FIRST.tolist())
    itk.WriteImage(image, str(tmp_path / "v.h5"))
    assert_shown(tmp_path / "v.h5")
    image.SetDirection(TURN.ravel().tolist())
    itk.WriteImage(image, str(tmp_path / "turned.hdf5"))
    assert_shown(tmp_path / "turned.hdf5", TURN * STEP)
    itk.WriteImage(itk.Compose(image, 2 * image), str(tmp_path / "vector.h5"))
    assert_shown(tmp_path / "vector.h5", TURN * STEP, factor=2.0, channel="1")


def nexus(path: Path, order: str, told: dict[str, Any], of_signal: dict[str, Any]) -> Path:
    """An entry whose data lies with the detector, and is linked to where it is plotted."""
    with h5py.File(path, "w") as file:
        file.attrs["default"] = "entry"
        detector = file.create_dataset("entry/detector/data", data=ell().transpose(["zyx".index(a) for a in order]))
        detector.attrs.update(of_signal)
        file["entry/other"] = np.ones(ell().shape)
        group = file.create_group("entry/plot")
        file["entry"].attrs["default"] = "plot"
        group.attrs.update(NX_class="NXdata", **told)
        group["counts"] = h5py.SoftLink("/entry/detector/data")
        for letter in order:
            group[letter] = planes(letter)
            group[letter].attrs["units"] = "mm"
    return path


@pytest.mark.parametrize("order", ["zyx", "xyz"])
def test_nexus(order: str, tmp_path: Path) -> None:
    path = nexus(tmp_path / "v.nxs", order, {"signal": "counts", "axes": list(order)}, {})
    assert_shown(path)
    assert_shown(path, array="entry/detector/data")
    indices = {f"{letter}_indices": k for k, letter in enumerate(order)}
    told = {"signal": "counts", "axes": sorted(order), **indices}
    assert_shown(nexus(tmp_path / "v.h5", order, told, {}))
    assert_shown(nexus(tmp_path / "v.h5", order, {}, {"signal": 1, "axes": ":".join(order)}))  # as older files have it


def test_nexus_with_edges_of_voxels_and_axes_without_places(tmp_path: Path) -> None:
    path = nexus(tmp_path / "v.h5", "zyx", {"signal": "counts", "axes": ["z", ".", "x"]}, {})
    with h5py.File(path, "a") as file:
        del file["entry/plot/x"]
        file["entry/plot/x"] = 10 + 1.5 * (np.arange(23) - 0.5)
        file["entry/plot/x"].attrs["units"] = "mm"
    assert_shown(path, (1.5, 1, 3), (10, 0, 30), says="no voxel size found along y: 1")


@pytest.mark.parametrize("begin", [0, 1])
def test_emd(begin: int, tmp_path: Path) -> None:
    """Berkeley's; the later version counts from 0 and stores the first two places of an even axis."""
    with h5py.File(tmp_path / "v.emd", "w") as file:
        group = file.create_group("data/tomogram")
        group.attrs["emd_group_type"] = 1
        group["data"] = ell().T
        for k, letter in enumerate("xyz"):
            group[f"dim{k + begin}"] = planes(letter) if begin else planes(letter)[:2]
            group[f"dim{k + begin}"].attrs.update(name=np.bytes_(letter), units=np.bytes_("[n_m]"))
    assert_shown(tmp_path / "v.emd")


def test_hyperspy(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "v.hspy", "w") as file:
        group = file.create_group("Experiments/one")
        group["data"] = ell()
        for k, letter in enumerate("zyx"):
            places = planes(letter)
            group.create_group(f"axis-{k}").attrs.update(name=letter, scale=np.diff(places)[0], offset=places[0])
    assert_shown(tmp_path / "v.hspy")


def test_vtks_own_layout_is_left_to_its_reader(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "v.h5", "w") as file:
        group = file.create_group("VTKHDF")
        group.attrs.update(Version=(1, 0), WholeExtent=(0, 21, 0, 17, 0, 13), Origin=FIRST, Spacing=STEP)
        group.attrs["Direction"] = TURN.ravel()
        group.attrs.create("Type", b"ImageData", dtype=h5py.string_dtype("ascii", 9))
        group["PointData/rho"] = ell()
    assert open_bricks(tmp_path / "v.h5") is None
    assert_shown(tmp_path / "v.h5", TURN * STEP)
    assert isinstance(open_volume(tmp_path / "v.h5"), vtkImageData)


# --- BigDataViewer, Imaris, MINC -------------------------------------------------------------------------------------


def big_data_viewer(path: Path, setups: int = 1, times: int = 1, affine: str = "1 0 0 0 0 1 0 0 0 0 1 0") -> Path:
    """As Fiji writes it: unsigned values in int16, and the size of a voxel in the .xml."""
    with h5py.File(path, "w") as file:
        for s in range(setups):
            file[f"s{s:02d}/resolutions"] = [[1.0, 1, 1], [2, 2, 1]]
            for t in range(times):
                values = (100 * (1 + s + 10 * t) * ell("u2")).view("i2")
                file[f"t{t:05d}/s{s:02d}/0/cells"], file[f"t{t:05d}/s{s:02d}/1/cells"] = values, values[:, ::2, ::2]
    size = f"<size>{' '.join(map(str, STEP))}</size>"
    listed = "".join(
        f"<ViewSetup><id>{s}</id><voxelSize><unit>um</unit>{size}</voxelSize></ViewSetup>" for s in range(setups)
    )
    path.with_suffix(".xml").write_text(
        '<SpimData version="0.2"><BasePath type="relative">.</BasePath><SequenceDescription><ImageLoader '
        f'format="bdv.hdf5"><hdf5 type="relative">{path.name}</hdf5></ImageLoader><ViewSetups>{listed}</ViewSetups>'
        '</SequenceDescription><ViewRegistrations><ViewRegistration timepoint="0" setup="0"><ViewTransform>'
        f"<affine>{affine}</affine></ViewTransform></ViewRegistration></ViewRegistrations></SpimData>"
    )
    return path


def test_big_data_viewer(tmp_path: Path) -> None:
    path = big_data_viewer(tmp_path / "v.h5")
    for one in (path, path.with_suffix(".xml")):
        assert_shown(one, first=(0, 0, 0), factor=100.0)
    opened = open_volume(path)
    assert isinstance(opened, LargeVolume) and opened.source.dtype == np.uint16
    assert data_files(path) == [path.with_suffix(".xml")] and data_files(path.with_suffix(".xml")) == [path]
    path.with_suffix(".xml").unlink()
    assert_shown(path, (1, 1, 1), (0, 0, 0), factor=100.0, says="v.h5: no voxel size found: 1 x 1 x 1")


def test_values_above_32767_of_big_data_viewer(tmp_path: Path) -> None:
    path = big_data_viewer(tmp_path / "v.h5", 2, 2)
    source = open_bricks(path.with_suffix(".xml"), array="t00001/s01/0/cells")
    assert source is not None
    expected = 1200 * ell("u2")  # beyond 65535, they wrap when they are written
    assert expected.max() > 32767
    np.testing.assert_array_equal(source.read(0, (0, 0, 0), source.levels[0].shape), expected)


def test_setups_and_time_points_of_big_data_viewer(tmp_path: Path) -> None:
    path = big_data_viewer(tmp_path / "v.h5", setups=2, times=2)
    with pytest.raises(BadInput, match=r"2 channels \(0 to 1\) and 2 time points \(0 to 1\): choose one with --ch"):
        read_here(path)
    assert_shown(path.with_suffix(".xml"), first=(0, 0, 0), factor=200.0, channel="1", time=0)
    level = ell()[:, ::2, ::2]
    source = open_bricks(path, array="t00000/s00/1/cells")
    assert source is not None
    np.testing.assert_array_equal(source.read(0, (0, 0, 0), level.shape), 100 * level)
    np.testing.assert_allclose(source.levels[0].axes, np.diag(STEP * [2, 2, 1]))
    np.testing.assert_allclose(source.levels[0].origin, STEP * [0.5, 0.5, 0])


def test_parts_of_big_data_viewer_in_other_files(tmp_path: Path) -> None:
    big_data_viewer(tmp_path / "v-00-00.h5")
    big_data_viewer(tmp_path / "v.h5")
    with h5py.File(tmp_path / "v.h5", "w") as file:
        file["t00000/s00"] = h5py.ExternalLink("v-00-00.h5", "t00000/s00")
    assert_shown(tmp_path / "v.xml", first=(0, 0, 0), factor=100.0)


def test_registrations_of_big_data_viewer_are_said_not_to_be_applied(tmp_path: Path) -> None:
    path = big_data_viewer(tmp_path / "v.h5", affine="1 0.3 0 5 0 1 0 6 0 0 2 7")
    says = "the registration in v.xml, which turns or shears the view, is not applied"
    assert_shown(path, first=(0, 0, 0), factor=100.0, says=says)
    text = path.with_suffix(".xml").read_text()
    path.with_suffix(".xml").write_text(text.replace("bdv.hdf5", "bdv.n5").replace("hdf5", "n5"))
    with pytest.raises(BadInput, match=r"images in the format bdv\.n5, and svv reads bdv\.hdf5"):
        read_here(path.with_suffix(".xml"))
    path.with_suffix(".xml").write_text(text.replace(">1.5 ", ">wide "))
    with pytest.raises(BadInput, match="its sizes of a voxel or its registrations are damaged"):
        read_here(path)


def imaris(path: Path, channels: int = 1, times: int = 1) -> Path:
    """After Bitplane's description of version 5.5: numbers as characters, and padding to whole chunks."""

    def said(value: object) -> Any:
        return np.array([letter.encode() for letter in str(value)])

    with h5py.File(path, "w") as file:
        about = file.create_group("DataSetInfo/Image").attrs
        about["Unit"] = said("um")
        for k, count in enumerate(ell().shape[::-1]):
            low = FIRST[k] - 0.5 * STEP[k]
            about[f"ExtMin{k}"], about[f"ExtMax{k}"] = said(low), said(low + count * STEP[k])
        for c in range(channels):
            file.create_group(f"DataSetInfo/Channel {c}").attrs["Name"] = said(["DAPI", "GFP"][c])
            for t in range(times):
                group = file.create_group(f"DataSet/ResolutionLevel 0/TimePoint {t}/Channel {c}")
                group["Data"] = np.pad((1 + c + 10 * t) * ell("u2"), ((0, 2), (0, 14), (0, 10)))
                group.attrs.update({f"ImageSize{a}": said(n) for a, n in zip("ZYX", ell().shape)})
    return path


@pytest.mark.parametrize("name", ["v.h5", "v.ims"])
def test_imaris(name: str, tmp_path: Path) -> None:
    path = imaris(tmp_path / name)
    assert_shown(path)
    assert read_here(path).GetDimensions() == ell().shape[::-1]
    path = imaris(tmp_path / name, channels=2, times=2)
    with pytest.raises(BadInput, match=r"2 channels \(0 DAPI, 1 GFP\) and 2 time points"):
        read_here(path)
    assert_shown(path, factor=12.0, channel="GFP", time=1)


def test_minc_under_another_name(tmp_path: Path) -> None:
    """With a scale for each slice, as MINC has it, and x to the left."""
    pytest.importorskip("nibabel")
    with h5py.File(tmp_path / "v.h5", "w") as file:
        for k, letter in enumerate("xyz"):
            dim = file.create_dataset(f"minc-2.0/dimensions/{letter}space", data=0)
            step = -STEP[k] if letter == "x" else STEP[k]
            dim.attrs.update(start=FIRST[k], step=step, length=ell().shape[2 - k], direction_cosines=np.eye(3)[k])
        image = file.create_dataset("minc-2.0/image/0/image", data=ell("i2"))
        image.attrs.update(dimorder=np.bytes_("zspace,yspace,xspace"), valid_range=[0.0, 200.0])
        for key, value in (("min", 0.0), ("max", 100.0)):
            scale = file.create_dataset(f"minc-2.0/image/0/image-{key}", data=np.full(14, value))
            scale.attrs["dimorder"] = np.bytes_("zspace")
    assert_shown(tmp_path / "v.h5", (-1.5, 2, 3), factor=0.5)


# --- by attributes ---------------------------------------------------------------------------------------------------


def test_sizes_in_attributes(tmp_path: Path) -> None:
    for key in ("element_size_um", "voxel_size", "resolution", "spacing"):
        with h5py.File(tmp_path / "v.h5", "w") as file:
            file["volume"] = ell()
            file["volume"].attrs[key] = STEP[::-1]
            file["volume"].attrs["offset"] = FIRST[::-1]
        assert_shown(tmp_path / "v.h5")
    with h5py.File(tmp_path / "v.h5", "w") as file:
        file["volume"] = ell().T
        file["volume"].attrs["element_size_um"] = STEP
        for k, letter in enumerate("xyz"):
            file["volume"].dims[k].label = letter
    assert_shown(tmp_path / "v.h5", first=(0, 0, 0))


def test_matlabs_files_are_hdf5(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "v.mat", "w", userblock_size=512) as file:
        file["volume"] = ell()
    assert_shown(tmp_path / "v.mat", (1, 1, 1), (0, 0, 0), says="no voxel size found")
