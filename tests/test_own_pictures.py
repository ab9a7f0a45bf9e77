"""Pictures of other programs: what PyVista writes with alpha is straight afterwards, and the how-to's commands run."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

pyvista = pytest.importorskip("pyvista")

from svv.cli.app import app  # noqa: E402
from svv.core.geometry.directions import geodesic_directions  # noqa: E402
from svv.io.views.straight import straightened  # noqa: E402
from svv.io.views.viewset import ViewSet  # noqa: E402
from svv.train.run.config import PRESETS  # noqa: E402
from tests.balls import SHORT  # noqa: E402

LEVELS = np.arange(256, dtype=np.uint8)


def plotter(kind: str) -> Any:
    made = pyvista.Plotter(off_screen=True, window_size=[64, 64])
    if kind == "surface":
        surface = pyvista.Wavelet().contour([130, 200])
        made.add_mesh(surface, cmap=["steelblue", "orange"], show_scalar_bar=False)
    else:
        made.add_volume(pyvista.Wavelet(), cmap="viridis", opacity="sigmoid_5", show_scalar_bar=False)
    return made


def write_pictures(folder: Path, kind: str, background: str) -> np.ndarray:
    """Pictures from 24 directions and their cameras; returns colours over black, as they truly are. (24, 64, 64, 3)"""
    folder.mkdir()
    made, frames, truth = plotter(kind), [], []
    for number, direction in enumerate(geodesic_directions(24)):
        made.camera_position = [65 * direction, (0, 0, 0), (0.1, 0.2, 1.0)]
        made.camera.view_angle = 30
        made.set_background("black")
        made.render()
        truth.append(made.screenshot(return_img=True, transparent_background=True)[..., :3])
        made.set_background(background)
        made.render()
        picture = made.screenshot(return_img=True, transparent_background=True)
        Image.fromarray(picture).save(folder / f"{number:03}.png")
        pose = np.linalg.inv(pyvista.array_from_vtkmatrix(made.camera.GetViewTransformMatrix()))
        frames.append({"file_path": f"./{number:03}", "transform_matrix": pose.tolist()})
    made.close()
    told = {"camera_angle_x": math.radians(30), "frames": frames}
    (folder / "transforms_train.json").write_text(json.dumps(told))
    return np.stack(truth)


@pytest.mark.parametrize("background", ["white", "steelblue"])
def test_what_is_mixed_with_a_background_is_taken_out_and_said(tmp_path: Path, background: str) -> None:
    truth = write_pictures(tmp_path / "views", "volume", background)
    read = ViewSet.read(tmp_path / "views")
    said = read.meta.assumed
    assert said is not None and f"mixed with the background {pyvista.Color(background).hex_rgb}" in said
    seen = read.images[..., 3] > 0
    off = np.abs(read.images[..., :3] * (read.images[..., 3:] / 255.0) - truth)[seen]  # of 255 levels, over black
    assert off.mean() < 0.6 and np.quantile(off, 0.999) < 3.0  # 10 and 50 over white if it is not taken out


def test_straight_pictures_stay_whatever_their_transparent_pixels_have() -> None:
    rng = np.random.default_rng(0)
    for behind in ((255, 255, 255), (70, 130, 180)):
        image = np.empty((64, 64, 4), np.uint8)
        image[..., :3] = rng.integers(0, 255, 3)
        image[..., :3] += rng.integers(0, 2, (64, 64, 3)).astype(np.uint8)
        image[..., 3] = rng.integers(0, 256, (64, 64)) * (rng.random((64, 64)) > 0.3)
        image[image[..., 3] == 0, :3] = behind
        before = image.copy()
        (after,), said = straightened([image], None, "{alpha}", LEVELS, LEVELS)
        np.testing.assert_array_equal(after, before)
        assert said is None or "mixed" not in said


def test_the_how_tos_commands_run_as_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(PRESETS, "balanced", SHORT)
    monkeypatch.chdir(tmp_path)
    write_pictures(tmp_path / "views", "surface", "black")
    for line in ("train views --out scene.svv", "evaluate scene.svv --views views", "info scene.svv"):
        app(line.split(), standalone_mode=False)
    assert "has no test views, so these are scores on the training views" in capsys.readouterr().err.replace("\n", " ")
    told = json.loads((tmp_path / "views" / "transforms_train.json").read_text())
    for name, frames in (("train", told["frames"][::2]), ("test", told["frames"][1::2])):
        (tmp_path / "views" / f"transforms_{name}.json").write_text(json.dumps({**told, "frames": frames}))
    app("evaluate scene.svv --views views --json s.json".split(), standalone_mode=False)
    assert "has no test views" not in capsys.readouterr().err
    assert json.loads((tmp_path / "s.json").read_text())["views"] == 12
