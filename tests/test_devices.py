"""Choosing a device: those accepted and refused, the report, and a GPU compared with the CPU."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from svv.cli import app as cli
from svv.core.geometry.box import Box
from svv.core.geometry.cameras import sphere_cameras
from svv.errors import BadInput
from svv.fields.devices import gpu
from svv.fields.devices.gpu import device_named
from svv.fields.radiance.networks import BaseField, FieldSettings
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.rendering import Marching
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet
from svv.kernels import dispatch
from svv.kernels.dispatch import CPU, device_report, kernels_of
from svv.train.pipeline import evaluate_scene, train_scene
from tests.interpreted import triton_kernels

needs_gpu = pytest.mark.skipif(not torch.cuda.is_available(), reason="torch finds no GPU")


@pytest.fixture
def no_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.version, "cuda", None)
    gpu.chosen_device.cache_clear()


@pytest.fixture
def fresh_choice() -> Iterator[None]:
    """Kernels are chosen once for each kind of device; a test that changes what is installed leaves no trace."""
    kernels_of.cache_clear()
    yield
    kernels_of.cache_clear()


def small_scene() -> Scene:
    box = Box((-0.5, -0.5, -0.5), 1.0, (1.0, 1.0, 1.0))
    occupancy, settings = Occupancy.full(box, 4), FieldSettings(resolutions=(2, 4), features=2, width=16)
    torch.manual_seed(0)
    base = BaseField(settings, occupancy).requires_grad_(False)
    base.encoding.randomize(1.0, torch.Generator().manual_seed(0))
    return Scene(settings, occupancy, Marching(1 / 8), base)


def test_without_a_gpu_auto_is_the_cpu_and_says_nothing(no_gpu: None, capsys: pytest.CaptureFixture[str]) -> None:
    assert device_named("auto") == device_named("cpu") == CPU
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(("name", "words"), [("cuda", "CUDA cannot be used here"), ("tpu", "no device 'tpu'")])
def test_devices_that_cannot_be(no_gpu: None, name: str, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        device_named(name)


@pytest.mark.parametrize("command", ["train", "stylize", "render", "evaluate", "run", "demo"])
def test_cuda_where_there_is_none_is_one_sentence(
    command: str, no_gpu: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("svv.io.pictures.style_picture.read_style", lambda path: None)
    small_scene().save("s.svv")
    Path("views").mkdir()
    Path("views/transforms_train.json").write_text("{}")
    rest = {
        "train": ["views", "--out", "t.svv"],
        "stylize": ["s.svv", "--style", "a.png", "--out", "t.svv"],
        "render": ["s.svv", "--out", "a.png"],
        "evaluate": ["s.svv", "--views", "views"],
        "run": ["views", "--out", "out"],
        "demo": ["--out", "out"],
    }[command]
    monkeypatch.setattr(sys, "argv", ["svv", command, *rest, "--device", "cuda"])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1
    assert "CUDA cannot be used here" in said[0]


def test_report_of_the_processor() -> None:
    assert device_report(CPU) == {"device": "cpu", "gpu": None, "kernels": "numba", "peak_gpu_bytes": None}


def test_a_gpu_without_triton_says_so_once(
    fresh_choice: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delitem(sys.modules, "svv.kernels.triton.kernels", raising=False)
    monkeypatch.setitem(sys.modules, "triton", None)  # an import of it fails from here on
    monkeypatch.delitem(sys.modules, "svv.kernels.triton.rays", raising=False)
    monkeypatch.delitem(sys.modules, "svv.kernels.triton.tables", raising=False)
    assert [kernels_of("cuda").NAME, kernels_of("cuda").NAME] == ["reference", "reference"]
    assert capsys.readouterr().err.count("\n") == 1
    assert kernels_of("cpu").NAME == "numba"


@pytest.mark.parametrize("error", [OSError(30, "Read-only file system"), RuntimeError("Failed to find C compiler.")])
def test_a_gpu_where_triton_cannot_compile_runs_plain_torch(
    error: Exception, fresh_choice: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Triton needs a compiler, Python's headers and a folder to write to, which it says at the first launch."""

    def fails() -> None:
        raise error

    monkeypatch.setattr(triton_kernels, "try_to_compile", fails)
    assert [kernels_of("cuda").NAME, kernels_of("cuda").NAME] == ["reference", "reference"]
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "Triton cannot compile here" in said and str(error) in said


def test_the_reference_can_be_asked_for(fresh_choice: None, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, camera = small_scene(), sphere_cameras(3, (0.0, 0.0, 0.0), 3.0, 0.5, 24)[0]
    fast = scene.render(camera).rgba
    away = replace(camera, camera_to_world=camera.camera_to_world @ np.diag([-1.0, 1.0, -1.0, 1.0]))
    for value, name in (("reference", "reference"), ("torch", "reference"), ("", "numba")):
        monkeypatch.setenv(dispatch.KERNELS_VARIABLE, value)
        kernels_of.cache_clear()
        assert kernels_of("cpu").NAME == name
        np.testing.assert_allclose(scene.render(camera).rgba, fast, atol=5e-3)
        assert not scene.render(away).rgba.any()  # no ray of it meets the box
    monkeypatch.setenv(dispatch.KERNELS_VARIABLE, "numba")
    kernels_of.cache_clear()
    with pytest.raises(BadInput, match="can be 'reference'"):
        kernels_of("cpu")


def test_a_scene_stays_where_it_is_and_moves_as_a_copy() -> None:
    scene = small_scene()
    assert scene.on(CPU) is scene
    elsewhere = scene.on(torch.device("meta"))
    assert elsewhere.device.type == "meta"
    assert scene.device == CPU
    assert all(b.device.type == "meta" for b in elsewhere.base.buffers())


def test_buffers_of_gradients_follow_their_table() -> None:
    """A scene that goes on learning on another device would otherwise add its gradients to those of the first one."""
    encoding = small_scene().base.encoding
    here = encoding.buffers_for_gradient()
    assert encoding.buffers_for_gradient() is not None and encoding.buffers_for_gradient()[0] is here[0]
    there = encoding.to(torch.device("meta")).buffers_for_gradient()
    assert [t.device.type for t in there] == ["meta", "meta"]


@pytest.mark.gpu
@needs_gpu
def test_a_gpu_renders_what_the_processor_does() -> None:
    scene, camera = small_scene(), sphere_cameras(3, (0.0, 0.0, 0.0), 3.0, 0.5, 64)[0]
    here, there = scene.render(camera), scene.on(device_named("cuda")).render(camera)
    np.testing.assert_allclose(there.rgba, here.rgba, atol=5e-3)
    assert (dispatch.device_report(torch.device("cuda"))["peak_gpu_bytes"] or 0) > 0


@pytest.mark.gpu
@needs_gpu
def test_a_gpu_learns_as_well_as_the_processor() -> None:
    """The same seed gives the same batches; what is left is the order of sums."""
    cameras = sphere_cameras(12, (0.0, 0.0, 0.0), 3.0, 0.35, 48)
    images = np.zeros((12, 48, 48, 4), np.uint8)
    row, column = np.mgrid[:48, :48] - 23.5
    images[:, row**2 + column**2 < 15**2] = (200, 60, 30, 255)
    views = ViewSet(tuple(cameras), images, tuple(map(str, range(12))))
    scores = []
    for name in ("cpu", "cuda"):
        scene, report = train_scene(views, "draft", device=name)
        assert report["device"] == name
        scores.append(evaluate_scene(scene, views, "base").psnr)
    assert abs(scores[0] - scores[1]) < 0.3
