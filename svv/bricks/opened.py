"""Opening of volumes for bricked access, by the format of the file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import DTypeLike

from svv.bricks.formats.adios import is_bp, open_bp
from svv.bricks.formats.afni import afni_header
from svv.bricks.formats.amira import am_header
from svv.bricks.formats.axes import Choice, check_alone
from svv.bricks.formats.big_data_viewer import described
from svv.bricks.formats.chunked import is_zarr, open_zarr
from svv.bricks.formats.cryo_em import mrc_header
from svv.bricks.formats.cube import cube_header
from svv.bricks.formats.dicom import is_dicom, open_dicom
from svv.bricks.formats.fits import open_fits
from svv.bricks.formats.freesurfer import mgh_header
from svv.bricks.formats.hdf5 import is_hdf5, open_hdf5
from svv.bricks.formats.mapped import is_tecplot, mapped, open_npy, open_npz, open_vti, raw_layout
from svv.bricks.formats.meta_image import meta_header
from svv.bricks.formats.minc import open_minc
from svv.bricks.formats.mrtrix import mif_header
from svv.bricks.formats.n5 import is_n5, open_n5
from svv.bricks.formats.netcdf import open_netcdf
from svv.bricks.formats.nifti import nifti_header
from svv.bricks.formats.nrrd import nrrd_header
from svv.bricks.formats.opendx import dx_header
from svv.bricks.formats.philips import open_par, par_of
from svv.bricks.formats.places import no_size
from svv.bricks.formats.source import Level, Source, level_of
from svv.bricks.formats.stored import Stored
from svv.bricks.formats.text_headers import bov_header, dat_header, is_dat_header, vgi_header
from svv.bricks.formats.tiff import open_tiff
from svv.errors import BadInput

HDF5 = (".h5", ".hdf5", ".he5")
"""Endings of HDF5 files."""

HDF5_INSIDE = (".hdf", ".nxs", ".nx5", ".ims", ".emd", ".hspy", ".mat", ".cmap")
"""Endings of files that may be HDF5: NeXus, Imaris, electron microscopy, HyperSpy, MATLAB 7.3 and ChimeraX."""

NETCDF = (".nc", ".nc3", ".nc4", ".cdf")
"""Endings of netCDF files, of which newer ones are HDF5."""

RAW = (".raw", ".bin", ".dat")
"""Endings of raw files."""

TIFF = (".tif", ".tiff")
"""Endings of TIFF files."""

ZARR_ZIP = (".zarr.zip", ".ozx", ".zip")
"""Endings of zip archives of Zarr."""

FITS = (".fits", ".fit", ".fts", ".fits.gz", ".fits.fz")
"""Endings of FITS files."""

ADIOS = (".bp", ".bp3")
"""Endings of files of ADIOS; newer ones are folders."""

MRC = (".mrc", ".map", ".ccp4", ".rec", ".st")
"""Endings of maps of electron microscopy."""

HEADERS: dict[str, Callable[[Path], Stored]] = {
    **dict.fromkeys((".mhd", ".mha"), meta_header),
    **dict.fromkeys((".nrrd", ".nhdr"), nrrd_header),
    **dict.fromkeys((".cube", ".cub"), cube_header),
    **dict.fromkeys((".mgz", ".mgh", ".mgh.gz"), mgh_header),
    ".am": am_header,
    ".dx": dx_header,
    ".bov": bov_header,
    ".vgi": vgi_header,
    **dict.fromkeys((".head", ".brik", ".brik.gz"), afni_header),
    **dict.fromkeys((".mif", ".mih", ".mif.gz"), mif_header),
    **dict.fromkeys((".nii", ".nii.gz", ".hdr", ".hdr.gz", ".img", ".img.gz"), nifti_header),
    **dict.fromkeys((f"{one}{packed}" for one in MRC for packed in ("", ".gz", ".bz2")), mrc_header),
}
"""Readers of the headers of formats that consist of a header and values, by the ending."""

BRICKED = ".raw .mhd .mha .nrrd .nhdr .nii .mrc .fits .vti .npy .h5 .nc .zarr .n5 .bp .tif (or a folder of .tif)"
"""Formats of which bricks can be read, if the values are stored as they are or in chunks."""


def open_bricks(
    path: str | Path,
    dims: Sequence[int] | None = None,
    dtype: DTypeLike | None = None,
    spacing: Sequence[float] | None = None,
    origin: Sequence[float] | None = None,
    array: str | None = None,
    choice: Choice = Choice(),  # noqa: B008 - frozen
    whole: bool = False,
) -> Source | None:
    """Open a volume for bricked access; nothing but its header is read.

    Args:
        path: A file or folder of one of the formats in :data:`BRICKED`.
        dims: Number of points along x, y, z, for raw files only; by default taken from the file name.
        dtype: Type of a raw file's values; by default taken from the file name.
        spacing: Spacing (x, y, z) in world units that overrides the file's.
        origin: Origin (x, y, z) in world units that overrides the file's.
        array: Name of the array, dataset, group or image, if there are several.
        choice: The channel and the time point that are shown of a file with several.
        whole: Open it for being read as a whole: what is compressed is decoded then, and formats of VTK are left to it.

    Returns:
        The volume, or None if bricks cannot be read of this file.

    Raises:
        BadInput: The file does not exist or is damaged, or an argument does not fit it.
    """
    file = Path(path)
    if not file.exists():
        raise BadInput(f"There is no volume {file}; check the path.")
    try:
        source = _opened(file, (dims, dtype), array, choice, whole)
    except OSError as error:
        raise BadInput(f"Cannot read {file}: {error.strerror or error}.") from error
    if source is not None and source.planes is not None and not whole:
        return None  # uneven planes are resampled
    if source is None or (spacing is None and origin is None):
        return source
    if spacing is not None:
        source.assumed = None
    source.levels = [_moved(level, source.levels[0], spacing, origin, source.name) for level in source.levels]
    return source


def _opened(
    file: Path, raw: tuple[Sequence[int] | None, DTypeLike | None], array: str | None, choice: Choice, whole: bool
) -> Source | None:
    name = file.name.lower()
    if file.is_dir():
        return _opened_folder(file, array, choice, whole)
    if file.stat().st_size == 0:
        raise BadInput(f"{file} is empty.")
    if name.endswith(HDF5) or (name.endswith((*NETCDF, *HDF5_INSIDE)) and is_hdf5(file)):
        return open_hdf5(file, choice, array)
    if name.endswith(NETCDF):
        return open_netcdf(file, choice, array)
    if name.endswith(".xml") and (found := described(file)):
        return open_hdf5(found[1], choice, array)
    if name.endswith(TIFF):
        return open_tiff(file, choice, array, whole)
    if raw == (None, None) and is_dicom(file):
        return open_dicom(file, choice, array) if whole else None
    if par := par_of(file):
        check_array(array, file.stem, file)
        return open_par(par, choice) if whole else None
    if header := header_reader(file):
        stored = header(file)
        check_array(array, stored.title, file)
        return stored.source(choice, whole)
    if name.endswith(ZARR_ZIP):
        return open_zarr(file, choice, array)
    if name.endswith(".npz"):
        check_alone(choice, file)
        if not whole:
            return None
        archived = open_npz(file, array)
        archived.assumed = no_size(file.name)
        return archived
    if name.endswith(ADIOS):
        return open_bp(file, choice, array)
    if name.endswith(FITS):
        return open_fits(file, choice, array, whole)
    if name.endswith(".mnc"):
        check_array(array, file.stem, file)
        return open_minc(file, choice)
    if name.endswith(".vti"):
        check_alone(choice, file)
        return None if whole else open_vti(file, array)
    if name.endswith(RAW) and raw == (None, None) and is_tecplot(file):
        return None
    if name.endswith((".npy", *RAW)) or raw != (None, None):
        check_alone(choice, file)
        check_array(array, file.stem, file)
        if name.endswith(".npy"):
            source = open_npy(file)
        else:
            size, kind = raw_layout(file, *raw)
            source = mapped(file, 0, kind, size[::-1], np.eye(3), (0.0, 0.0, 0.0))
        source.assumed = no_size(file.name)
        return source
    return None


def _opened_folder(folder: Path, array: str | None, choice: Choice, whole: bool) -> Source | None:
    if is_zarr(folder):
        return open_zarr(folder, choice, array)
    if is_n5(folder):
        return open_n5(folder, choice, array)
    if is_bp(folder):
        return open_bp(folder, choice, array)
    tiff = any(f.suffix.lower() in TIFF for f in folder.iterdir())
    if not tiff and whole and is_dicom(folder):
        return open_dicom(folder, choice, array)
    return open_tiff(folder, choice, array, whole) if tiff else None


def header_reader(file: Path) -> Callable[[Path], Stored] | None:
    """Return the reader of the header of a file, if its format has one."""
    name = file.name.lower()
    if name.endswith(".dat") and is_dat_header(file):
        return dat_header
    if par_of(file):
        return None
    return next((read for ending, read in HEADERS.items() if name.endswith(ending)), None)


def data_files(file: Path) -> list[Path]:
    """Return the other files that a header refers to, such as the ``.raw`` file of an ``.mhd``.

    So do the two files of BigDataViewer. A damaged header refers to none: reading it tells what is wrong.
    """
    if file.suffix.lower() == ".xml" and file.is_file():
        found = described(file)
        return [] if found is None or not found[1].is_file() else [found[1]]
    if file.name.lower().endswith(HDF5):
        return [about for about in (file.with_suffix(".xml"),) if about.is_file()]
    if file.name.lower().endswith(ADIOS) and file.is_file():  # whose values are in a folder
        return sorted(one for one in file.with_name(f"{file.name}.dir").glob("*") if one.is_file())
    read = header_reader(file) if file.is_file() else None
    try:
        return [] if read is None else [other for other in read(file).files if other != file and other.is_file()]
    except BadInput:
        return []


def check_array(array: str | None, title: str, file: Path) -> None:
    """Raise BadInput if an array is asked for that a file with a single array does not have."""
    if array not in (None, title):
        raise BadInput(f"{file.name} has no array '{array}'; it has {title}.")


def _moved(
    level: Level, finest: Level, spacing: Sequence[float] | None, origin: Sequence[float] | None, name: str
) -> Level:
    """Return a level of a volume whose finest level gets another spacing or origin."""
    for values in (spacing, origin):
        if values is not None and len(values) != 3:
            raise BadInput(f"Spacing and origin need three numbers (x, y, z), not {values}.")
    scale = np.ones(3) if spacing is None else np.asarray(spacing, float) / finest.spacing
    shift = np.linalg.solve(finest.axes, level.origin - finest.origin)  # in voxels of the finest level
    axes = finest.axes * scale
    start = finest.origin if origin is None else np.asarray(origin, float)
    return level_of(level.shape, level.axes * scale, start + axes @ shift, name)
