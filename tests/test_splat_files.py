"""Files of Gaussian splats: against their formats' own words, and read back."""

from __future__ import annotations

import gzip
import json
import resource
import struct
import sys
import zipfile
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from svv.errors import BadInput, Cancelled
from svv.fields.splats.splats import Splats
from svv.render.splats.files import read_splats, write_splats
from svv.render.splats.placing import FAR, Place, place_of

SUFFIXES = (".ply", ".spz", ".glb")
WITH_USD = pytest.param(".usdz", marks=pytest.mark.skipif(not find_spec("pxr"), reason="needs usd-core"))


def some(n: int = 50, harmonics: int = 16, seed: int = 0) -> Splats:
    """Splats of two of three regions about the origin, in a box of 2 units."""
    random = np.random.default_rng(seed)
    turns = random.normal(size=(n, 4))
    arrays = {
        "centres": random.uniform(-1.0, 1.0, (n, 3)),
        "scales": np.exp(random.uniform(-5.0, -1.0, (n, 3))),
        "rotations": turns / np.linalg.norm(turns, axis=1, keepdims=True),
        "opacities": random.uniform(0.0, 1.0, n),
        "harmonics": random.uniform(-0.9, 0.9, (n, harmonics, 3)),
    }
    regions = (np.arange(n) % 2).astype(np.int16)  # nothing of the third
    floats = {name: array.astype(np.float32) for name, array in arrays.items()}
    return Splats(**floats, regions=regions, names=("bone", 'skin "é"\n', "fat"), background=(0.5, 0.25, 1.0))


def one(**changes: object) -> Splats:
    """One splat of four harmonics."""
    return replace(
        Splats(
            centres=np.array([[1.0, -2.0, 0.5]], np.float32), scales=np.exp(np.array([[-2.0, -1.0, 0.0]], np.float32)),
            rotations=np.array([[1.0, 0.0, 0.0, 0.0]], np.float32), opacities=np.array([0.5], np.float32),
            harmonics=np.arange(12, dtype=np.float32).reshape(1, 4, 3) / 16.0, regions=np.zeros(1, np.int16),
            names=("all",), background=(1.0, 1.0, 1.0),
        ), **changes,
    )  # fmt: skip


def moved(splats: Splats, origin: float, unit: float) -> Splats:
    """The same at another place and of another size."""
    centres = (splats.centres.astype(float) * unit + origin).astype(np.float32)
    return replace(splats, centres=centres, scales=(splats.scales * unit).astype(np.float32))


def angles(a: Splats, b: Splats) -> np.ndarray:
    """Angles in radians between the turns of splats, whatever the signs of their quaternions."""
    return 2.0 * np.arccos(np.clip(np.abs((a.rotations.astype(float) * b.rotations).sum(axis=1)), 0.0, 1.0))


@given(
    harmonics=st.sampled_from((1, 4, 9, 16)), seed=st.integers(0, 99), size=st.floats(-12.0, 12.0),
    away=st.floats(0, 3), suffix=st.sampled_from((".ply", ".glb")),
)  # fmt: skip
def test_a_ply_and_a_glb_hold_all(
    tmp_path_factory: pytest.TempPathFactory, harmonics: int, seed: int, size: float, away: float, suffix: str
) -> None:
    splats = moved(some(20, harmonics, seed), 10.0 ** (size + away), 10.0**size)
    path = tmp_path_factory.mktemp("whole") / f"a{suffix}"
    write_splats(path, splats)
    back = read_splats(path)
    furthest = float(np.abs(splats.centres).max())
    np.testing.assert_allclose(back.centres, splats.centres, atol=3e-7 * furthest)
    np.testing.assert_allclose(back.scales, splats.scales, rtol=3e-6)
    assert angles(back, splats).max() < 1e-3
    np.testing.assert_allclose(back.opacities, splats.opacities, atol=2e-6)
    np.testing.assert_array_equal(back.harmonics, splats.harmonics)
    np.testing.assert_array_equal(back.regions, splats.regions)
    assert (back.names, back.background) == (splats.names, splats.background)


@given(harmonics=st.sampled_from((1, 4, 9, 16)), seed=st.integers(0, 99))
def test_a_spz_holds_steps(tmp_path_factory: pytest.TempPathFactory, harmonics: int, seed: int) -> None:
    """What the format says it keeps: fixed points, a 16th of a logarithm, 5, 8 and 10 bits."""
    splats = some(40, harmonics, seed)
    path = tmp_path_factory.mktemp("spz") / "a.spz"
    assert write_splats(path, splats) == []
    back = read_splats(path)
    np.testing.assert_allclose(back.centres, splats.centres, atol=2.0**-20)
    np.testing.assert_allclose(np.log(back.scales), np.log(splats.scales), atol=1.0 / 32 + 1e-5)
    assert angles(back, splats).max() < 0.01
    np.testing.assert_allclose(back.opacities, splats.opacities, atol=1.0 / 510 + 1e-6)
    np.testing.assert_allclose(back.harmonics[:, 0], splats.harmonics[:, 0], atol=0.5 / (0.15 * 255) + 1e-5)
    np.testing.assert_allclose(back.harmonics[:, 1:], splats.harmonics[:, 1:], atol=1.0 / 32 + 1e-6)


def test_a_row_of_a_ply_is_that_of_3dgs(tmp_path: Path) -> None:
    """Positions, colours, coefficients by channel, logit, logarithms, w x y z (Kerbl et al.'s save_ply)."""
    write_splats(tmp_path / "a.ply", one(opacities=np.array([0.75], np.float32)))
    head, body = (tmp_path / "a.ply").read_bytes().split(b"end_header\n")
    names = [line.split()[2] for line in head.decode().splitlines() if line.startswith("property float ")]
    row = dict(zip(names, struct.unpack(f"<{len(names)}f", body), strict=True))
    expected = {"x": 1.0, "y": -2.0, "z": 0.5, "opacity": np.log(3.0), "scale_0": -2.0, "scale_1": -1.0, "scale_2": 0.0}
    expected |= {"rot_0": 1.0, "rot_1": 0.0, "rot_2": 0.0, "rot_3": 0.0, "f_dc_0": 0.0, "f_dc_1": 1 / 16, "region": 0.0}
    expected |= {f"f_rest_{3 * channel + k}": (3 * (k + 1) + channel) / 16 for channel in range(3) for k in range(3)}
    assert {name: row[name] for name in expected} == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("turn", "packed"),
    [
        ((1.0, 0.0, 0.0, 0.0), 0xC0000000),  # w, x, y, z: w is the last of x, y, z, w
        ((0.0, 1.0, 0.0, 0.0), 0x00000000),
        ((0.0, 0.0, -1.0, 0.0), 0x40000000),  # the sign of all is free
        ((0.8, 0.6, 0.0, 0.0), 0xC0000000 | 434 << 20),  # 511 * 0.6 * sqrt(2) = 433.6, 10 bits each
        ((0.8, 0.0, 0.0, -0.6), 0xC0000000 | 512 | 434),
        ((-0.6, 0.0, 0.8, 0.0), 2**30 + 512 + 434),
    ],
)
def test_a_spz_is_what_its_authors_describe(tmp_path: Path, turn: tuple[float, ...], packed: int) -> None:
    write_splats(tmp_path / "a.spz", one(rotations=np.array([turn], np.float32)))
    content = gzip.decompress((tmp_path / "a.spz").read_bytes())
    magic, version, n, degree, bits, flags, reserved = struct.unpack("<IIIBBBB", content[:16])
    assert (magic, version, n, degree, flags, reserved) == (0x5053474E, 3, 1, 1, 0, 0)
    fixed = [int.from_bytes(content[k : k + 3], "little", signed=True) for k in (16, 19, 22)]
    assert [x / 2**bits for x in fixed] == [1.0, -2.0, 0.5]
    alpha, *rest = content[25:]
    assert alpha == 128
    assert rest[:6] == [128, 130, 132, 128, 144, 160]  # 127.5 + 38.25 c, and 16 (10 + log s)
    assert int.from_bytes(bytes(rest[6:10]), "little") == packed
    assert rest[10:] == [128 + 8 * k for k in range(3, 12)]  # by coefficient, then by channel


def test_the_older_quaternions_of_a_spz_are_read(tmp_path: Path) -> None:
    body = bytes(9) + b"\x80" + bytes([128] * 3) + bytes([160] * 3) + bytes([204, 128, 128])
    (tmp_path / "a.spz").write_bytes(gzip.compress(struct.pack("<IIIBBBB", 0x5053474E, 2, 1, 0, 12, 0, 0) + body))
    np.testing.assert_allclose(read_splats(tmp_path / "a.spz").rotations, [[0.8, 0.6, 0.0, 0.0]], atol=0.005)


@pytest.mark.parametrize("harmonics", [1, 16])
def test_a_glb_is_gltf_with_its_extension(tmp_path: Path, harmonics: int) -> None:
    """Lengths, alignment and bounds as glTF 2.0 asks, values as KHR_gaussian_splatting does."""
    splats, extension = some(33, harmonics), "KHR_gaussian_splatting"
    assert write_splats(tmp_path / "a.glb", splats) == []
    content = (tmp_path / "a.glb").read_bytes()
    magic, version, length, told, kind = struct.unpack("<4sIII4s", content[:20])
    assert (magic, version, length, kind, told % 4) == (b"glTF", 2, len(content), b"JSON", 0)
    size, kind = struct.unpack("<I4s", content[20 + told : 28 + told])
    assert (size, kind, size % 4) == (length - 28 - told, b"BIN\0", 0)
    scene = json.loads(content[20 : 20 + told])
    assert scene["buffers"] == [{"byteLength": size}] and scene["extensionsUsed"] == [extension]
    (mesh,) = scene["meshes"]
    assert mesh["extras"]["regions"] == list(splats.names)
    (primitive,) = mesh["primitives"]
    assert primitive["mode"] == 0
    assert primitive["extensions"] == {extension: {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}}

    def values(key: str) -> np.ndarray:
        accessor = scene["accessors"][primitive["attributes"][key]]
        view = scene["bufferViews"][accessor["bufferView"]]
        kind: np.dtype[Any] = np.dtype("<f4" if accessor["componentType"] == 5126 else "<u2")
        wide = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        assert accessor["count"] * wide * kind.itemsize == view["byteLength"] and view["byteOffset"] % 4 == 0
        found = np.frombuffer(content, kind, accessor["count"] * wide, 28 + told + view["byteOffset"]).reshape(-1, wide)
        if "min" in accessor:
            assert [found.min(axis=0).tolist(), found.max(axis=0).tolist()] == [accessor["min"], accessor["max"]]
        return found

    np.testing.assert_array_equal(values("POSITION"), splats.centres)
    np.testing.assert_array_equal(values(f"{extension}:SCALE"), splats.scales)  # linear
    np.testing.assert_array_equal(values(f"{extension}:ROTATION"), splats.rotations[:, [1, 2, 3, 0]])
    np.testing.assert_array_equal(values(f"{extension}:OPACITY")[:, 0], splats.opacities)
    np.testing.assert_array_equal(values("_REGION")[:, 0], splats.regions)
    for degree in range(int(harmonics**0.5)):
        for k in range(2 * degree + 1):
            found = values(f"{extension}:SH_DEGREE_{degree}_COEF_{k}")
            np.testing.assert_array_equal(found, splats.harmonics[:, degree**2 + k])
    shown = np.clip(0.5 + 0.2820948 * splats.harmonics[:, 0], 0.0, 1.0)
    curve = np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(values("COLOR_0") / 65535, np.c_[curve, splats.opacities], atol=1e-5)


@pytest.mark.parametrize("harmonics", [1, 9])
def test_a_usdz_is_what_openusd_reads(tmp_path: Path, harmonics: int) -> None:
    """It finds a valid stage in a package as its specification asks, with its schema's values, in the world's place."""
    usd, geometry = pytest.importorskip("pxr.Usd"), pytest.importorskip("pxr.UsdGeom")
    validation = pytest.importorskip("pxr.UsdValidation")
    splats = moved(some(33, harmonics), 1e6, 1.0)
    assert write_splats(tmp_path / "a.usdz", splats) == []
    with zipfile.ZipFile(tmp_path / "a.usdz") as package:
        (entry,) = package.infolist()
        assert entry.compress_type == zipfile.ZIP_STORED and entry.filename.endswith(".usdc")
    content = (tmp_path / "a.usdz").read_bytes()
    assert content.index(b"PXR-USDC") % 64 == 0, "aligned"
    stage = usd.Stage.Open(str(tmp_path / "a.usdz"))
    validators = validation.ValidationRegistry().GetOrLoadAllValidators()
    assert [error.GetMessage() for error in validation.ValidationContext(validators).Validate(stage)] == []
    assert geometry.GetStageUpAxis(stage) == "Y"
    (prim,) = (prim for prim in stage.Traverse() if prim.GetTypeName() == "ParticleField3DGaussianSplat")
    own = {name: np.array(prim.GetAttribute(name).Get()) for name in ("positions", "scales", "opacities")}
    origin = geometry.Xformable(prim).ComputeLocalToWorldTransform(0.0).ExtractTranslation()
    np.testing.assert_array_equal((own["positions"].astype(float) + origin).astype("f4"), splats.centres)
    np.testing.assert_array_equal(own["scales"], splats.scales)  # linear
    np.testing.assert_array_equal(own["opacities"], splats.opacities)
    turns = [[turn.GetReal(), *turn.GetImaginary()] for turn in prim.GetAttribute("orientations").Get()]
    np.testing.assert_array_equal(np.array(turns, "f4"), splats.rotations)
    assert (prim.GetAttribute("radiance:sphericalHarmonicsDegree").Get() + 1) ** 2 == harmonics
    found = np.array(prim.GetAttribute("radiance:sphericalHarmonicsCoefficients").Get())
    np.testing.assert_array_equal(found.reshape(33, harmonics, 3), splats.harmonics)
    low, high = np.array(prim.GetAttribute("extent").Get())
    assert (low < own["positions"].min(axis=0)).all() and (high > own["positions"].max(axis=0)).all()
    region = geometry.PrimvarsAPI(prim).GetPrimvar("region")
    assert region.GetInterpolation() == "vertex"
    np.testing.assert_array_equal(np.array(region.Get()), splats.regions)
    assert tuple(prim.GetCustomDataByKey("svv:regions")) == splats.names


def test_without_usd_core_a_usdz_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pxr.UsdVol", None)
    with pytest.raises(BadInput, match=r"need the package usd-core, .* pip install"):
        write_splats(tmp_path / "a.usdz", one())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", [".ply", ".glb"])
def test_a_region_is_hidden_in_a_file(tmp_path: Path, suffix: str) -> None:
    """By its number or name, also after it has been read; the others stay as they are."""
    eight = replace(some(), regions=(np.arange(50) % 8).astype(np.int16), names=tuple("abcdefgh"))
    write_splats(tmp_path / f"eight{suffix}", eight)
    rest = read_splats(tmp_path / f"eight{suffix}").hidden("c", 7)
    assert sorted(set(rest.regions.tolist())) == [0, 1, 3, 4, 5, 6] and rest.names == tuple("abcdefgh")
    splats = some()
    write_splats(tmp_path / f"a{suffix}", splats)
    back = read_splats(tmp_path / f"a{suffix}").hidden("bone")
    assert set(back.regions.tolist()) == {1} and back.names == splats.names
    np.testing.assert_array_equal(back.harmonics, splats.harmonics[splats.regions == 1])
    np.testing.assert_array_equal(back.centres, splats.hidden(0, 2).centres)
    with pytest.raises(BadInput, match="no region 'hair'"):
        splats.hidden("hair")
    with pytest.raises(BadInput, match="no splats"):
        write_splats(tmp_path / f"b{suffix}", splats.hidden("bone", 1))


@pytest.mark.parametrize(("origin", "unit"), [(0.0, 1e-9), (1e6, 1.0), (0.0, 1e6), (-1e-4, 1e-6)])
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_far_and_extreme_scenes_are_moved_and_told(tmp_path: Path, suffix: str, origin: float, unit: float) -> None:
    """In the file, positions are of moderate size and near the origin."""
    splats = moved(some(), origin, unit)
    said = " ".join(write_splats(tmp_path / f"a{suffix}", splats))
    assert ("unit is" in said) == (unit != 1.0)
    assert ("(1000000, 1000000, 1000000)" in said) == (origin == 1e6 and suffix != ".glb")
    if suffix == ".spz":
        side = np.ptp(read_splats(tmp_path / "a.spz").centres, axis=0).max()
        assert 0.9 < side < 1100.0
        assert np.abs(read_splats(tmp_path / "a.spz").centres).max() < 2.0 * FAR * side
    if suffix == ".glb":
        content = (tmp_path / "a.glb").read_bytes()
        (node,) = json.loads(content[20 : 20 + struct.unpack("<I", content[12:16])[0]])["nodes"]
        assert ("translation" in node) == (origin != 0.0)


def test_an_ordinary_scene_stays_in_the_world() -> None:
    assert place_of(moved(some(), 100.0, 128.0)) == Place()


def test_colours_that_a_spz_cuts_are_told(tmp_path: Path) -> None:
    (said,) = write_splats(tmp_path / "a.spz", one(harmonics=np.full((1, 4, 3), 1.5, np.float32)))
    assert said.startswith("1 splats have stronger colours than .spz holds")


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"opacities": np.array([1.5], np.float32)}, "between 0 and 1"),
        ({"scales": np.zeros((1, 3), np.float32)}, "above 0"),
        ({"rotations": np.ones((1, 4), np.float32)}, "length 1"),
        ({"centres": np.full((1, 3), np.nan, np.float32)}, "finite"),
        ({"harmonics": np.zeros((1, 5, 3), np.float32)}, "1, 4, 9 or 16"),
        ({"harmonics": np.zeros((1, 4), np.float32)}, "shape"),
        ({"scales": np.ones((2, 3), np.float32)}, "shape"),
        ({"regions": np.ones(1, np.int16)}, "numbers of the 1 names"),
        ({"centres": np.zeros((0, 3), np.float32)}, "no splats"),
    ],
)
def test_what_no_file_can_hold_is_refused(tmp_path: Path, changes: dict[str, np.ndarray], says: str) -> None:
    with pytest.raises(BadInput, match=says):
        write_splats(tmp_path / "a.ply", one(**changes))
    assert list(tmp_path.iterdir()) == []


def test_other_suffixes_are_refused(tmp_path: Path) -> None:
    for path in ("a.usda", "a.splat", "a"):
        with pytest.raises(BadInput, match=r"NAME\.ply, NAME\.spz, NAME\.glb or NAME\.usdz"):
            write_splats(tmp_path / path, one())
    with pytest.raises(BadInput, match=r"\.ply, \.glb and \.spz"):
        read_splats(tmp_path / "a.usdz")
    with pytest.raises(BadInput, match="No such file"):
        read_splats(tmp_path / "a.ply")


@pytest.mark.parametrize("suffix", [*SUFFIXES, WITH_USD])
def test_a_full_disk_is_told_and_nothing_is_left(tmp_path: Path, small_files: None, suffix: str) -> None:
    with pytest.raises(BadInput, match=r"Cannot write .*choose another place"):
        write_splats(tmp_path / f"a{suffix}", some(500))
    assert list(tmp_path.iterdir()) == []
    resource.setrlimit(resource.RLIMIT_FSIZE, (resource.getrlimit(resource.RLIMIT_FSIZE)[1],) * 2)
    write_splats(tmp_path / f"a{suffix}", some(500))


@pytest.mark.parametrize("suffix", [*SUFFIXES, WITH_USD])
def test_a_file_is_written_whole_or_not_at_all(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_bytes(b"before")

    def stop(fraction: float, label: str) -> None:
        raise Cancelled("stopped")

    with pytest.raises(Cancelled):
        write_splats(path, some(), stop)
    assert path.read_bytes() == b"before" and list(tmp_path.iterdir()) == [path]
    with pytest.raises(BadInput, match="its folder does not exist"):
        write_splats(tmp_path / "none" / f"a{suffix}", some())


@given(suffix=st.sampled_from(SUFFIXES), data=st.data())
def test_damaged_files_are_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, suffix: str, data: st.DataObject
) -> None:
    """Whatever bytes are changed or lost: splats that can be drawn, or one sentence."""
    path = tmp_path_factory.mktemp("damaged") / f"a{suffix}"
    write_splats(path, some(3, 4))
    plain = gzip.decompress(path.read_bytes()) if suffix == ".spz" else path.read_bytes()
    content = bytearray(plain[: data.draw(st.one_of(st.just(len(plain)), st.integers(0, len(plain))))])
    for _ in range(data.draw(st.integers(0, 3)) if content else 0):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(gzip.compress(bytes(content)) if suffix == ".spz" else bytes(content))
    try:
        back = read_splats(path)
    except BadInput as error:
        said = str(error)
    else:
        said = "."
        assert np.isfinite(back.centres).all() and back.scales.min() > 0.0
    assert "\n" not in said and said.endswith(".")


def test_a_bomb_is_not_unpacked(tmp_path: Path) -> None:
    header = struct.pack("<IIIBBBB", 0x5053474E, 3, 1, 0, 12, 0, 0)
    (tmp_path / "a.spz").write_bytes(gzip.compress(header + bytes(200_000_000), 1))
    with pytest.raises(BadInput, match=r"no whole \.spz file"):
        read_splats(tmp_path / "a.spz")
