"""Reading of volumes: files of many formats that contain a regular grid of numbers become a ``vtkImageData``."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray
from PIL import Image, ImageSequence
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkIOImage import vtkMetaImageReader, vtkNIFTIImageReader, vtkNrrdReader, vtkSLCReader
from vtkmodules.vtkIOLegacy import vtkGenericDataObjectReader
from vtkmodules.vtkIOXML import vtkXMLImageDataReader

from svv.bricks.mapped import raw_layout
from svv.bricks.tiff_files import TIFFFILE_DECODES, in_order
from svv.dvr.apart import apart, can_start
from svv.dvr.grids import Triple, as_volume, from_array, put_scalars, set_geometry
from svv.dvr.meshes import is_mesh, resampled
from svv.dvr.other_formats import reader_of
from svv.dvr.vtk_readers import damaged, run, vtk_messages
from svv.errors import BadInput

SUPPORTED = ".vti .vtk .mha .mhd .nrrd .nhdr .nii .nii.gz .slc .npy .raw .tif (or a folder of .tif)"
"""Formats that are read without PyVista."""


OURS = (".npy", ".raw", ".bin", ".dat")
"""Endings of the formats that neither VTK nor libtiff reads."""


def read_volume(
    path: str | Path,
    dims: Sequence[int] | None = None,
    dtype: DTypeLike | None = None,
    spacing: Triple | None = None,
    origin: Triple | None = None,
    array: str | None = None,
    resample_to: int | None = None,
) -> vtkImageData:
    """Read a volume from a file, or from a folder of TIFF or DICOM slices.

    Args:
        path: A file of one of the formats in ``SUPPORTED``; outside ParaView, with PyVista installed, also of any
            format for which PyVista has a reader (.vtr, .pvti, .dcm ...).
        dims: Number of points along x, y, z, for raw files only; by default taken from the file name
            (``foo_128x128x256_uint16.raw``).
        dtype: NumPy type of a raw file, such as ``>u2`` for big-endian shorts; by default taken from the file name.
        spacing: Spacing (x, y, z) in world units that overrides the file's.
        origin: Origin (x, y, z) in world units that overrides the file's.
        array: Name of the scalar array, if there are several.
        resample_to: Points along the longest side to which a grid that is no image is resampled; by default, as its
            cells and the memory suggest (:func:`svv.dvr.meshes.resampled`).

    Returns:
        An image with one single-component point scalar array; see ``as_volume``.

    Raises:
        BadInput: The file does not exist, has an unknown format, is damaged or is rejected by ``as_volume``.
    """
    file = Path(path)
    if dims is None and dtype is None and not file.name.lower().endswith(OURS) and file.exists() and can_start():
        place = {"spacing": _plain(spacing), "origin": _plain(origin)}
        return apart.read(file, {**place, "array": array, "resample_to": resample_to})
    return read_here(file, dims, dtype, spacing, origin, array, resample_to)


def _plain(numbers: Triple | None) -> list[float] | None:
    return None if numbers is None else [float(number) for number in numbers]


def read_here(
    file: Path,
    dims: Sequence[int] | None = None,
    dtype: DTypeLike | None = None,
    spacing: Triple | None = None,
    origin: Triple | None = None,
    array: str | None = None,
    resample_to: int | None = None,
) -> vtkImageData:
    """Read a volume in this process; see :func:`read_volume`, which lets VTK's readers run in one of their own."""
    if not file.exists():
        raise BadInput(f"There is no volume {file}; check the path.")
    image = _read(file, dims, dtype)
    if is_mesh(image):
        image = resampled(image, array, along=resample_to, name=file.name)
    for values, put in ((spacing, image.SetSpacing), (origin, image.SetOrigin)):
        if values is not None:
            if len(values) != 3:
                raise BadInput(f"Spacing and origin need three numbers (x, y, z), not {values}.")
            put(*(float(value) for value in values))
    return as_volume(image, array, file.name)


def _read(file: Path, dims: Sequence[int] | None, dtype: DTypeLike | None) -> vtkImageData:
    if file.is_dir():
        return _read_folder(file)
    try:
        with file.open("rb") as opened:
            if not opened.read(1):
                raise BadInput(f"{file} is empty.")
    except OSError as error:
        raise BadInput(f"Cannot read {file}: {error.strerror or error}.") from error
    name = file.name.lower()
    for suffix, read in _READERS.items():
        if name.endswith(suffix):
            return read(file)
    if dims is not None or dtype is not None or name.endswith((".raw", ".bin", ".dat")):
        return _read_raw(file, dims, dtype)
    if reader := reader_of(file):
        return run(reader, file)
    raise BadInput(
        f"{file} does not have a supported format ({SUPPORTED}); give dimensions and type if it is raw data."
    )


def _read_nrrd(file: Path) -> vtkImageData:
    fields = _nrrd_fields(file)
    image = run(vtkNrrdReader(), file)
    try:
        sizes = [int(size) for size in fields["sizes"].split()]
        if len(sizes) != 3:
            return image
        # VTK decodes the data, but mistakes a short first axis for components, and uses the lengths of the space
        # directions as spacing while ignoring their orientation.
        data = vtk_to_numpy(image.GetPointData().GetScalars()).reshape(sizes[::-1])
        axes = np.diag([abs(float(x)) for x in fields.get("spacings", "1 1 1").split()])
        if "space directions" in fields:
            axes = np.array([_vector(text) for text in re.findall(r"\([^)]*\)", fields["space directions"])]).T
        origin = np.array(_vector(fields.get("space origin", "(0,0,0)")))
        if axes.shape != (3, 3):
            raise ValueError("a volume needs three axes")
        image = from_array(data, name="NRRD")
        set_geometry(image, axes, origin)
    except (KeyError, ValueError) as error:
        raise damaged(file) from error
    return image


def _nrrd_fields(file: Path) -> dict[str, str]:
    """Return the fields of a header.

    Raises:
        BadInput: It lacks one without which there is no volume, or is not text: VTK would read on for ever.
    """
    with file.open("rb") as opened:
        header = re.split(rb"\r?\n\r?\n", opened.read(65536))[0].decode("latin-1")
    fields = dict(re.findall(r"^([a-z ]+): *(.*?)\r?$", header, re.MULTILINE))
    is_text = not re.search(r"[\0-\x08\x0b\x0c\x0e-\x1f]", header)
    if not (is_text and {"type", "dimension", "sizes", "encoding"} <= set(fields)):
        raise damaged(file)
    return fields


def _vector(text: str) -> list[float]:
    """Parse three numbers as written in NRRD headers, ``(1,2,3)``."""
    numbers = [float(x) for x in text.strip("() ").split(",")]
    if len(numbers) != 3:
        raise ValueError(f"{text} is not a vector of three numbers")
    return numbers


def _read_nifti(file: Path) -> vtkImageData:
    reader = vtkNIFTIImageReader()
    image = run(reader, file)
    placed = reader.GetSFormMatrix() or reader.GetQFormMatrix()
    if placed:
        matrix = np.array([[placed.GetElement(i, j) for j in range(4)] for i in range(4)])
        set_geometry(image, matrix[:3, :3] * image.GetSpacing(), matrix[:3, :3] @ image.GetOrigin() + matrix[:3, 3])
    slope, intercept = reader.GetRescaleSlope(), reader.GetRescaleIntercept()
    if slope not in (0.0, 1.0) or (slope == 1.0 and intercept != 0.0):
        stored = vtk_to_numpy(image.GetPointData().GetScalars())
        put_scalars(image, stored * np.float32(slope) + np.float32(intercept), "NIFTI")
    return image


def _read_npy(file: Path) -> vtkImageData:
    try:
        values = np.load(file, allow_pickle=False)
    except Exception as error:  # a damaged header makes NumPy raise all kinds of errors
        raise damaged(file) from error
    return from_array(values, name=file.stem)


def _read_tiff(file: Path) -> vtkImageData:
    return from_array(_tiff_pages(file), name=file.stem)


def _read_folder(folder: Path) -> vtkImageData:
    files = in_order(folder)
    if not files and (reader := reader_of(folder)):
        return run(reader, folder)
    if not files:
        raise BadInput(f"The folder {folder} contains no .tif slices; a volume is one file or a folder of slices.")
    slices = [_tiff_pages(file) for file in files]
    for file, pages in zip(files, slices):
        if pages.shape != slices[0].shape or pages.shape[0] != 1:
            raise BadInput(f"{file} differs in size from {files[0].name}; all slices must have the same size.")
    return from_array(np.concatenate(slices), name=folder.name)


class _Complaints(logging.Handler):
    """A handler that keeps what tifffile logs, because it logs errors instead of raising them."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.records: list[logging.LogRecord] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.records.append(record)


def _tiff_pages(file: Path) -> NDArray[Any]:
    """Return the pages of a TIFF file. (pages, height, width)"""
    import tifffile  # only here: it is slow to import

    listener = _Complaints()
    tifffile.logger().addHandler(listener)
    try:
        with vtk_messages(), tifffile.TiffFile(file) as opened:
            pages = list(opened.pages)  # in a truncated file, they end with only a log message
            if any("invalid page offset" in record.getMessage() for record in listener.records):
                raise damaged(file)
            if len({(page.shape, page.dtype) for page in pages}) != 1 or len(pages[0].shape) != 2:
                raise BadInput(f"{file} is not a volume: a TIFF stack needs greyscale pages of the same size.")
            if file.stat().st_size < max(max(a + b for a, b in zip(p.dataoffsets, p.databytecounts)) for p in pages):
                raise damaged(file)
            if int(pages[0].compression) in TIFFFILE_DECODES:
                return np.stack([page.asarray() for page in pages])
        # Pillow includes libtiff, and with it the compressions (LZW ...) for which tifffile needs another package.
        with vtk_messages(), Image.open(file) as image:
            return np.stack([np.asarray(page) for page in ImageSequence.Iterator(image)])
    except BadInput:
        raise
    except Exception as error:  # damaged files make the decoders raise all kinds of errors
        raise damaged(file) from error
    finally:
        tifffile.logger().removeHandler(listener)


def _read_raw(file: Path, dims: Sequence[int] | None, dtype: DTypeLike | None) -> vtkImageData:
    size, kind = raw_layout(file, dims, dtype)
    return from_array(np.fromfile(file, dtype=kind).reshape(size[::-1]), name=file.stem)


_READERS: dict[str, Callable[[Path], vtkImageData]] = {
    ".vti": lambda file: run(vtkXMLImageDataReader(), file),
    ".vtk": lambda file: run(vtkGenericDataObjectReader(), file),
    ".mha": lambda file: run(vtkMetaImageReader(), file),
    ".mhd": lambda file: run(vtkMetaImageReader(), file),
    ".slc": lambda file: run(vtkSLCReader(), file),
    ".nrrd": _read_nrrd,
    ".nhdr": _read_nrrd,
    ".nii": _read_nifti,
    ".nii.gz": _read_nifti,
    ".npy": _read_npy,
    ".tif": _read_tiff,
    ".tiff": _read_tiff,
}
