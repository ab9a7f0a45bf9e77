"""DICOM: folders of slices, whatever their names, and files with several frames, placed as DICOM places them.

Coordinates are the patient's in mm: x to the left, y to the back, z upwards, as in ITK. pydicom decodes.

Source: DICOM PS3.3, C.7.6.2 (image plane) and C.7.6.16 (multi-frame functional groups).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from svv.bricks.formats.axes import Choice, picked
from svv.bricks.formats.chunked import package
from svv.bricks.formats.places import no_size
from svv.bricks.formats.source import ORTHOGONAL_TOLERANCE, Array, ArraySource, level_of
from svv.bricks.formats.stored import damaged
from svv.errors import BadInput

if TYPE_CHECKING:
    from pydicom import Dataset

ENDINGS = (".dcm", ".dicom", ".ima")
"""Endings of DICOM files, which most of them lack."""

EVEN = 0.01
"""Largest deviation of the distance of two slices from the mean, as a fraction of it: positions are rounded."""

NEARLY_EVEN = 0.05
"""The same for scanners that place slices less exactly; the volume is even then, and says so."""


@dataclass(frozen=True, eq=False)
class Slice:
    """A frame of a file."""

    data: Dataset
    """What it tells, without pixels."""
    file: Path
    frame: int
    position: Array | None
    """World position of the first pixel. (3,)"""
    plane: Array | None
    """Unit vectors along a row and along a column of pixels. (2, 3)"""
    pixel: tuple[float, float]
    """Distances of pixels along a row and along a column."""
    scale: tuple[float, float]
    """Slope and intercept of its values."""
    order: tuple[int, int, int]
    """Numbers that tell slices at the same place apart."""


def is_dicom(path: Path) -> bool:
    """Return whether a file is a DICOM file, or a folder has one."""
    if path.is_dir():
        return any(is_dicom(file) for file in sorted(path.iterdir()) if file.is_file())
    if path.name.lower().endswith(ENDINGS):
        return True
    with path.open("rb") as opened:
        return opened.read(132)[128:] == b"DICM"


def open_dicom(path: Path, choice: Choice = Choice(), array: str | None = None) -> ArraySource:  # noqa: B008 - frozen
    """Read a series of slices, or a file with several frames.

    Args:
        path: The folder, or the file.
        choice: The time point that is shown, if there are several slices at the same places.
        array: The series, if the folder has several: its number, description or UID.

    Raises:
        BadInput: Files are damaged or compressed in a way that needs a further package; there are several series or
            time points of which none is chosen; slices differ in size or direction, or lie at uneven distances; or
            pydicom is not installed.
    """
    pydicom = package("pydicom", path)
    try:
        return _read(pydicom, path, choice, array)
    except BadInput:
        raise
    except Exception as error:  # damaged files make pydicom raise all kinds of errors, whenever a value is asked for
        raise damaged(path) from error


def _read(pydicom: ModuleType, path: Path, choice: Choice, array: str | None) -> ArraySource:
    files = sorted(f for f in path.iterdir() if f.is_file() and is_dicom(f)) if path.is_dir() else [path]
    heads = [(file, pydicom.dcmread(file, stop_before_pixels=True, force=True)) for file in files]
    heads = [(file, head) for file, head in heads if "Rows" in head and "Columns" in head]
    if not heads:
        raise damaged(path) if path.is_file() else BadInput(f"The folder {path} contains no DICOM pictures.")
    slices = [one for file, head in _series(path, heads, array) for one in _frames(file, head)]
    if len(slices) == 1:
        raise BadInput(f"{path} is a single slice: name the folder with all slices of its series.")
    steps, places, said = _stacked(slices, path)
    time = picked("tzyx", (len(places[0]), 2, 2, 2), choice, path.name).fixed[0] or 0
    shown = [place[time] for place in places]
    origin = shown[0].position if shown[0].position is not None else np.zeros(3)
    level_of((len(shown), int(shown[0].data.Rows), int(shown[0].data.Columns)), steps, origin, path.name)
    source = ArraySource(_values(pydicom, shown), steps, origin, path.name)
    without = _unsized(shown[0])
    unsized = no_size(path.name, without, np.linalg.norm(steps, axis=0)) if without else ""
    source.assumed = " ".join(filter(None, (unsized, said))) or None
    return source


def _unsized(one: Slice) -> str:
    """Return the axes among x, y, z along which a slice tells no size of a voxel."""
    keys = {element.keyword for element in one.data.iterall() if not element.is_empty}
    between = one.position is not None or keys & {"SpacingBetweenSlices", "SliceThickness"}
    return ("" if "PixelSpacing" in keys else "xy") + ("" if between else "z")


def _series(path: Path, heads: Sequence[tuple[Path, Dataset]], array: str | None) -> list[tuple[Path, Dataset]]:
    """Return the files of the series that is shown."""
    groups: dict[str, list[tuple[Path, Dataset]]] = {}
    for file, head in heads:
        groups.setdefault(str(head.get("SeriesInstanceUID", "")), []).append((file, head))
    names = [str(group[0][1].get("SeriesDescription", "") or "unnamed") for group in groups.values()]
    listed = ", ".join(
        f"{k} {name} ({len(group)} files)" for k, (name, group) in enumerate(zip(names, groups.values()))
    )
    if array is None and len(groups) == 1:
        return next(iter(groups.values()))
    if array is None:
        raise BadInput(f"{path} holds {len(groups)} series ({listed}): choose one with --array, by its number.")
    for k, (uid, group) in enumerate(groups.items()):
        if array in (str(k), uid) or (array == names[k] and names.count(array) == 1):
            return group
    raise BadInput(f"{path} has no series '{array}'; it has {listed}.")


def _frames(file: Path, head: Dataset) -> list[Slice]:
    """Return the frames of a file."""
    if int(head.get("SamplesPerPixel", 1)) != 1 or head.get("PhotometricInterpretation") == "PALETTE COLOR":
        raise BadInput(f"{file} is a picture in colours; a volume needs one number per voxel.")
    return [_frame(file, head, k) for k in range(_count(head))]


def _frame(file: Path, head: Dataset, number: int) -> Slice:
    own = head.PerFrameFunctionalGroupsSequence[number] if "PerFrameFunctionalGroupsSequence" in head else None
    shared = head.SharedFunctionalGroupsSequence[0] if "SharedFunctionalGroupsSequence" in head else None

    def found(group: str, key: str) -> Any:
        for place in (own, shared):
            if place is not None and group in place and key in place[group][0]:
                return place[group][0][key].value
        return head.get(key)

    position = found("PlanePositionSequence", "ImagePositionPatient")
    plane = found("PlaneOrientationSequence", "ImageOrientationPatient")
    rows, columns = (float(x) for x in found("PixelMeasuresSequence", "PixelSpacing") or (1.0, 1.0))
    slope = found("PixelValueTransformationSequence", "RescaleSlope")
    shift = found("PixelValueTransformationSequence", "RescaleIntercept")
    place = None if position is None else np.array([float(x) for x in position])
    unit = None if plane is None else np.array([float(x) for x in plane]).reshape(2, 3)
    if own is None and place is not None and _count(head) > 1:
        offsets = head.get("GridFrameOffsetVector")
        gap = float(head.get("SpacingBetweenSlices") or head.get("SliceThickness") or 1.0)
        normal = np.array([0.0, 0.0, 1.0]) if unit is None else np.cross(unit[0], unit[1])
        place = place + normal * (gap * number if offsets is None else float(offsets[number]))
    order = (head.get("TemporalPositionIdentifier"), head.get("AcquisitionNumber"), head.get("InstanceNumber"))
    return Slice(
        head, file, number, place, unit, (columns, rows),
        (1.0 if slope is None else float(slope), 0.0 if shift is None else float(shift)),
        (int(order[0] or 0), int(order[1] or 0), int(order[2] or 0) + number),
    )  # fmt: skip


def _stacked(slices: Sequence[Slice], path: Path) -> tuple[Array, list[list[Slice]], str]:
    """Return the steps between voxels (3, 3), the slices at each place and time in order, and what is assumed."""
    first = slices[0]
    for one in slices:
        same = (one.data.Rows, one.data.Columns) == (first.data.Rows, first.data.Columns)
        turned = one.plane is not None and first.plane is not None and np.abs(one.plane - first.plane).max() > 1e-3
        if not same or turned or not np.allclose(one.pixel, first.pixel, rtol=1e-3):
            raise BadInput(
                f"{one.file} differs in size or direction from {first.file.name}: the slices of a volume have the "
                "same; keep those that belong together in a folder of their own."
            )
    plane = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]) if first.plane is None else first.plane
    plane = plane / np.linalg.norm(plane, axis=1, keepdims=True)
    normal = np.cross(plane[0], plane[1])
    if any(one.position is None for one in slices):
        gap = float(first.data.get("SpacingBetweenSlices") or first.data.get("SliceThickness") or 1.0)
        places = [[one] for one in sorted(slices, key=lambda one: one.order)]
        return np.array([plane[0] * first.pixel[0], plane[1] * first.pixel[1], normal * gap]).T, places, ""
    along = np.array([float(one.position @ normal) for one in slices])
    extent = float(np.ptp(along)) or 1.0
    keys = np.round((along - along.min()) / extent * 1e6).astype(int)
    there: dict[int, list[Slice]] = {}
    for key, one in sorted(zip(keys.tolist(), slices), key=lambda pair: (pair[0], pair[1].order)):
        there.setdefault(key, []).append(one)
    places = list(there.values())
    if len({len(place) for place in places}) != 1:
        raise BadInput(f"{path} has places with several slices and others with one: keep one volume in the folder.")
    if len(places) < 2:
        raise BadInput(f"{path} has all its slices at the same place; a volume needs at least 2 places.")
    points = np.array([place[0].position for place in places])
    step = (points[-1] - points[0]) / (len(points) - 1)
    uneven = np.linalg.norm(np.diff(points, axis=0) - step, axis=1).max() / float(np.linalg.norm(step))
    apart = np.abs(points - points[0] - step * np.arange(len(points))[:, None]).max() / float(np.linalg.norm(step))
    distances, said = np.linalg.norm(np.diff(points, axis=0), axis=1), ""
    if uneven > NEARLY_EVEN or apart > NEARLY_EVEN:
        raise _uneven(path, [place[0] for place in places], distances)
    if uneven > EVEN:
        said = f"{path.name}: slices {distances.min():.4g} to {distances.max():.4g} mm apart are taken as even."
    tilt = np.degrees(np.arccos(min(abs(float(step @ normal)) / float(np.linalg.norm(step)), 1.0)))
    if np.sin(np.radians(tilt)) > ORTHOGONAL_TOLERANCE:
        raise BadInput(
            f"{path} was scanned with a tilted gantry ({tilt:.1f} degrees): every slice is shifted against the one "
            "before, which makes a sheared grid whose axes are not perpendicular. Straighten it first: dcm2niix writes "
            "a NIfTI file with Tilt in its name, and 3D Slicer has Acquisition geometry regularization."
        )
    return np.array([plane[0] * first.pixel[0], plane[1] * first.pixel[1], step]).T, places, said


def _uneven(path: Path, slices: Sequence[Slice], gaps: Array) -> BadInput:
    """Return the error to raise for slices that are not evenly spaced, which says where some are missing."""
    usual = float(np.median(gaps))
    missing = np.rint(gaps / usual).astype(int) - 1
    said = f"{path} has slices at uneven distances ({gaps.min():g} to {gaps.max():g} mm)"
    if missing.min() < 0 or not missing.any() or np.abs(gaps / usual - missing - 1).max() > NEARLY_EVEN:
        return BadInput(f"{said}: resample the volume to even ones first, such as in 3D Slicer.")
    names = [one.file.name + (f" (frame {one.frame})" if _count(one.data) > 1 else "") for one in slices]
    places = [f"{n} between {names[k]} and {names[k + 1]}" for k, n in enumerate(missing) if n]
    listed = ", ".join(places[:5]) + (f", and at {len(places) - 5} more places" if len(places) > 5 else "")
    verb = "slice is" if missing.sum() == 1 else "slices are"
    return BadInput(f"{said}: {missing.sum()} {verb} missing, {listed}. Add what is missing, or resample it first.")


def _count(head: Dataset) -> int:
    """Return the number of frames of a file."""
    return int(head.get("NumberOfFrames", 1) or 1)


def _values(pydicom: ModuleType, slices: Sequence[Slice]) -> NDArray[np.generic]:
    """Decode the slices. (nz, ny, nx)"""
    read: tuple[Path | None, NDArray[np.generic]] = (None, np.empty(0))
    stored = []
    for one in slices:
        if read[0] != one.file:
            try:
                data = pydicom.dcmread(one.file, force=True)
                for key, default in (("SamplesPerPixel", 1), ("PhotometricInterpretation", "MONOCHROME2")):
                    if key not in data:  # some programs leave out what the standard asks for
                        setattr(data, key, default)
                read = one.file, data.pixel_array
            except Exception as error:  # codecs raise errors of all kinds
                said = str(error).strip().splitlines()
                raise BadInput(
                    f"Cannot read {one.file}: {(said[0] if said else 'it is damaged').rstrip('.:')}."
                ) from error
        stored.append(read[1][one.frame] if read[1].ndim == 3 else read[1])
    scales = {one.scale for one in slices}
    values = np.stack(stored)
    if scales == {(1.0, 0.0)}:
        return values
    slopes, shifts = (np.array([one.scale[k] for one in slices])[:, None, None] for k in (0, 1))
    if all(slope == 1.0 and shift == int(shift) for slope, shift in scales):
        whole = values.astype(np.int64) + shifts.astype(np.int64)
        fits = np.iinfo(np.int16).min <= whole.min() and whole.max() <= np.iinfo(np.int16).max
        return whole.astype(np.int16 if fits else np.int32)
    real: NDArray[np.float64] = values * slopes + shifts
    fine = values.dtype.itemsize <= 2 and all(abs(shift) <= 65536.0 * abs(slope) for slope, shift in scales)
    return real.astype(np.float32) if fine else real
