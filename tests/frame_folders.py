"""Folders of frames for tests: a smooth pattern, a window that moves over it, and exact flows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from svv.train.lpips import Lpips
from svv_bench.frames import result
from svv_bench.frames.measure import Compared
from svv_bench.frames.motion import FLO
from svv_bench.frames.result import FolderJob

SIZE = 48
NEAR = FolderJob(Compared(intervals=(1,)))


@pytest.fixture
def alexnet(monkeypatch: pytest.MonkeyPatch) -> Lpips:
    """LPIPS with random weights, which a folder is measured with: its laws hold with any."""
    torch.manual_seed(0)
    network = Lpips().eval()
    monkeypatch.setattr(result, "load_lpips", lambda: network)
    return network


def pattern(across: int = SIZE, seed: int = 0) -> np.ndarray:
    """A smooth colourful picture, which an estimator can follow. (SIZE, across, 3)"""
    coarse = np.random.default_rng(seed).integers(0, 256, (SIZE // 6, across // 6, 3), dtype=np.uint8)
    return np.asarray(Image.fromarray(coarse).resize((across, SIZE), Image.Resampling.BICUBIC))


def write(folder: Path, pictures: list[np.ndarray], name: str = "frame{:02d}.png") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for number, picture in enumerate(pictures):
        Image.fromarray(picture).save(folder / name.format(number))
    return folder


def shifted(count: int, by: int = 2, seed: int = 0) -> list[np.ndarray]:
    """A window that moves to the left over a wide picture: what it shows moves to the right, ``by`` pixels a frame."""
    wide = pattern(SIZE + by * count // 6 * 6 + 12, seed)
    left = by * (count - 1)
    return [wide[:, left - by * k : left - by * k + SIZE] for k in range(count)]


def flows(folder: Path, count: int, by: int = 2, name: str = "frame{:02d}.npy") -> Path:
    folder.mkdir(exist_ok=True)
    for number in range(count):
        flow = np.zeros((SIZE, SIZE, 2), np.float32)
        flow[..., 0] = by
        if name.endswith(".npy"):
            np.save(folder / name.format(number), flow)
        else:
            head = np.float32(FLO).tobytes() + np.array([SIZE, SIZE], "<i4").tobytes()
            (folder / name.format(number)).write_bytes(head + flow.tobytes())
    return folder


def row(found: dict[str, Any], interval: int, frames: str | None = None) -> dict[str, Any]:
    (one,) = [r for r in found["rows"] if r["interval"] == interval and frames in (None, r["frames"])]
    return one
