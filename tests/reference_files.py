"""Generated volumes in the formats of other programs, and what the library that those programs use reads in them.

Each maker takes a random generator and a folder, writes a file, and returns a :class:`Case`.
"""

from __future__ import annotations

import json
import struct
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import nibabel
import nrrd
import numpy as np
import pydicom
import SimpleITK as sitk
import tifffile
from numpy.typing import NDArray
from pydicom.dataset import FileMetaDataset
from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, ImplicitVRLittleEndian, generate_uid

from svv.bricks.formats.meta_image import META_TYPES

Values = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Case:
    """A file, how it is read, and what is in it."""

    path: Path
    values: Values
    """What the library reads. (nz, ny, nx)"""
    matrix: NDArray[np.float64]
    """From voxel indices (x, y, z) to the world, by the library or, where it has none, by the format's text. (4, 4)"""
    options: dict[str, Any] = field(default_factory=dict)
    exact: bool = True
    """Whether values are equal to the last bit, not within single precision."""


def random_values(rng: np.random.Generator, kinds: str, lead: tuple[int, ...] = ()) -> Values:
    """Values of one of some types, in a volume of random size."""
    kind = np.dtype(str(rng.choice(kinds.split())))
    shape = (*lead, *(int(n) for n in rng.integers(2, 7, 3)))
    if kind.kind == "f":
        return rng.normal(size=shape).astype(kind)
    limits = np.iinfo(kind)
    return rng.integers(limits.min, limits.max, shape, kind, endpoint=True)


def random_matrix(rng: np.random.Generator, turned: bool = True) -> NDArray[np.float64]:
    """The matrix of a grid that is turned or mirrored at will."""
    matrix = np.eye(4)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0] if turned else np.eye(3)
    matrix[:3, :3] = turn * rng.uniform(0.1, 3.0, 3)
    matrix[:3, 3] = rng.normal(size=3) * 20
    return matrix


def words(numbers: Any) -> str:
    """Numbers with all their digits."""
    return " ".join(repr(float(x)) for x in np.ravel(numbers))


def of_itk(path: Path) -> tuple[Values, NDArray[np.float64]]:
    """What ITK reads in a file."""
    image = sitk.ReadImage(str(path))
    matrix = np.eye(4)
    matrix[:3, :3] = np.reshape(image.GetDirection(), (3, 3)) * image.GetSpacing()
    matrix[:3, 3] = image.GetOrigin()
    return sitk.GetArrayFromImage(image), matrix


def meta_image(rng: np.random.Generator, folder: Path) -> Case:
    """A MetaImage file of any layout; ITK reads it."""
    name = str(rng.choice([key for key in META_TYPES if key != "MET_ASCII_CHAR"]))
    values = random_values(rng, META_TYPES[name], (int(rng.choice([1, 1, 2, 3])),))
    matrix, channels = random_matrix(rng), len(values)
    order, letter = (">", "True T true 1") if rng.integers(2) else ("<", "False F false 0")
    spacing = np.linalg.norm(matrix[:3, :3], axis=0)
    fields = {
        "NDims": "3", str(rng.choice(["BinaryDataByteOrderMSB", "ElementByteOrderMSB"])): rng.choice(letter.split()),
        str(rng.choice(["TransformMatrix", "Rotation", "Orientation"])): words((matrix[:3, :3] / spacing).T),
        str(rng.choice(["Offset", "Position", "Origin"])): words(matrix[:3, 3]),
        str(rng.choice(["ElementSpacing", "ElementSize"])): words(spacing),
        "DimSize": " ".join(str(n) for n in values.shape[:0:-1]), "ElementType": name,
    }  # fmt: skip
    if channels > 1:
        fields["ElementNumberOfChannels"] = str(channels)
    data = np.moveaxis(values, 0, -1).astype(values.dtype.newbyteorder(order)).tobytes()
    mode = str(rng.choice(["local", "local end", "packed", "raw", "skip", "end", "list", "pattern"]))
    parts, local = values.shape[1], mode.startswith("local")
    if mode == "packed":
        data = zlib.compress(data)
        fields |= {"CompressedData": "True", "CompressedDataSize": str(len(data))}
    if mode in ("skip", "end", "local end"):
        data, fields["HeaderSize"] = b"j" * 37 + data, "37" if mode == "skip" else "-1"
    target, path = "v.raw", folder / ("v.mha" if local else "v.mhd")
    if mode in ("list", "pattern"):
        names = [f"v{k:03d}.raw" for k in range(3, parts + 3)]
        for k, one in enumerate(names):
            (folder / one).write_bytes(data[k * len(data) // parts : (k + 1) * len(data) // parts])
        target = "\n".join(["LIST", *names]) if mode == "list" else f"v%03d.raw 3 {parts + 2} 1"
    fields["ElementDataFile"] = "LOCAL" if local else target
    text = "".join(f"{key}{rng.choice([' = ', '='])}{value}\n" for key, value in fields.items()).encode()
    path.write_bytes(text + (data if local else b""))
    (folder / "v.raw").write_bytes(data)
    read, placed = of_itk(path)
    channel = int(rng.integers(channels))
    chosen = {"channel": channel} if channels > 1 else {}
    return Case(path, read.reshape(*values.shape[1:], channels)[..., channel], placed, chosen)


NRRD_TYPES = {"i1": "int8", "u1": "uchar", "i2": "short", "u2": "ushort", "i4": "int", "u4": "uint", "i8": "int64",
              "u8": "uint64", "f4": "float", "f8": "double"}  # fmt: skip


def nrrd_file(rng: np.random.Generator, folder: Path) -> Case:
    """An NRRD file with directions, of any layout; pynrrd reads it."""
    channels = int(rng.choice([1, 1, 3]))
    values, matrix = random_values(rng, " ".join(NRRD_TYPES), (channels,)), random_matrix(rng)
    kind, order = NRRD_TYPES[values.dtype.str[1:]], "big" if rng.integers(2) else "little"
    columns = ["(" + ",".join(repr(float(x)) for x in column) + ")" for column in matrix[:3, :3].T]
    sizes = [str(n) for n in values.shape[:0:-1]]
    encoding = str(rng.choice(["raw", "gzip", "gz", "bzip2", "bz2", "ascii", "text"]))
    head = [
        "NRRD0005", "# a comment: not a field", "key:=value", f"type: {kind}", f"dimension: {4 if channels > 1 else 3}",
        "sizes: " + " ".join([str(channels)] * (channels > 1) + sizes), f"encoding: {encoding}", f"endian: {order}",
        "space: left-posterior-superior",
        "space directions: " + " ".join(["none"] * (channels > 1) + columns),
        "space origin: (" + ",".join(repr(float(x)) for x in matrix[:3, 3]) + ")",
    ]  # fmt: skip
    plain = np.moveaxis(values, 0, -1)
    data = plain.astype(values.dtype.newbyteorder(">" if order == "big" else "<")).tobytes()
    if encoding in ("ascii", "text"):
        data = " ".join(repr(x) for x in plain.ravel().tolist()).encode()
    if encoding in ("gzip", "gz"):
        import gzip

        data = gzip.compress(data)
    if encoding in ("bzip2", "bz2"):
        import bz2

        data = bz2.compress(data)
    mode = str(rng.choice(["attached", "detached", "lines", "bytes", "end"]))
    if encoding != "raw" and mode in ("bytes", "end"):
        mode = "detached"
    if mode == "lines":
        data = b"a line\nanother one\n" + data
        head.append("line skip: 2")
    if mode in ("bytes", "end"):
        data = b"j" * 23 + data
        head.append(f"byte skip: {23 if mode == 'bytes' else -1}")
    path = folder / ("v.nrrd" if mode == "attached" else "v.nhdr")
    if mode != "attached":
        head.append("data file: v.dat")
        (folder / "v.dat").write_bytes(data)
    path.write_bytes("\n".join([*head, "", ""]).encode() + (data if mode == "attached" else b""))
    read, told = nrrd.read(str(path), index_order="C")
    placed = np.eye(4)
    placed[:3, :3] = np.array(told["space directions"])[-3:].T
    placed[:3, 3] = told["space origin"]
    channel = int(rng.integers(channels))
    read = read.reshape(*values.shape[1:], channels)
    return Case(path, read[..., channel], placed, {"channel": channel} if channels > 1 else {})


def nifti(rng: np.random.Generator, folder: Path) -> Case:
    """A NIfTI file of either version; nibabel writes and reads it."""
    times = int(rng.choice([1, 1, 3]))
    values = random_values(rng, "u1 i1 u2 i2 u4 i4 f4 f8 i8 u8", (times,))
    matrix, form = random_matrix(rng), str(rng.choice(["sform", "qform"]))
    second = bool(rng.integers(2))
    order = str(rng.choice(["<", ">"]))
    header = (nibabel.Nifti2Header if second else nibabel.Nifti1Header)(endianness=order)
    header.set_data_dtype(values.dtype.newbyteorder(order))
    array = values.transpose(3, 2, 1, 0) if times > 1 else values[0].T
    paired = not second and bool(rng.integers(2))
    kind = nibabel.Nifti2Image if second else nibabel.Nifti1Pair if paired else nibabel.Nifti1Image
    image = kind(array, None, header)
    (image.set_sform if form == "sform" else image.set_qform)(matrix, 1)
    scaled = values.dtype.itemsize <= 2 and bool(rng.integers(2))
    if scaled:
        image.header.set_slope_inter(float(rng.uniform(0.1, 2)), float(rng.normal() * 100))
    path = folder / ("v.hdr" if paired else str(rng.choice(["v.nii", "v.nii.gz"])))
    nibabel.save(image, path)
    read = nibabel.load(path)
    time = int(rng.integers(times))
    got = np.asarray(read.dataobj)
    got = (got[..., time] if times > 1 else got).T
    return Case(path, got, read.affine, {"time": time} if times > 1 else {}, exact=not scaled)


def tiff(rng: np.random.Generator, folder: Path) -> Case:
    """A TIFF file as ImageJ, OME or tifffile write it, with or without channels and time points."""
    program = str(rng.choice(["imagej", "ome", "plain", "axes"]))
    kinds = {"imagej": "u1 u2 f4"}.get(program, "u1 i1 u2 i2 u4 i4 f4 f8")
    times, channels = (1, 1) if program == "plain" else (int(rng.choice([1, 3])), int(rng.choice([1, 2])))
    values = random_values(rng, kinds, (times, channels))
    order = {"imagej": "TZCYX", "plain": "TCZYX"}.get(program, str(rng.choice(["TCZYX", "TZCYX", "CTZYX"])))
    stored = values.transpose(["TCZYX".index(axis) for axis in order])
    size = np.round(rng.uniform(0.1, 3.0, 3), 3)
    shape = [n for n, axis in zip(stored.shape, order) if axis in "ZYX" or n > 1]
    axes = "".join(axis for n, axis in zip(stored.shape, order) if axis in "ZYX" or n > 1)
    told: dict[str, Any] = {"photometric": "minisblack", "metadata": {"axes": axes}}
    if program == "imagej":
        told |= {"imagej": True, "resolution": tuple(1 / size[:2]), "byteorder": ">"}
        told["metadata"] |= {"spacing": size[2], "unit": "um"}
    elif program == "ome":
        units = rng.permutation(["µm", "nm", "mm"])
        factor = {"µm": 1.0, "nm": 1e-3, "mm": 1e3}
        told["ome"] = True
        for axis, length, unit in zip("XYZ", size, units):
            told["metadata"] |= {f"PhysicalSize{axis}": length, f"PhysicalSize{axis}Unit": str(unit)}
        size = size * [factor[unit] / factor[units[0]] for unit in units]
    elif program == "plain":
        told["metadata"], size = None, np.ones(3)
    else:
        told |= {"resolution": tuple(1 / size[:2]), "resolutionunit": 1}
        told["metadata"] |= {"spacing": size[2], "unit": "um"}
    if rng.integers(2):
        told["compression"] = "zlib"
    if program == "plain" and rng.integers(2):
        told["bigtiff"] = True
    path = folder / ("v.ome.tif" if program == "ome" else "v.tif")
    if program == "imagej":
        told.pop("compression", None)
    tifffile.imwrite(path, stored.reshape(shape), **told)
    time, channel = int(rng.integers(times)), int(rng.integers(channels))
    read = tifffile.imread(path).reshape(stored.shape).transpose([order.index(axis) for axis in "TCZYX"])
    options: dict[str, Any] = {"time": time} if times > 1 else {}
    options |= {"channel": channel} if channels > 1 else {}
    return Case(path, read[time, channel], np.diag([*size, 1.0]), options)


def write_zarr(folder: Path, values: Values, attributes: dict[str, Any]) -> None:
    """A group of Zarr's version 2 with the array ``0``, which every version of the package reads."""
    (folder / "0").mkdir(parents=True)
    (folder / ".zgroup").write_text('{"zarr_format": 2}')
    (folder / ".zattrs").write_text(json.dumps(attributes))
    told = {"zarr_format": 2, "shape": values.shape, "chunks": values.shape, "dtype": values.dtype.str, "order": "C"}
    told |= {"compressor": None, "fill_value": 0, "filters": None}
    (folder / "0" / ".zarray").write_text(json.dumps(told))
    (folder / "0" / ".".join("0" * values.ndim)).write_bytes(values.tobytes())


def ome_zarr(rng: np.random.Generator, folder: Path) -> Case:
    """An OME-Zarr image with its axes in any order."""
    values = random_values(rng, "u1 i2 u2 f4", (int(rng.integers(1, 4)), int(rng.integers(1, 3))))
    order = [str(axis) for axis in rng.permutation(list("tczyx"))]
    left = [axis for axis in order if axis in "zyx" or rng.integers(2)]
    stored = values.transpose(["tczyx".index(axis) for axis in order])
    stored = stored[tuple(0 if axis not in left else slice(None) for axis in order)]
    size, shift = {axis: float(rng.uniform(0.1, 3)) for axis in left}, {a: float(rng.normal()) for a in left}
    types = {"t": "time", "c": "channel"}
    steps = [
        {"type": "scale", "scale": [size[axis] for axis in left]},
        {"type": "translation", "translation": [shift[axis] for axis in left]},
    ]
    axes = [{"name": axis, "type": types.get(axis, "space")} for axis in left]
    datasets = [{"path": "0", "coordinateTransformations": steps}]
    write_zarr(folder / "v.zarr", stored, {"multiscales": [{"version": "0.4", "axes": axes, "datasets": datasets}]})
    time = int(rng.integers(values.shape[0])) if "t" in left else 0
    channel = int(rng.integers(values.shape[1])) if "c" in left else 0
    options: dict[str, Any] = {"time": time} if "t" in left and values.shape[0] > 1 else {}
    options |= {"channel": channel} if "c" in left and values.shape[1] > 1 else {}
    matrix = np.diag([*(size[axis] for axis in "xyz"), 1.0])
    matrix[:3, 3] = [shift[axis] for axis in "xyz"]
    return Case(folder / "v.zarr", values[time, channel], matrix, options)


def ilastik(rng: np.random.Generator, folder: Path) -> Case:
    """An HDF5 file of ilastik, with its ``axistags``."""
    values = random_values(rng, "u1 u2 f4", (int(rng.integers(1, 4)), int(rng.integers(1, 3))))
    order = str(rng.choice(["tczyx", "tzyxc", "zyxct", "xyzct"]))
    steps = {axis: float(rng.uniform(0.1, 3)) for axis in "xyz"}
    with h5py.File(folder / "v.h5", "w") as file:
        data = file.create_dataset("exported_data", data=values.transpose(["tczyx".index(axis) for axis in order]))
        tags = [{"key": axis, "typeFlags": 2, "resolution": steps.get(axis, 0), "description": ""} for axis in order]
        data.attrs["axistags"] = json.dumps({"axes": tags})
    time, channel = int(rng.integers(values.shape[0])), int(rng.integers(values.shape[1]))
    options: dict[str, Any] = {"time": time} if values.shape[0] > 1 else {}
    options |= {"channel": channel} if values.shape[1] > 1 else {}
    return Case(folder / "v.h5", values[time, channel], np.diag([*(steps[axis] for axis in "xyz"), 1.0]), options)


def dicom_slice(
    page: Values,
    place: Any,
    turn: Any = ((1, 0), (0, 1), (0, 0)),
    steps: Any = (1, 1, 1),
    syntax: str = ExplicitVRLittleEndian,
) -> pydicom.Dataset:
    """A slice of int16 with rows and columns along two directions (3, 2), at a place in the world."""
    data = pydicom.Dataset()
    data.SOPClassUID, data.SOPInstanceUID = CTImageStorage, generate_uid()
    data.SeriesInstanceUID, data.FrameOfReferenceUID, data.Modality = "1.2.3", "1.2.3.4", "CT"
    data.Rows, data.Columns = page.shape[-2:]
    data.SamplesPerPixel, data.PhotometricInterpretation = 1, "MONOCHROME2"
    data.BitsAllocated, data.BitsStored, data.HighBit, data.PixelRepresentation = 16, 16, 15, 1
    data.ImagePositionPatient = [f"{x:.9g}"[:16] for x in place]
    data.ImageOrientationPatient = [f"{x:.9f}"[:16] for x in np.ravel(np.transpose(turn))]
    data.PixelSpacing = [f"{steps[1]:.9g}", f"{steps[0]:.9g}"]
    data.SliceThickness = f"{steps[2]:.9g}"
    data.file_meta = FileMetaDataset()
    data.file_meta.TransferSyntaxUID = syntax
    data.PixelData = page.astype("<i2").tobytes()
    data["PixelData"].VR = "OW"
    return data


def dicom(rng: np.random.Generator, folder: Path) -> Case:
    """A folder of DICOM slices of any direction, in files without endings, in no order; ITK reads it."""
    values = random_values(rng, "i2")
    matrix = random_matrix(rng)
    turn = matrix[:3, :3] / np.linalg.norm(matrix[:3, :3], axis=0)
    turn[:, 2] = np.cross(turn[:, 0], turn[:, 1])  # slices are counted along the normal
    matrix[:3, :3] = turn * np.linalg.norm(matrix[:3, :3], axis=0)
    syntax = ExplicitVRLittleEndian if rng.integers(2) else ImplicitVRLittleEndian
    scale = [(1.0, 0.0), (1.0, -1024.0), (0.5, 3.25)][int(rng.integers(3))]
    names = rng.permutation(len(values) + 40)[: len(values)]
    (folder / "scan").mkdir()
    steps, series = np.linalg.norm(matrix[:3, :3], axis=0), generate_uid()
    for k, page in enumerate(values):
        data = dicom_slice(page, (matrix @ [0, 0, k, 1])[:3], turn[:, :2], steps, syntax)
        data.InstanceNumber, data.SeriesInstanceUID = int(names[k]), series
        data.RescaleSlope, data.RescaleIntercept = scale
        data.save_as(folder / "scan" / f"I{names[k]:04d}", enforce_file_format=True)
    reader = sitk.ImageSeriesReader()
    reader.SetFileNames(reader.GetGDCMSeriesFileNames(str(folder / "scan")))
    image = reader.Execute()
    placed = np.eye(4)
    placed[:3, :3] = np.reshape(image.GetDirection(), (3, 3)) * image.GetSpacing()
    placed[:3, 3] = image.GetOrigin()
    return Case(folder / "scan", sitk.GetArrayFromImage(image), placed, exact=scale[0] == 1.0)


def write_nan_nifti(path: Path, values: Values) -> Path:
    """A NIfTI file whose slope and intercept are no numbers, as several programs write it."""
    header = bytearray(352)
    struct.pack_into("<i", header, 0, 348)
    struct.pack_into("<8h", header, 40, 3, *values.shape[::-1], 1, 1, 1, 1)
    struct.pack_into("<2h", header, 70, 4, 16)
    struct.pack_into("<8f", header, 76, *[1.0] * 8)
    struct.pack_into("<3f", header, 108, 352, np.nan, np.nan)
    header[344:348] = b"n+1\0"
    path.write_bytes(bytes(header) + values.astype("<i2").tobytes())
    return path


MAKERS = {maker.__name__: maker for maker in (meta_image, nrrd_file, nifti, tiff, ome_zarr, ilastik, dicom)}
