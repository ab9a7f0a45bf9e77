"""Reading of volumes: files of many formats that contain a regular grid of numbers become a ``vtkImageData``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from numpy.typing import DTypeLike
from vtkmodules.vtkCommonDataModel import vtkImageData, vtkRectilinearGrid
from vtkmodules.vtkCommonExecutionModel import vtkAlgorithm
from vtkmodules.vtkIOHDF import vtkHDFReader
from vtkmodules.vtkIOLegacy import vtkGenericDataObjectReader
from vtkmodules.vtkIOXML import vtkXMLImageDataReader

from svv.bricks.formats.axes import Choice
from svv.bricks.formats.chunked import ChunkedSource
from svv.bricks.formats.hdf5 import is_hdf5
from svv.bricks.formats.source import Source, WithoutValues
from svv.bricks.opened import HDF5, HDF5_INSIDE, header_reader, open_bricks
from svv.dvr.read.grids import Triple, as_volume, assumed_of, from_array, put_assumed, rectilinear, set_geometry
from svv.dvr.read.meshes import describe_resampling, is_mesh, resampled
from svv.dvr.read.openvdb_files import read_vdb
from svv.dvr.read.other_formats import reader_of
from svv.dvr.read.reader_process import apart, can_start
from svv.dvr.read.slc import read_slc
from svv.dvr.read.vtk_readers import check_memory, run, vtk_messages
from svv.errors import BadInput

SUPPORTED = (
    ".vti .vtk .mha .mhd .nrrd .nhdr .nii .nii.gz .HEAD .mif .mnc .mgz .mrc .fits .am .bov .vgi .dat .cube .slc .npy "
    ".npz .raw .h5 .nc .zarr .n5 .tif .xdmf .vdb, or a folder of .tif or DICOM slices"
)
"""Formats that are read without PyVista."""

OURS = (".npy", ".raw", ".bin", ".dat")
"""Endings of the formats that neither VTK nor libtiff reads."""


def read_volume(  # noqa: PLR0913 - what some kind of file needs
    path: str | Path,
    dims: Sequence[int] | None = None,
    dtype: DTypeLike | None = None,
    spacing: Triple | None = None,
    origin: Triple | None = None,
    array: str | None = None,
    channel: str | int | None = None,
    time: int | None = None,
    resample_to: int | None = None,
) -> vtkImageData:
    """Read a volume from a file, or from a folder of TIFF or DICOM slices.

    Args:
        path: A file of one of the formats in ``SUPPORTED``; outside ParaView, with PyVista installed, also of any
            format for which PyVista has a reader (.vtr, .pvti ...); with pydicom installed, DICOM.
        dims: Number of points along x, y, z, for raw files only; by default taken from the file name
            (``foo_128x128x256_uint16.raw``).
        dtype: NumPy type of a raw file, such as ``>u2`` for big-endian shorts; by default taken from the file name.
        spacing: Spacing (x, y, z) in world units that overrides the file's.
        origin: Origin (x, y, z) in world units that overrides the file's.
        array: Name of the scalar array, if there are several.
        channel: Number (from 0) or name of a channel, if the file has several.
        time: Number (from 0) of a time point, if the file has several.
        resample_to: Points along the longest side to which a grid that is no image is resampled; by default, as its
            cells and the memory suggest (:func:`svv.dvr.read.meshes.resampled`).

    Returns:
        An image with one single-component point scalar array; see ``as_volume``.

    Raises:
        BadInput: The file does not exist, has an unknown format, is damaged, has several channels or time points of
            which none is chosen, or is rejected by ``as_volume``.
    """
    file = Path(path)
    choice = Choice(None if channel is None else str(channel), time)
    if dims is None and dtype is None and not file.name.lower().endswith(OURS) and file.exists() and can_start():
        place = {"spacing": _plain(spacing), "origin": _plain(origin)}
        known = {**place, "array": array, "channel": choice.channel, "time": time, "resample_to": resample_to}
        return apart.read(file, known)
    return read_here(file, dims, dtype, spacing, origin, array, choice.channel, time, resample_to)


def _plain(numbers: Triple | None) -> list[float] | None:
    return None if numbers is None else [float(number) for number in numbers]


def read_here(  # noqa: PLR0913 - as above
    file: Path,
    dims: Sequence[int] | None = None,
    dtype: DTypeLike | None = None,
    spacing: Triple | None = None,
    origin: Triple | None = None,
    array: str | None = None,
    channel: str | None = None,
    time: int | None = None,
    resample_to: int | None = None,
) -> vtkImageData:
    """Read a volume in this process; see :func:`read_volume`, which lets VTK's readers run in one of their own."""
    if not file.exists():
        raise BadInput(f"There is no volume {file}; check the path.")
    choice = Choice(channel, time)
    image, array = _read(file, dims, dtype, array, choice)
    if is_mesh(image):
        said, mesh = assumed_of(image), image
        image = resampled(mesh, array, along=resample_to, name=file.name)
        put_assumed(image, " ".join(filter(None, (said, describe_resampling(mesh, image)))))
    for values, put in ((spacing, image.SetSpacing), (origin, image.SetOrigin)):
        if values is not None:
            if len(values) != 3:
                raise BadInput(f"Spacing and origin need three numbers (x, y, z), not {values}.")
            put(*(float(value) for value in values))
    if spacing is not None:
        put_assumed(image, None)
    return as_volume(image, array, file.name)


def _read(
    file: Path, dims: Sequence[int] | None, dtype: DTypeLike | None, array: str | None, choice: Choice
) -> tuple[vtkImageData, str | None]:
    """Return the image, and the name of the array that is still to be chosen of it."""
    if file.is_file():
        try:
            with file.open("rb") as opened:
                if not opened.read(1):
                    raise BadInput(f"{file} is empty.")
        except OSError as error:
            raise BadInput(f"Cannot read {file}: {error.strerror or error}.") from error
    with vtk_messages():  # libtiff writes to the terminal
        source = open_bricks(file, dims, dtype, None, None, array, choice, whole=True)
        if source is not None:
            return image_of(source, file), None
    if file.name.lower().endswith(".slc"):
        return read_slc(file), array
    if file.name.lower().endswith(".vdb"):
        return read_vdb(file, choice, array), None
    read = next((read for suffix, read in _READERS.items() if file.name.lower().endswith(suffix)), None)
    if file.name.lower().endswith((*HDF5, *HDF5_INSIDE)) and file.is_file() and is_hdf5(file):
        read = vtkHDFReader  # the rest was read above
    if reader := read() if read else reader_of(file):
        return run(reader, file, choice), array
    if file.is_dir():
        raise BadInput(
            f"The folder {file} contains no .tif slices and no DICOM files; a volume is one file or a folder of slices."
        )
    raise BadInput(
        f"{file} does not have a supported format ({SUPPORTED}); give dimensions and type if it is raw data."
    )


def image_of(source: Source, file: Path) -> vtkImageData | vtkRectilinearGrid:
    """Return the finest level of a volume as an image, or as a rectilinear grid if its planes are not evenly spaced."""
    level = source.levels[0]
    check_memory(level.shape[::-1], source.dtype.itemsize, file)
    header = header_reader(file)
    title = file.stem if header is None else header(file).title
    try:
        values = source.read(0, (0, 0, 0), level.shape)
    except WithoutValues:
        if not isinstance(source, ChunkedSource):
            raise
        values = source.read_with_gaps(0, (0, 0, 0), level.shape)
    if source.planes is not None:
        return rectilinear(values, source.planes, title, source.assumed)
    image = from_array(values, name=title)
    set_geometry(image, level.axes, level.origin)
    put_assumed(image, source.assumed)
    return image


_READERS: dict[str, Callable[[], vtkAlgorithm]] = {
    ".vti": vtkXMLImageDataReader, ".vtk": vtkGenericDataObjectReader,
}  # fmt: skip
"""VTK's readers, by the ending."""
