"""BigDataViewer's ``.xml`` beside an HDF5 file: where the file is, and the size of a voxel of each setup."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from svv.core.xml_values import parsed_xml
from svv.errors import BadInput


@dataclass(frozen=True)
class View:
    """What is told about a setup at a time point."""

    size: tuple[float, float, float]
    """Of a voxel, along x, y, z."""
    unit: str
    assumed: str | None
    """What is not applied, in a sentence."""


def described(file: Path) -> tuple[Element, Path] | None:
    """Return the root of a BigDataViewer ``.xml`` and the HDF5 file that it describes; None for another XML file.

    Raises BadInput if it describes images in another format, or no file.
    """
    try:
        root = parsed_xml(file.read_bytes())
    except ValueError:
        return None
    if root.tag != "SpimData":
        return None
    loader = root.find("SequenceDescription/ImageLoader")
    kind, target = ("", None) if loader is None else (loader.get("format", ""), loader.find("hdf5"))
    if target is None or not target.text:
        raise BadInput(
            f"{file} describes images in the format {kind or 'of no name'}, and svv reads bdv.hdf5: save them so in "
            "Fiji, or give the TIFF or Zarr file itself."
        )
    base = root.findtext("BasePath") or "."
    return root, file.parent / base / target.text.strip()


def view_of(file: Path, setup: int, time: int) -> View | None:
    """Return what the ``.xml`` of the same name tells about a view of an HDF5 file; None if there is none.

    Raises BadInput if it is damaged.
    """
    about = file.with_suffix(".xml")
    found = described(about) if about.is_file() else None
    if found is None:
        return None
    root, _ = found
    setups = [one for one in root.iter("ViewSetup") if (one.findtext("id") or "").strip() == str(setup)]
    voxel = None if not setups else setups[0].find("voxelSize")
    if voxel is None:
        return None
    try:
        x, y, z = (float(number) for number in (voxel.findtext("size") or "").split())
        turned = _registration(root, setup, time)
    except ValueError as error:
        raise BadInput(f"Cannot read {about}: its sizes of a voxel or its registrations are damaged.") from error
    tilted = np.abs(turned - np.diag(np.diag(turned))).max() > 1e-6 * np.abs(turned).max()
    said = f"{file.name}: the registration in {about.name}, which turns or shears the view, is not applied."
    return View((x, y, z), (voxel.findtext("unit") or "").strip(), said if tilted else None)


def _registration(root: Element, setup: int, time: int) -> np.ndarray:
    """Return the product of a view's transformations, without their shifts. (3, 3)"""
    product = np.eye(3)
    for one in root.iter("ViewRegistration"):
        if (one.get("setup"), one.get("timepoint")) == (str(setup), str(time)):
            for affine in one.iter("affine"):
                product = product @ np.array([float(x) for x in (affine.text or "").split()]).reshape(3, 4)[:, :3]
    return product
