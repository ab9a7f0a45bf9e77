"""Bricked access: every format gives the same boxes, pyramids are means, and the memory does not change an image."""

from __future__ import annotations

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from svv.bricks import filling, pyramid
from svv.bricks.caster import BrickCaster, Look
from svv.bricks.formats.source import ArraySource, Source
from svv.bricks.halving import halved
from svv.bricks.pyramid import with_pyramid
from svv.core.colour.shading import Shading
from svv.core.geometry.cameras import Camera, sphere_cameras
from svv.errors import BadInput, silent
from svv_bench.volume_size.generated import GeneratedSource
from tests.nightly import nightly

TYPES = ("i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8")


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("SVV_PYRAMIDS", str(tmp_path / "pyramids"))
    monkeypatch.delenv("SVV_PYRAMIDS_SIZE", raising=False)
    return tmp_path / "pyramids"


def ramp_look(low: float = 0.0, high: float = 255.0, shaded: bool = True) -> Look:
    """Opacity from 0 in the middle of the values to .5 at their upper end, in colours that change with the value."""
    place = np.linspace(0.0, 1.0, 4096)
    table = np.stack([place, 1.0 - place, 0.5 + 0.0 * place, 0.5 * np.clip(2.0 * place - 1.0, 0.0, 1.0)], axis=1)
    visible = np.array([[0.5 * (low + high), high]])
    return Look(low, high, table.astype(np.float32), visible, 2.0, Shading(on=shaded))


def around(side: int, count: int, size: int) -> list[Camera]:
    cameras = sphere_cameras(max(count, 3), np.full(3, 0.5 * (side - 1)), 4.0 * side, np.pi / 6, size)
    return list(cameras[:count])


def drawn(source: Source, look: Look, camera: Camera, memory: int = 1 << 30, threads: int = 2) -> NDArray[np.float32]:
    return BrickCaster(source, 0, look, memory, threads).render(camera, 0.5)


# --- pyramids ---------------------------------------------------------------------------------------------------------


@settings(max_examples=40, deadline=None)
@given(st.tuples(*[st.integers(1, 7)] * 3), st.sampled_from(TYPES), st.integers(0, 1000))
def test_a_level_is_the_mean_of_the_voxels_below(shape: tuple[int, int, int], kind: str, seed: int) -> None:
    values = np.random.default_rng(seed).integers(0, 100, shape).astype(kind)
    found = halved(values)
    wide = np.pad(values.astype(float), [(0, n % 2) for n in shape], mode="edge")
    mean = wide.reshape([k for n in wide.shape for k in (n // 2, 2)]).mean(axis=(1, 3, 5))
    assert found.dtype == values.dtype
    assert np.abs(found - mean).max() <= (0.5 if values.dtype.kind in "iu" else 1e-5 * 100)


def test_an_interrupted_pyramid_goes_on_where_it_stopped(
    tmp_path: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pyramid, "BOX_BYTES", 1)  # many boxes: 3 x 4
    values = np.random.default_rng(0).integers(0, 255, (140, 200, 90)).astype(np.uint8)
    np.save(tmp_path / "v.npy", values)

    class Counted(ArraySource):
        boxes = 0

        def read(self, level: int, start: Any, stop: Any) -> NDArray[Any]:
            Counted.boxes += 1
            return super().read(level, start, stop)

    def stop_soon(fraction: float, label: str) -> None:
        assert "pyramid" in label
        if fraction >= 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        with_pyramid(Counted(values), tmp_path / "v.npy", stop_soon)
    before = Counted.boxes
    assert 5 < before < 12
    assert not [path for path in cache.iterdir() if not path.name.startswith(".")]
    made = with_pyramid(Counted(values), tmp_path / "v.npy", silent)
    assert Counted.boxes - before < 12 - before + 3
    assert made.range == (values.min(), values.max())
    expected: np.ndarray = values
    for level, grid in enumerate(made.levels[1:], 1):
        expected = halved(expected)
        assert np.array_equal(made.read(level, (0, 0, 0), grid.shape), expected)
        # The corner of the first voxel stays where it is.
        assert np.allclose(grid.origin - 0.5 * grid.axes.sum(axis=1), -0.5)
    Counted.boxes = 0
    with_pyramid(Counted(values), tmp_path / "v.npy", silent)
    assert Counted.boxes == 0, "the pyramid was made again"
    os.utime(tmp_path / "v.npy", (1, 1))
    with_pyramid(Counted(values), tmp_path / "v.npy", silent)
    assert Counted.boxes == 12, "the file changed, its pyramid did not"


def test_one_makes_a_pyramid_and_the_others_wait_or_are_stopped(tmp_path: Path, cache: Path) -> None:
    values = np.random.default_rng(0).integers(0, 255, (70, 70, 70)).astype(np.uint8)
    np.save(tmp_path / "v.npy", values)
    begun, may_go_on = Event(), Event()
    heard: list[str] = []

    class Counted(ArraySource):
        boxes = 0

        def read(self, level: int, start: Any, stop: Any) -> NDArray[Any]:
            Counted.boxes += 1
            begun.set()
            assert may_go_on.wait(60)
            return super().read(level, start, stop)

    def stopped(_: float, label: str) -> None:
        heard.append(label)
        raise KeyboardInterrupt

    def waiting(_: float, label: str) -> None:
        heard.append(label)
        may_go_on.set()

    with ThreadPoolExecutor(1) as pool:
        first = pool.submit(with_pyramid, Counted(values), tmp_path / "v.npy", silent)
        assert begun.wait(60)
        with pytest.raises(KeyboardInterrupt):
            with_pyramid(Counted(values), tmp_path / "v.npy", stopped)
        second = with_pyramid(Counted(values), tmp_path / "v.npy", waiting)
    assert set(heard) == {"Waiting for another process that makes the same pyramid"}
    assert Counted.boxes == 2, "it was made twice"
    assert second.range == first.result().range


def test_a_full_disk_and_an_unreachable_chunk_are_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    values = np.random.default_rng(0).random((70, 70, 70)).astype(np.float32)
    (tmp_path / "v").write_bytes(b"x")

    class Broken(ArraySource):
        def read(self, level: int, start: Any, stop: Any) -> NDArray[Any]:
            if start[0]:
                raise BadInput("Cannot read voxels there.")
            return super().read(level, start, stop)

    with pytest.raises(BadInput, match="Cannot read voxels"):
        with_pyramid(Broken(values), tmp_path / "v", silent)
    with monkeypatch.context() as full:
        full.setattr(os, "posix_fallocate", _no_space, raising=False)
        with pytest.raises(BadInput, match=r"disk is full.*free some space"):
            with_pyramid(ArraySource(values), tmp_path, silent)
    made = with_pyramid(ArraySource(values), tmp_path / "v", silent)
    assert np.array_equal(made.read(1, (0, 0, 0), made.levels[1].shape), halved(values))
    with pytest.raises(BadInput, match="NaN or infinite"):
        with_pyramid(ArraySource(np.full((80, 80, 80), np.nan, np.float32)), tmp_path / "v", silent)


def _no_space(*_: object) -> None:
    raise OSError(28, "No space left on device")


def test_pyramids_have_a_bound(tmp_path: Path, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SVV_PYRAMIDS_SIZE", "50K")
    for k in range(3):
        np.save(tmp_path / f"{k}.npy", np.full((70, 70, 70), k, np.uint8))
        with_pyramid(ArraySource(np.load(tmp_path / f"{k}.npy")), tmp_path / f"{k}.npy", silent)
    assert len(list(cache.iterdir())) == 1
    monkeypatch.setenv("SVV_PYRAMIDS_SIZE", "many")
    with pytest.raises(BadInput, match="SVV_PYRAMIDS_SIZE must be a number of bytes"):
        pyramid.pyramids()


# --- ray caster -------------------------------------------------------------------------------------------------------


@settings(max_examples=200, deadline=None)
@given(st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda v: np.linalg.norm(v) > 1e-3))
def test_a_normal_survives_its_code(vector: tuple[float, float, float]) -> None:
    axis = np.array(vector) / np.linalg.norm(vector)
    again = filling.decoded()[filling.encoded(*vector)]
    assert abs(axis @ again) > np.cos(np.radians(1.11))
    assert filling.encoded(0.0, 0.0, 0.0) == 0


def test_images_are_the_integral_along_rays() -> None:
    """In a volume of one value, the opacity is 1 - (1 - a) ** (length / unit distance)."""
    look = ramp_look(shaded=False)
    camera = around(40, 1, 9)[0]
    image = drawn(ArraySource(np.full((40, 40, 40), 255, np.uint8)), look, camera)
    origins, directions = camera.rays()
    with np.errstate(divide="ignore"):
        ends = np.stack([(-origins) / directions, (39.0 - origins) / directions])
    length = np.maximum(ends.max(0).min(-1) - ends.min(0).max(-1), 0.0)
    expected = 1.0 - 0.5 ** (length / look.unit_distance)
    assert np.abs(image[..., 3] - expected).max() < 0.07  # half a sample at each end
    opaque = expected > 0.9
    assert np.allclose(image[opaque][:, :3] / image[opaque][:, 3:], (1.0, 0.0, 0.5), atol=0.01)


@pytest.mark.parametrize("kind", nightly(["i1", "i2", "u2", "i4", "f8"], "i2", "f8"))
def test_types_do_not_change_an_image(kind: str) -> None:
    values = GeneratedSource(48).read(0, (0, 0, 0), (48, 48, 48))
    camera = around(48, 1, 40)[0]
    expected = drawn(ArraySource(values), ramp_look(), camera)
    shift = -128 if kind in ("i1", "i2") else 0
    found = drawn(ArraySource((values.astype(np.int32) + shift).astype(kind)), ramp_look(shift, 255 + shift), camera)
    assert np.abs(found - expected).max() < 1e-3


def test_values_beyond_the_table_look_like_its_ends() -> None:
    values = GeneratedSource(48).read(0, (0, 0, 0), (48, 48, 48)).astype(np.float32)
    far = np.where(values > 200.0, np.float32(1e15), np.where(values < 20.0, np.float32(-1e15), values))
    near = np.where(values > 200.0, np.float32(1e6), np.where(values < 20.0, np.float32(-1e6), values))
    camera = around(48, 1, 40)[0]
    expected = drawn(ArraySource(near), ramp_look(), camera)
    assert expected[..., 3].max() > 0.5
    assert np.abs(drawn(ArraySource(far), ramp_look(), camera) - expected).max() < 0.02


def test_memory_and_threads_do_not_change_an_image() -> None:
    source, look = ArraySource(GeneratedSource(180).read(0, (0, 0, 0), (180, 180, 180))), ramp_look()
    for camera in around(180, 2, 60):
        expected = drawn(source, look, camera)
        assert expected[..., 3].max() > 0.5
        small = BrickCaster(source, 0, look, 0, 1)  # room for 64 of the 216 bricks
        assert np.array_equal(small.render(camera, 0.5), expected)
        assert np.array_equal(small.render(camera, 0.5), expected)


def test_a_pool_begins_with_zeros(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rays that wait for a brick look up voxels that none has filled; NaN would lead out of the table of colours."""

    def unwritten(shape: tuple[int, ...], kind: Any = float) -> NDArray[Any]:
        return np.full(shape, np.nan if kind == np.float32 else 7, kind)

    monkeypatch.setattr(np, "empty", unwritten)
    source = ArraySource(np.linspace(0.0, 1.0, 40**3, dtype=np.float32).reshape(40, 40, 40))
    caster = BrickCaster(source, 0, ramp_look(), 1 << 20, 1)
    assert not caster._values.any() and not caster._codes.any()


def test_what_is_hidden_or_empty_is_not_read_again() -> None:
    wall = np.zeros((160, 160, 160), np.uint8)
    wall[:, :, 130:] = 255
    look = ramp_look()
    look.table[:, 3] *= 1.99
    camera = Camera(np.array([[0, 0, 1, 600.0], [0, 1, 0, 80], [-1, 0, 0, 80], [0, 0, 0, 1]], float), 0.4, 50, 50)
    caster = BrickCaster(ArraySource(wall), 0, look, 1 << 30, 2)
    first = caster.render(camera, 0.5)
    assert first[10:40, 10:40, 3].min() > 0.99
    assert caster.reads == 25, "bricks behind the wall were read"
    caster.render(camera, 0.5)
    assert caster.reads == 25


@pytest.mark.parametrize("level", [0, 3])
def test_a_volume_of_half_a_trillion_voxels(level: int) -> None:
    """8192^3 voxels, of which only bricks that are seen are generated; close up, the finest level's."""
    source = GeneratedSource(8192)
    distance, angle = (6.0, 0.4) if level else (1.0, 0.004)
    look = Look(0.0, 255.0, ramp_look().table, np.array([[127.5, 255.0]]), 0.02, Shading())
    eye = np.array([0.42, 0.0, distance])
    camera = Camera(np.block([[np.eye(3), eye[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]]), angle, 24, 24)
    caster = BrickCaster(source, level + 2 if level else 0, look, 64 << 20, 2)
    image = caster.render(camera, caster.level.voxel)
    assert image[..., 3].max() > 0.5
    assert caster.reads < 2000


# --- memory -----------------------------------------------------------------------------------------------------------


LIMITED = """
import resource, sys
import numpy as np
from svv.dvr.draw.large import open_volume
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.draw.views import make_views
tf = TransferFunction.from_bumps([{"centre": 200, "width": 100, "opacity": 0.5}])
def views(file):
    return make_views(open_volume(file, mapper="auto", memory=0.3), tf, n=3, test=0, size=64, rescale=False)[0]
views(sys.argv[2])  # what is imported and compiled does not count
used = next(int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmData")) << 10
resource.setrlimit(resource.RLIMIT_DATA, (used + (300 << 20),) * 2)
made = views(sys.argv[1])
assert made.meta.mapper == "bricks" and made.images[..., 3].max() > 100
try:
    np.fromfile(sys.argv[1], np.uint8)
except MemoryError:
    print("drawn, though it does not fit")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="the limit is Linux's")
def test_a_volume_larger_than_memory_is_drawn(tmp_path: Path) -> None:
    """The process may take 300 MB; the volume has 432 MB."""
    pytest.importorskip("vtkmodules")
    small, large = tmp_path / "s_96x96x96_uint8.raw", tmp_path / "v_720x750x800_uint8.raw"
    slab = GeneratedSource(800).read(0, (396, 0, 0), (404, 750, 720))
    with large.open("wb") as file:
        for _ in range(100):
            file.write(slab)
    GeneratedSource(96).read(0, (0, 0, 0), (96, 96, 96)).tofile(small)
    done = subprocess.run([sys.executable, "-c", LIMITED, large, small], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "drawn" in done.stdout
