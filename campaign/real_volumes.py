"""Real volumes, read beside the libraries that their users trust, and trained: ``python -m campaign.real_volumes``.

Every file below a folder is read by svv, in a process of its own, and by the reference library of its format: values
and places have to agree. With ``--train``, views of it are drawn and trained by the preset ``draft``, and scored on
views that were not trained on. The page that is written lists them all, the worst first.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

LIMIT = 300.0
"""Seconds after which a file counts as one that does not end."""

Reference = tuple[NDArray[Any], NDArray[np.float64] | None]
"""Values by z, y, x, and the matrix from the index (x, y, z) to the world, if the library tells it. (4, 4)"""


@dataclass
class Found:
    """What became of a file."""

    file: str
    kind: str
    outcome: str
    """``right``, ``read`` (without a reference), ``refused`` or ``wrong``."""
    said: str = ""
    shape: str = ""
    stored: str = ""
    read_seconds: float = 0.0
    psnr: float | None = None
    train_seconds: float | None = None
    peak_mb: float = 0.0


def by_nibabel(file: Path, time_point: int) -> Reference:
    """NIfTI, Analyze, FreeSurfer, AFNI and MINC."""
    import nibabel

    image = nibabel.load(str(file))
    values = np.asarray(image.dataobj)
    affine: NDArray[np.float64] | None
    if type(image).__name__.startswith("Minc"):  # values by z, y, x, and the matrix for that order
        values, affine = values.T, np.asarray(image.affine)[:, [2, 1, 0, 3]]
    else:
        affine = np.asarray(image.affine)
    if isinstance(image, nibabel.Nifti1Image) and not (image.header["qform_code"] or image.header["sform_code"]):
        affine = None  # a guess of nibabel's
    while values.ndim > 3:
        values = values[..., time_point if values.ndim == 4 else 0]
    return values.T, affine


def by_mrcfile(file: Path, time_point: int) -> Reference:
    """Maps, with columns, rows and sections on the axes that the header names."""
    import mrcfile

    with mrcfile.open(str(file), permissive=True) as opened:
        head, values = opened.header, np.array(opened.data)
        order = [int(head.maps) - 1, int(head.mapr) - 1, int(head.mapc) - 1]  # axes (x 0, y 1, z 2) of the stored ones
        values = values.transpose([order.index(axis) for axis in (2, 1, 0)])
        sizes = np.array([float(opened.voxel_size[axis]) for axis in "xyz"])
    return values, np.diag([*sizes, 1.0]) if sizes.all() else None


def by_simpleitk(file: Path, time_point: int) -> Reference:
    """MetaImage and NRRD; spaces of NRRD are turned by ITK, so only values are compared."""
    import SimpleITK

    return SimpleITK.GetArrayFromImage(SimpleITK.ReadImage(str(file))), None


def by_astropy(file: Path, time_point: int) -> Reference:
    """FITS, without axes of one pixel."""
    from astropy.io import fits

    with fits.open(file) as opened:
        cubes = [one.data for one in opened if one.is_image and one.data is not None and np.squeeze(one.data).ndim >= 3]
        values = np.squeeze(cubes[0])
    return (values[0] if values.ndim == 4 else values), None


def by_numpy(file: Path, time_point: int) -> Reference:
    """Arrays of three axes."""
    loaded = np.load(file, allow_pickle=False)
    if isinstance(loaded, np.ndarray):
        return loaded, None
    return next(loaded[name] for name in loaded.files if loaded[name].ndim == 3), None


def by_tifffile(file: Path, time_point: int) -> Reference:
    """Stacks."""
    import tifffile

    return np.squeeze(tifffile.imread(file)), None


def by_series(file: Path, time_point: int) -> Reference:
    """A folder of slices, as ITK puts them together."""
    import SimpleITK

    names = SimpleITK.ImageSeriesReader.GetGDCMSeriesFileNames(str(file))
    return SimpleITK.GetArrayFromImage(SimpleITK.ReadImage(names)), None


def by_pydicom(file: Path, time_point: int) -> Reference:
    """Frames, rescaled."""
    import pydicom

    dataset = pydicom.dcmread(file)
    if time_point:
        raise ValueError("frames of several times are in no order that pydicom sorts")
    return pydicom.pixels.apply_rescale(dataset.pixel_array, dataset), None


REFERENCES: dict[str, Callable[[Path, int], Reference]] = {
    **dict.fromkeys((".nii", ".nii.gz", ".mgz", ".mgh", ".head", ".mnc", ".hdr", ".img", ".par"), by_nibabel),
    **dict.fromkeys((".mrc", ".map", ".ccp4", ".rec", ".st", ".mrc.gz", ".map.gz", ".ccp4.gz", ".mrc.bz2"), by_mrcfile),
    **dict.fromkeys((".mha", ".mhd", ".nrrd", ".nhdr"), by_simpleitk),
    **dict.fromkeys((".fits", ".fits.gz", ".fits.fz", ".fit"), by_astropy),
    **dict.fromkeys((".npy", ".npz"), by_numpy), **dict.fromkeys((".tif", ".tiff"), by_tifffile), ".dcm": by_pydicom,
    "DICOM": by_series,
}  # fmt: skip
"""Reference readers by the ending."""

OTHERS = (
    ".vti .vtk .vtr .vts .vtu .h5 .hdf5 .hdf .nc .nc4 .emd .hspy .ims .nxs .mat .cube .cub .slc .am .bov .vgi .mif "
    ".mih .mif.gz .xdmf .raw .zip .BRIK.gz"
).split()
"""Endings of formats without a reference here."""


def ending(file: Path) -> str | None:
    """Return the ending by which a file is a candidate; the longest that fits."""
    name = file.name.lower()
    fits = [one for one in (*REFERENCES, *map(str.lower, OTHERS)) if one[0] == "." and name.endswith(one)]
    return max(fits, key=len, default=None)


def read(file: Path) -> tuple[Any, int, list[str]]:
    """Return the image as svv reads it, the time point, and what was chosen of several."""
    from svv.dvr.read.volumes import read_volume
    from svv.errors import BadInput

    chosen: dict[str, Any] = {}
    for _ in range(3):
        try:
            image = read_volume(file, **chosen)
            return image, int(chosen.get("time") or 0), [f"{key} {value}" for key, value in chosen.items()]
        except BadInput as error:
            key = next((k for k in ("time", "channel") if f"--{k}" in str(error) and k not in chosen), None)
            if key is None:
                raise
            chosen[key] = 0
    raise AssertionError("each choice is made once")


def compare(file: Path, kind: str, image: Any, time_point: int) -> tuple[str, str]:
    """Return the outcome, and what differs."""
    from svv.dvr.read.grids import index_to_world, to_array

    if kind not in REFERENCES:
        return "read", ""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            values, matrix = REFERENCES[kind](file, time_point)
    except Exception as error:  # what the reference cannot read proves nothing
        return "read", f"the reference failed: {type(error).__name__}"
    ours = to_array(image)
    values = np.squeeze(values) if values.ndim > 3 else values
    if values.shape != ours.shape:
        return "wrong", f"shape {ours.shape}, the reference {values.shape}"
    if not np.allclose(ours, values, rtol=1e-5, atol=1e-6 * float(np.abs(values).max() or 1.0)):
        return "wrong", f"values differ by up to {float(np.abs(ours - values).max()):g}"
    if matrix is None:
        return "right", ""
    placed = index_to_world(image)
    size = float(np.abs(matrix[:3, :3]).max())
    wholly = kind not in (".mrc", ".map", ".ccp4", ".rec", ".st", ".mrc.gz", ".map.gz", ".ccp4.gz", ".mrc.bz2")
    part = slice(0, 4 if wholly else 3)
    if not np.allclose(placed[:3, part], matrix[:3, part], atol=1e-3 * size, rtol=1e-3):
        return "wrong", "another place or size of voxels"
    return "right", ""


def train(file: Path, image: Any, views: int, side: int) -> tuple[float, float]:
    """Return the PSNR of unseen views and the seconds of training, preset draft."""
    from svv.dvr.draw.views import make_views
    from svv.options.making import ViewOptions
    from svv.train.evaluate import evaluate_scene
    from svv.train.pipeline import train_scene

    options = ViewOptions(n=views, test=8, size=side, mapper="cpu")
    known, unseen = make_views(image, None, options)
    began = time.monotonic()
    scene, _ = train_scene(known, "draft")
    took = time.monotonic() - began
    assert unseen is not None
    return evaluate_scene(scene, unseen).psnr, took


def examine(file: Path, root: Path, views: int, side: int) -> Found:
    """Read, compare and perhaps train one file."""
    from svv.dvr.read.grids import assumed_of, to_array
    from svv.errors import BadInput

    kind = "DICOM" if file.is_dir() else ending(file) or ""
    found = Found(str(file.relative_to(root)), kind, "refused")
    began = time.monotonic()
    try:
        image, time_point, chosen = read(file)
    except BadInput as error:
        found.said = str(error).replace(str(file), file.name).replace(str(root), "")
        return found
    found.read_seconds = round(time.monotonic() - began, 2)
    values = to_array(image)
    found.shape, found.stored = " x ".join(str(side) for side in values.shape[::-1]), values.dtype.name
    if any(one.startswith("channel") for one in chosen):
        found.outcome, said = "read", "references give all channels"
    else:
        found.outcome, said = compare(file, kind, image, time_point)
    found.said = "; ".join(filter(None, (said, *chosen, assumed_of(image))))
    if views and found.outcome != "wrong":
        try:
            psnr, seconds = train(file, image, views, side)
            found.psnr, found.train_seconds = round(psnr, 1), round(seconds, 1)
        except BadInput as error:
            found.said = "; ".join(filter(None, (found.said, f"not trained: {error}")))
    found.peak_mb = round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0)
    return found


SERIES = 10
"""Number of DICOM files in a folder from which they count as slices of one volume."""


def candidates(root: Path) -> Iterator[Path]:
    """Return what may be volumes: no empty files, of AFNI's two the header, and folders of DICOM slices."""
    for file in sorted(root.rglob("*")):
        if file.is_dir() and len(list(file.glob("*.dcm"))) >= SERIES:
            yield file
        elif file.suffix == ".dcm" and len(list(file.parent.glob("*.dcm"))) >= SERIES:
            continue
        elif file.is_file() and file.stat().st_size > 0 and ending(file) and ".brik" not in file.name.lower():
            yield file


def page(found: list[Found], command: str) -> str:
    """Return the page: counts, what is wrong, what is refused and why, and all that was trained, the worst first."""
    count = Counter(one.outcome for one in found)
    kinds = sorted({one.kind for one in found})
    lines = ["# Real volumes", "", f"`{command}`", "", "| format | " + " | ".join(OUTCOMES) + " |"]
    lines += ["|---|" + "---|" * len(OUTCOMES)]
    for kind in [*kinds, "all"]:
        own = Counter(one.outcome for one in found if kind in ("all", one.kind))
        lines.append(f"| {kind} | " + " | ".join(str(own[outcome]) for outcome in OUTCOMES) + " |")
    for outcome in ("wrong", "no end", "refused"):
        if count[outcome]:
            lines += ["", f"## {outcome.capitalize()}", "", "| file | what is said |", "|---|---|"]
            lines += [f"| {one.file} | {one.said} |" for one in found if one.outcome == outcome]
    trained = sorted((one for one in found if one.psnr is not None), key=lambda one: one.psnr or 0.0)
    if trained:
        lines += [
            "",
            "## Trained",
            "",
            "| file | voxels | type | dB | s | MB | assumed |",
            "|---|---|---|---|---|---|---|",
        ]
        for one in trained:
            cells = (one.file, one.shape, one.stored, one.psnr, one.train_seconds, f"{one.peak_mb:g}", one.said)
            lines.append("| " + " | ".join(map(str, cells)) + " |")
    return "\n".join(lines) + "\n"


OUTCOMES = ("right", "read", "refused", "wrong", "no end")
"""What can become of a file, as the page counts it."""


def main() -> int:
    """Examine a folder; 1 if anything was wrong."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="real volumes, at any depth")
    parser.add_argument("--out", type=Path, default=Path("real-volumes.md"), help="the page")
    parser.add_argument("--train", type=int, default=0, metavar="VIEWS", help="train on this many views (0: only read)")
    parser.add_argument("--size", type=int, default=128, help="side of the views in pixels")
    parser.add_argument("--one", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one is not None:
        print("FOUND" + json.dumps(asdict(examine(given.one, given.folder, given.train, given.size))))
        return 0
    found = []
    for file in candidates(given.folder):
        command = [sys.executable, "-m", "campaign.real_volumes", str(given.folder), "--one", str(file)]
        command += ["--train", str(given.train), "--size", str(given.size)]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT)
            line = next((line for line in done.stdout.splitlines() if line.startswith("FOUND")), None)
            one = Found(**json.loads(line[5:])) if line else None
        except subprocess.TimeoutExpired:
            one = Found(str(file.relative_to(given.folder)), ending(file) or "", "no end", f"after {LIMIT:g} s")
        if one is None:
            said = (done.stderr.strip().splitlines() or [f"exit {done.returncode}"])[-1]
            one = Found(str(file.relative_to(given.folder)), ending(file) or "", "wrong", f"no sentence: {said}")
        found.append(one)
        print(f"{one.outcome:8} {one.file}  {one.said[:100]}", flush=True)
        given.out.write_text(page(found, " ".join(["python -m campaign.real_volumes", *sys.argv[1:]])))
    return int(any(one.outcome in ("wrong", "no end") for one in found))


if __name__ == "__main__":
    sys.exit(main())
