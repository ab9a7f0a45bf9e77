"""Images of MRtrix and datasets of AFNI: values, places, time points, channels, and damage."""

from __future__ import annotations

import gzip
import shutil
import subprocess
from itertools import permutations, product
from pathlib import Path
from typing import Any

import nibabel
import numpy as np
import pytest
from nibabel import parrec

from svv.bricks.opened import open_bricks
from svv.dvr.read.grids import index_to_world, to_array
from svv.dvr.read.volumes import read_here
from svv.errors import BadInput
from tests.damage import assert_cut_files_are_refused, assert_wrong_headers_are_refused
from tests.ell_volume import FIRST, STEP, assert_shown, ell

LAYOUTS = [
    ",".join(sign + str(k) for sign, k in zip(signs, order))
    for order in permutations(range(3))
    for signs in product("+-", repeat=3)
]
"""All 48 ways in which MRtrix lays an image out: the place of each axis among the fastest, and its direction."""


def mif(folder: Path, layout: str = "+0,+1,+2", kind: str = "Float32LE", beside: bool = False, more: str = "") -> Path:
    """Write an L as mrconvert of MRtrix 3.0.3 does."""
    values, placed = ell().transpose(), [(word[0], int(word[1:])) for word in layout.split(",")]
    turned = values[tuple(slice(None, None, -1 if sign == "-" else 1) for sign, _ in placed)]
    stored = turned.transpose(sorted(range(3), key=lambda k: -placed[k][1]))
    order = {"LE": "<", "BE": ">"}.get(kind[-2:], "<")
    numpy_kind = np.dtype(order + {"Float32": "f4", "Float64": "f8", "Int16": "i2", "UInt8": "u1"}[kind.rstrip("LBE")])
    head = (
        f"mrtrix image\ndim: 22,18,14\nvox: 1.5,2,3\nlayout: {layout}\ndatatype: {kind}\ntransform: 1, 0, 0, 10\n"
        f"transform: 0, 1, 0, 20\ntransform: 0, 0, 1, 30\n{more}command_history: mrconvert a.nii a.mif\n"
    )
    content = np.ascontiguousarray(stored).astype(numpy_kind).tobytes()
    if beside:
        (folder / "a.dat").write_bytes(content)
        (folder / "a.mih").write_text(f"{head}file: a.dat\n")
        return folder / "a.mih"
    start = len(head) + 40
    (folder / "a.mif").write_bytes(f"{head}file: . {start}\nEND\n".encode().ljust(start, b"\0") + content)
    return folder / "a.mif"


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_of_mrtrix_is_in_its_place(tmp_path: Path, layout: str) -> None:
    file = mif(tmp_path, layout)
    assert_shown(file)
    assert open_bricks(file) is not None


@pytest.mark.parametrize("kind", ["Float64BE", "Int16LE", "Int16BE", "UInt8"])
def test_types_and_files_of_mrtrix(tmp_path: Path, kind: str) -> None:
    assert_shown(mif(tmp_path, "-1,+2,-0", kind, beside=True))
    file = mif(tmp_path, kind=kind)
    packed = tmp_path / "b.mif.gz"
    packed.write_bytes(gzip.compress(file.read_bytes()))
    assert_shown(packed)
    assert_shown(mif(tmp_path, kind=kind, more="scaling: 5,2\n"), factor=2.0, background=5.0)


@pytest.mark.skipif(shutil.which("mrconvert") is None, reason="MRtrix is not installed")
@pytest.mark.parametrize("strides", ["1,2,3", "-1,-2,3", "3,1,2", "-3,2,-1"])
def test_what_mrtrix_itself_writes(tmp_path: Path, strides: str) -> None:
    place = np.diag([*STEP, 1.0])
    place[:3, 3] = FIRST
    nibabel.save(nibabel.Nifti1Image(ell().T.copy(), place), tmp_path / "a.nii")
    for name in ("a.mif", "a.mih", "a.mif.gz"):
        made = ["mrconvert", "-quiet", "-force", "-strides", strides, str(tmp_path / "a.nii"), str(tmp_path / name)]
        subprocess.run(made, check=True)
        assert_shown(tmp_path / name)


def test_damaged_images_of_mrtrix_are_one_sentence(tmp_path: Path) -> None:
    file = mif(tmp_path)
    assert_cut_files_are_refused(file)
    wrong = {
        b"dim: 22,18,14": b"dim: 99,18,14", b"vox: 1.5": b"vox: nan", b"22,18": b"-2,18", b"+0,+1": b"+1,+1",
        b"Float32LE": b"CFloat32LE", b"transform: 1, 0": b"transform: 1, 1", b"layout: +0": b"layouts 0",
        b"file: . ": b"file: . 9", b"dim: 22": b"dim: 9999999999",
    }  # fmt: skip
    assert_wrong_headers_are_refused(file, wrong)
    beside = mif(tmp_path, beside=True)
    assert_cut_files_are_refused(tmp_path / "a.dat", named=beside)
    (tmp_path / "a.dat").unlink()
    with pytest.raises(BadInput, match="does not exist"):
        read_here(beside)


def afni(folder: Path, stored: np.ndarray, gains: list[float], series: bool = False, packed: bool = False) -> Path:
    """Write sub-bricks (n, z, y, x) as AFNI does: a text of attributes beside the values."""
    count, (z, y, x) = len(stored), stored.shape[1:]
    kind = {"uint8": 0, "int16": 1, "float32": 3}[stored.dtype.name]
    place = np.hstack([np.diag(STEP) * [[-1], [-1], [1]], (FIRST * [-1, -1, 1])[:, None]])  # x to the left, y back
    told: dict[str, tuple[str, Any]] = {
        "DATASET_RANK": ("integer", [3, count, *[0] * 6]), "DATASET_DIMENSIONS": ("integer", [x, y, z, 0, 0]),
        "TYPESTRING": ("string", "3DIM_HEAD_ANAT"), "SCENE_DATA": ("integer", [0, 2, 0, *[-999] * 5]),
        "ORIENT_SPECIFIC": ("integer", [1, 2, 4]), "ORIGIN": ("float", FIRST * [-1, -1, 1]),
        "DELTA": ("float", STEP * [-1, -1, 1]), "BRICK_TYPES": ("integer", [kind] * count),
        "BRICK_FLOAT_FACS": ("float", gains), "BYTEORDER_STRING": ("string", "LSB_FIRST"),
        "BRICK_LABS": ("string", "~".join(f"part{k}" for k in range(count))),
        "IJK_TO_DICOM_REAL": ("float", place.ravel()),
    }  # fmt: skip
    if series:
        told["TAXIS_NUMS"] = ("integer", [count, 0, 77002, *[-999] * 5])
    lines = []
    for name, (sort, value) in told.items():
        text = f"'{value}~" if sort == "string" else " " + " ".join(f"{number:g}" for number in value)
        size = len(value) + 1 if sort == "string" else len(value)
        lines.append(f"\ntype = {sort}-attribute\nname = {name}\ncount = {size}\n{text}\n")
    (folder / "a+orig.HEAD").write_text("".join(lines))
    brik = folder / ("a+orig.BRIK.gz" if packed else "a+orig.BRIK")
    brik.write_bytes((gzip.compress if packed else bytes)(stored.astype(stored.dtype.newbyteorder("<")).tobytes()))
    return folder / "a+orig.HEAD"


@pytest.mark.parametrize("kind", ["uint8", "int16", "float32"])
@pytest.mark.parametrize("packed", [False, True])
def test_datasets_of_afni_are_in_their_places(tmp_path: Path, kind: str, packed: bool) -> None:
    file = afni(tmp_path, ell(kind)[None], [0.0], packed=packed)
    assert_shown(file)
    assert (open_bricks(file) is None) == packed, "what is not compressed can be mapped"


def test_parts_of_afni_have_factors_of_their_own(tmp_path: Path) -> None:
    stored = np.stack([ell("i2"), ell("i2")])
    for packed in (False, True):
        file = afni(tmp_path, stored, [0.0, 0.25], packed=packed)  # a factor of 0 means none
        with pytest.raises(BadInput, match=r"part0.*part1.*--channel"):
            read_here(file)
        assert_shown(file, channel="part0")
        assert_shown(file, channel="1", factor=0.25)
        (tmp_path / f"a+orig.BRIK{'.gz' * packed}").unlink()
    assert_shown(afni(tmp_path, stored, [0.0, 0.25], series=True), time=1, factor=0.25)


def test_what_nibabel_ships_is_as_nibabel_reads_it() -> None:
    folder = Path(nibabel.__file__).parent / "tests" / "data"
    for name, how in (("scaled+tlrc", {}), ("example4d+orig", {"time": 2})):
        image = nibabel.load(folder / f"{name}.HEAD")
        shown = read_here(folder / f"{name}.HEAD", **how)
        np.testing.assert_allclose(to_array(shown), np.asarray(image.dataobj[..., how.get("time", 0)]).T, rtol=1e-6)
        np.testing.assert_allclose(index_to_world(shown), image.affine, atol=1e-12)


def test_damaged_datasets_of_afni_are_one_sentence(tmp_path: Path) -> None:
    file = afni(tmp_path, ell("i2")[None], [0.0])
    assert_shown(file)
    assert_shown(tmp_path / "a+orig.BRIK")
    assert_cut_files_are_refused(tmp_path / "a+orig.BRIK", named=file)
    assert_wrong_headers_are_refused(
        file, {b" 22 18 14 0 0": b" 99 18 14 0 0", b" 22 18": b" -2 18", b"\n -1.5 -0 -0": b"\n nan -0 -0"}
    )
    file.rename(tmp_path / "b+orig.HEAD")
    for name, says in (("a+orig.BRIK", "needs its header a\\+orig.HEAD"), ("b+orig.HEAD", "needs its values")):
        with pytest.raises(BadInput, match=says):
            read_here(tmp_path / name)


def test_scans_of_philips_are_as_nibabel_reads_them(tmp_path: Path) -> None:
    folder = Path(nibabel.__file__).parent / "tests" / "data"
    for name in ("phantom_EPI_asc_CLEAR_2_1", "phantom_varscale"):
        with (folder / f"{name}.PAR").open() as head, (folder / f"{name}.REC").open("rb") as stored:
            parts = {"header": nibabel.FileHolder(fileobj=head), "image": nibabel.FileHolder(fileobj=stored)}
            image = parrec.PARRECImage.from_file_map(parts)
            values = np.asarray(image.dataobj)
        for ending in (".PAR", ".REC"):
            shown = read_here(folder / f"{name}{ending}", time=2)
            np.testing.assert_allclose(to_array(shown), values[..., 2].T, rtol=1e-6)
            np.testing.assert_allclose(index_to_world(shown), image.affine, atol=1e-9)
    with pytest.raises(BadInput, match="3 time points"):
        read_here(folder / "phantom_varscale.PAR")
    with pytest.raises(BadInput, match="incomplete"):
        read_here(folder / "phantom_truncated.PAR")
    alone = Path(shutil.copy(folder / "phantom_varscale.PAR", tmp_path))
    with pytest.raises(BadInput, match="needs its values"):
        read_here(alone)
    alone.with_suffix(".REC").write_bytes(bytes(1000))
    alone.write_bytes(alone.read_bytes()[:2000])
    with pytest.raises(BadInput, match="damaged"):
        read_here(alone)
