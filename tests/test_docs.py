"""The examples of docs/python.md run as they stand, in a folder that holds what they begin with."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from svv.bench.stability.scenes import EASY
from svv.dvr.views import make_views
from svv.train.config import PRESETS, ReconstructSettings, StylizeSettings

PAGE = Path(__file__).resolve().parents[1] / "docs" / "python.md"

SHORT = replace(
    PRESETS["draft"], reconstruct=ReconstructSettings(iterations=150, rays=1024, cells=32),
    recolour=replace(PRESETS["draft"].recolour, iterations=100, rays=1024),
    stylize=StylizeSettings(distil_iterations=20, distil_rays=1024, style_iterations=3, style_views=6, style_size=64),
)  # fmt: skip


def test_the_examples_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(PRESETS, "draft", SHORT)
    train, _ = make_views(EASY.volume(32), EASY.transfer_function(), 16, 64, mapper="cpu")
    train.write("views")
    for number, name in enumerate(("brush", "ink")):
        noise = np.random.default_rng(number).integers(0, 255, (64, 64, 3)).astype(np.uint8)
        Image.fromarray(noise).save(f"{name}.png")
    examples = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert len(examples) >= 4
    names: dict[str, object] = {}
    for example in examples:
        exec(compile(example, str(PAGE), "exec"), names)
    said = capsys.readouterr().out
    assert "region 0: colour #cc1a1a, opacity 0.5" in said
    assert "('brush', 'ink') ink" in said
    assert "Region 0 is styled" in said
    assert {p.name for p in tmp_path.iterdir()} >= {"scene.svv", "red.png", "ink.svv"}
