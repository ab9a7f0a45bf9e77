"""Whether a GPU is chosen, and why not: simulated drivers and cards, and what a failure of one looks like."""

from __future__ import annotations

import subprocess
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import torch

from svv.errors import BadInput
from svv.fields.devices import gpu
from svv.fields.devices.gpu import Verdict, device_named, gpu_errors, known_verdict, why_no_gpu
from svv.kernels.dispatch import CPU

GPU = torch.device("cuda", 0)


class Card:
    """What torch says of its cards."""

    def __init__(
        self, monkeypatch: pytest.MonkeyPatch, name: str = "Card A", free: int = 8 << 30, count: int = 1
    ) -> None:
        self.ended: Any = subprocess.CompletedProcess([], 0, f"{gpu.RECORDS}\nchecked in 14 s: all well\n", "")
        self.commands: list[list[str]] = []
        self.environments: list[dict[str, str]] = []
        cuda: Any = torch.cuda
        answers = {
            "is_available": lambda: True, "current_device": lambda: 0, "device_count": lambda: count,
            "get_device_name": lambda device: name, "get_device_capability": lambda device: (9, 0),
            "mem_get_info": lambda device: (free, 8 << 30),
        }  # fmt: skip
        for answer, value in answers.items():
            monkeypatch.setattr(cuda, answer, value)
        monkeypatch.setattr(torch.version, "cuda", "13.0")
        monkeypatch.setattr(subprocess, "run", self.run)

    def run(self, command: list[str], env: dict[str, str], **rest: Any) -> Any:
        self.commands.append(command)
        self.environments.append(env)
        compile(Path(command[-1]).read_text(encoding="utf-8"), "check", "exec")
        if isinstance(self.ended, BaseException):
            raise self.ended
        return self.ended


@pytest.fixture(autouse=True)
def fresh(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[None]:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("CUDA_VISIBLE_DEVICES", raising=False)
    monkeypatch.delenv(gpu.SKIP_CHECK, raising=False)
    gpu.chosen_device.cache_clear()
    yield
    gpu.chosen_device.cache_clear()


def test_a_gpu_is_checked_once_and_then_chosen(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    card = Card(monkeypatch)
    assert device_named("auto") == GPU
    said = capsys.readouterr().err.splitlines()
    assert said[0].startswith("Checking the GPU (Card A), once")
    assert said[1] == "svv runs on the GPU: Card A, checked in 14 s: all well."
    assert known_verdict(GPU) == Verdict(True, "checked in 14 s: all well", 14.0, True)
    gpu.chosen_device.cache_clear()  # as in another process
    assert device_named("auto") == GPU
    assert len(card.commands) == 1
    assert capsys.readouterr().err.count("\n") == 1
    assert card.environments[0][gpu.SKIP_CHECK] == "0", "the check itself must not wait for a check"


def test_another_card_is_checked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("Card A", "Card B"):
        card = Card(monkeypatch, name)
        gpu.chosen_device.cache_clear()
        assert device_named("auto") == GPU
        assert len(card.commands) == 1


@pytest.mark.parametrize(
    ("ended", "words", "kept"),
    [
        (subprocess.CompletedProcess([], 1, "2 of 22 kernels are wrong; march: no\n", ""), "2 of 22 kernels", True),
        (subprocess.CompletedProcess([], -11, "", "Segmentation fault"), "Segmentation fault", True),
        (subprocess.CompletedProcess([], 7, "", ""), "ended with code 7", True),
        (subprocess.CompletedProcess([], -9, "", ""), "was stopped (SIGKILL)", False),
        (subprocess.CompletedProcess([], -15, "", "Terminated"), "was stopped (SIGTERM)", False),
        (subprocess.TimeoutExpired("check", 300.0), "did not end within 300 s", True),
        (
            subprocess.CompletedProcess([], 1, "", "torch.OutOfMemoryError: CUDA out of memory."),
            "too little free",
            False,
        ),
        (OSError(12, "Cannot allocate memory"), "could not be started", False),
    ],
)
def test_a_gpu_that_fails_its_check_is_not_chosen(
    ended: Any, words: str, kept: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What says nothing about the GPU itself is tried again in the next process."""
    card = Card(monkeypatch)
    card.ended = ended
    assert device_named("auto") == CPU
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith("svv runs on the CPU: Card A") and words in said
    assert (known_verdict(GPU) is not None) == kept


def test_a_gpu_without_free_memory_is_not_chosen(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    card = Card(monkeypatch, free=200_000_000)
    assert device_named("auto") == CPU
    assert "only 0.2 GB are free" in capsys.readouterr().err
    assert card.commands == []


def test_a_gpu_in_use_by_another_program_is_not_chosen(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    Card(monkeypatch)

    def busy(device: torch.device) -> None:
        raise RuntimeError("CUDA error: all CUDA-capable devices are busy or unavailable\nand more")

    monkeypatch.setattr(torch.cuda, "mem_get_info", busy)
    assert device_named("auto") == CPU
    assert capsys.readouterr().err.count("\n") == 1


def test_one_of_several_cards_is_named_and_checked_alone(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "3,GPU-5a")
    card = Card(monkeypatch, count=2)
    assert device_named("auto") == GPU
    assert "Card A, number 0 of 2" in capsys.readouterr().err
    assert card.environments[0]["CUDA_VISIBLE_DEVICES"] == "3"


@pytest.mark.parametrize(
    ("told", "variable", "words"),
    [
        ("Found no NVIDIA driver on your system.", None, "there is no NVIDIA driver"),
        ("The NVIDIA driver on your system is too old (found version 11040).", None, "driver is too old"),
        ("", "", "CUDA_VISIBLE_DEVICES hides all GPUs"),
        ("", "-1", "CUDA_VISIBLE_DEVICES hides all GPUs"),
        ("", None, "torch finds no GPU"),
    ],
)
@pytest.mark.parametrize("warns", [True, False])
def test_why_there_is_no_gpu_is_one_sentence(
    told: str, variable: str | None, words: str, warns: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Versions of torch tell it in a warning or in the error of a first use."""
    Card(monkeypatch)
    if variable is not None:
        monkeypatch.setenv("CUDA_VISIBLE_DEVICES", variable)

    def unavailable() -> bool:
        if warns and told:
            warnings.warn(told, stacklevel=1)
        return False

    def fails() -> None:
        if told and not warns:
            raise RuntimeError(told)

    monkeypatch.setattr(torch.cuda, "is_available", unavailable)
    monkeypatch.setattr(torch.cuda, "init", fails)
    assert words in str(why_no_gpu())
    assert device_named("auto") == CPU
    with pytest.raises(BadInput, match=words) as raised:
        device_named("cuda")
    assert str(raised.value).count("\n") == 0


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (
            torch.cuda.OutOfMemoryError("CUDA out of memory. Tried to allocate 2 GiB"),
            "ran out of memory: 8.6 of 8.6 GB",
        ),
        (RuntimeError("CUDA error: an illegal memory access was encountered\nCompile with"), "illegal memory access"),
        (RuntimeError("CUDA error: unspecified launch failure"), "launch failure"),
    ],
)
def test_a_gpu_that_is_lost_is_one_sentence_that_says_how_to_go_on(
    error: RuntimeError, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    Card(monkeypatch, free=8 << 30)
    with pytest.raises(BadInput, match=words) as raised, gpu_errors(GPU):
        raise error
    said = str(raised.value)
    assert "the same command goes on" in said and "--device cpu" in said and said.count("\n") == 0


def test_other_errors_and_errors_on_the_cpu_stay_what_they_are() -> None:
    with pytest.raises(RuntimeError, match="a defect"), gpu_errors(GPU):
        raise RuntimeError("a defect")
    with pytest.raises(RuntimeError, match="CUDA error"), gpu_errors(CPU):
        raise RuntimeError("CUDA error, on a CPU")


def test_a_training_that_loses_its_gpu_goes_on_from_its_checkpoint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The failure comes out as one sentence, and what was saved resumes on another device to the same scene."""
    from svv.job.compile_ahead import ball_views
    from svv.train import pipeline
    from svv.train.run.config import changed, preset

    few = changed(preset("draft"), ["reconstruct.iterations=30", "recolour.iterations=6", "reconstruct.cells=32"])
    views = ball_views()
    whole, _ = pipeline.train_scene(views, few)

    def lost(fraction: float, label: str) -> None:
        if label.startswith("palette colour network"):
            raise RuntimeError("CUDA error: device lost")

    monkeypatch.setattr(pipeline, "gpu_errors", lambda device: gpu_errors(GPU))
    with pytest.raises(BadInput, match="device lost"):
        pipeline.train_scene(views, few, progress=lost, checkpoint=tmp_path / "a.checkpoint")
    assert (tmp_path / "a.checkpoint").exists()
    labels: list[str] = []
    again, _ = pipeline.train_scene(
        views,
        few,
        progress=lambda _, label: labels.append(label),
        checkpoint=tmp_path / "a.checkpoint",
    )
    assert not any(label.startswith("base NeRF") for label in labels), "stage 1 was done"
    assert all(torch.equal(a, b) for a, b in zip(whole.base.state_dict().values(), again.base.state_dict().values()))


def test_the_program_that_checks_is_python_or_the_pvpython_beside_paraview(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert gpu._python() == Path(sys.executable)
    for name in ("paraview", "pvpython"):
        (tmp_path / name).touch()
    monkeypatch.setattr(sys, "executable", str(tmp_path / "paraview"))
    monkeypatch.setattr(Path, "resolve", lambda self: tmp_path / "paraview")
    assert gpu._python() == tmp_path / "pvpython"
    (tmp_path / "pvpython").unlink()
    assert gpu._python() is None
    Card(monkeypatch)
    assert "has not been checked yet: run `svv render` or `svv train` once" in gpu.check_gpu(GPU).reason
