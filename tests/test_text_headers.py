"""Headers that are text beside raw values: BOV of VisIt, ``.dat`` of Inviwo and Voreen, ``.vgi`` of VGStudio."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from svv.bricks.opened import open_bricks
from svv.dvr.read.volumes import read_here
from svv.errors import BadInput
from tests.damage import assert_cut_files_are_refused, assert_wrong_headers_are_refused
from tests.ell_volume import FIRST, STEP, assert_shown, ell

SIDES = np.array([22, 18, 14])

BOV = """TIME: 1.5
# what VisIt's manual shows
DATA_FILE: l.values
DATA_SIZE: 22 18 14
DATA_FORMAT: {kind}
VARIABLE: density
DATA_ENDIAN: {endian}
CENTERING: {centering}
BRICK_ORIGIN: {origin}
BRICK_SIZE: {size}
"""

INVIWO = """RawFile: l.raw
Resolution: 22 18 14
Format: {kind}
ByteOffset: 0
BasisVector1: {0} 0 0
BasisVector2: 0 {1} 0
BasisVector3: 0 0 {2}
Offset: {3}
WorldVector1: 1 0 0 0
WorldVector2: 0 1 0 0
WorldVector3: 0 0 1 0
WorldVector4: 0 0 0 1
DataRange: 0 200
ValueRange: 0 200
Unit: arbitrary # a comment
"""

VGI = """{{volume1}}
[representation]
size = 22 18 14
mirror = 0 0 0
datatype = {kind}
datarange = 0 -1
bitsperelement = {bits}
[file1]
SkipHeader = {skip}
FileFormat = raw
Size = 22 18 14
Name = {name}
Datatype = {kind}
BitsPerElement = {bits}
{{volumeprimitive1}}
[geometry]
resolution = 1.5 2 3
unit = mm
[volume]
volume = volume1
"""


def text(numbers: np.ndarray) -> str:
    """Numbers as headers write them."""
    return " ".join(f"{number:g}" for number in numbers)


def bov(
    folder: Path, kind: str = "FLOAT", endian: str = "LITTLE", centering: str = "nodal", packed: bool = False
) -> Path:
    """Write an L as a brick of values."""
    letter = {"FLOAT": "f4", "DOUBLES": "f8", "SHORT": "i2", "INT": "i4", "BYTE": "u1"}[kind]
    on_cells = centering == "zonal"
    told = BOV.format(
        kind=kind, endian=endian, centering=centering, origin=text(FIRST - 0.5 * STEP * on_cells),
        size=text(STEP * (SIDES if on_cells else SIDES - 1)),
    )  # fmt: skip
    content = ell({"BIG": ">", "LITTLE": "<"}[endian] + letter).tobytes()
    name = "l.values.gz" if packed else "l.values"
    (folder / name).write_bytes(gzip.compress(content) if packed else content)
    (folder / "l.bov").write_text(told.replace("l.values", name))
    return folder / "l.bov"


@pytest.mark.parametrize("kind", ["FLOAT", "DOUBLES", "SHORT", "INT", "BYTE"])
@pytest.mark.parametrize("endian", ["LITTLE", "BIG"])
def test_bricks_of_values_on_points_and_cells(tmp_path: Path, kind: str, endian: str) -> None:
    for centering in ("nodal", "zonal"):
        file = bov(tmp_path, kind, endian, centering)
        assert_shown(file)
        assert open_bricks(file) is not None
    assert_shown(bov(tmp_path, kind, endian, packed=True))


def test_components_of_a_brick_are_channels(tmp_path: Path) -> None:
    file = bov(tmp_path)
    file.write_text(
        file.read_text() + "DATA_COMPONENTS: 2\nBYTE_OFFSET: 4\nDIVIDE_BRICK: true\nDATA_BRICKLETS: 11 9 7\n"
    )
    (tmp_path / "l.values").write_bytes(b"\7" * 4 + np.stack([ell(), 3 * ell()], axis=-1).tobytes())
    assert_shown(file, channel="1", factor=3.0)
    file.write_text(file.read_text().replace("l.values", "l%04d.values"))
    with pytest.raises(BadInput, match="in several files"):
        read_here(file)


def test_without_a_size_a_voxel_is_said_to_be_one(tmp_path: Path) -> None:
    file = bov(tmp_path)
    file.write_text("\n".join(line for line in file.read_text().splitlines() if "BRICK" not in line))
    assert_shown(file, (1, 1, 1), (0, 0, 0), says="no voxel size")


def dat(folder: Path, kind: str = "UINT16") -> Path:
    """Write an L as Inviwo does."""
    corner = FIRST - 0.5 * STEP
    (folder / "l.dat").write_text(INVIWO.format(*(STEP * SIDES), text(corner), kind=kind))
    (folder / "l.raw").write_bytes(ell("<f4" if kind == "FLOAT32" else "<u2").tobytes())
    return folder / "l.dat"


@pytest.mark.parametrize("kind", ["UINT16", "FLOAT32"])
def test_volumes_of_inviwo(tmp_path: Path, kind: str) -> None:
    assert_shown(dat(tmp_path, kind))
    assert open_bricks(tmp_path / "l.dat") is not None


def test_inviwos_world_moves_the_volume(tmp_path: Path) -> None:
    file = dat(tmp_path)
    told = file.read_text().replace("WorldVector1: 1 0 0 0", "WorldVector1: 0 -1 0 5")
    file.write_text(told.replace("WorldVector2: 0 1 0 0", "WorldVector2: 1 0 0 7"))
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert_shown(file, turn * STEP, turn @ FIRST + [5, 7, 0])


def test_inviwos_spacing_centres_the_volume(tmp_path: Path) -> None:
    dat(tmp_path)
    (tmp_path / "l.dat").write_text("RawFile: l.raw\nResolution: 22 18 14\nFormat: UInt16\nSpacing: 1.5 2 3\n")
    assert_shown(tmp_path / "l.dat", first=-0.5 * STEP * (SIDES - 1))


def test_sequences_and_vectors_are_time_points_and_channels(tmp_path: Path) -> None:
    file = dat(tmp_path)
    head = "Rawfile: l.raw\nResolution: 22 18 14\nSpacing: 1.5 2 3\nOffset: 0 0 0\n"
    file.write_text(f"{head}Format: UINT16\nSequences: 2\n")
    (tmp_path / "l.raw").write_bytes(np.stack([ell("u2"), 2 * ell("u2")]).tobytes())
    assert_shown(file, first=0.5 * STEP, time=1, factor=2.0)
    file.write_text(f"{head}Format: Vec2UINT16\n")
    (tmp_path / "l.raw").write_bytes(np.stack([ell("u2"), 2 * ell("u2")], axis=-1).tobytes())
    assert_shown(file, first=0.5 * STEP, channel="1", factor=2.0)
    file.write_text("DatFile: one.dat\nDatFile: two.dat\n")
    with pytest.raises(BadInput, match="a list of other"):
        read_here(file)


@pytest.mark.parametrize(("kind", "letter"), [("USHORT", "u2"), ("USHORT_12", "u2"), ("UCHAR", "u1"), ("FLOAT", "f4")])
def test_volumes_of_voreen(tmp_path: Path, kind: str, letter: str) -> None:
    (tmp_path / "l.raw").write_bytes(ell(letter).tobytes())
    (tmp_path / "l.dat").write_text(
        f"ObjectFileName: l.raw\nResolution: 22 18 14\nSliceThickness: 1.5 2 3\nFormat: {kind}\nObjectModel: I\n"
    )
    assert_shown(tmp_path / "l.dat", first=(0, 0, 0))


@pytest.mark.parametrize(
    ("kind", "bits", "letter"), [("unsigned integer", 16, "u2"), ("float", 32, "f4"), ("unsigned integer", 8, "u1")]
)
def test_volumes_of_vgstudio(tmp_path: Path, kind: str, bits: int, letter: str) -> None:
    (tmp_path / "l.vol").write_bytes(b"\7" * 8 + ell(letter).tobytes())
    file = tmp_path / "l.vgi"
    file.write_text(VGI.format(kind=kind, bits=bits, skip=8, name=r"D:\scans\l.vol"))
    assert_shown(file, first=(0, 0, 0))
    for there, other, says in (("mirror = 0", "mirror = 1", "mirrored"), ("[volume]", "{volume2}", "several volumes")):
        file.write_text(VGI.format(kind=kind, bits=bits, skip=8, name="l.vol").replace(there, other))
        with pytest.raises(BadInput, match=says):
            read_here(file)


def test_damage_is_one_sentence(tmp_path: Path) -> None:
    made = {bov(tmp_path): "l.values", dat(tmp_path): "l.raw"}
    (tmp_path / "l.vgi").write_text(VGI.format(kind="float", bits=32, skip=0, name="l.vol"))
    (tmp_path / "l.vol").write_bytes(ell().tobytes())
    for header, values in {**made, tmp_path / "l.vgi": "l.vol"}.items():
        assert_cut_files_are_refused(tmp_path / values, named=header)
        wrong = [(b"22 18 14", other) for other in (b"-2 18 14", b"99 18 14", b"22 18", b"9999999999 18 14", b"x y z")]
        for pair in wrong:
            whole = header.read_bytes()
            header.write_bytes(whole.replace(*pair))
            with pytest.raises(BadInput) as caught:
                read_here(header)
            assert "\n" not in str(caught.value)
            header.write_bytes(whole)
    assert_wrong_headers_are_refused(
        tmp_path / "l.bov", {b"FLOAT": b"TRIPLE", b"BRICK_SIZE: 31.5": b"BRICK_SIZE: nan", b"l.values": b"none.values"}
    )
    assert_wrong_headers_are_refused(
        tmp_path / "l.dat",
        {b"UINT16": b"WORDS", b"BasisVector1: 33.0 0 0": b"BasisVector1: 33.0", b"l.raw": b"none.raw"},
    )
    assert_wrong_headers_are_refused(
        tmp_path / "l.vgi",
        {b"Datatype = float": b"Datatype = words", b"= 1.5 2 3": b"= nan 2 3", b"l.vol": b"none.vol"},
    )
