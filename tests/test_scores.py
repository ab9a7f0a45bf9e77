"""Scores in their file: the keys that scripts rely on, and reading them back."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from svv.cli.app import app
from svv.core.geometry.cameras import Camera, sphere_cameras
from svv.core.images.metrics import Likeness
from svv.errors import BadInput
from svv.io.files.atomic import write_json
from svv.io.views.viewset import ViewSet
from svv.job.result import _scores
from svv.styles import weights
from svv.train.evaluate import Scores, check_views, evaluate_scene
from svv.train.lpips import Lpips
from tests.any_json import any_json
from tests.cinema_database import picture
from tests.cube import cube_scene

SCORES = Scores(30.0, 20.0, 0.9, 0.05, None, 8, (64, 48), 0.5, "pcn", "white", "cpu", None, "numba", None)
KEYS = {
    "psnr", "psnr_foreground", "ssim", "flip", "lpips", "views", "size", "seconds_per_view", "network", "background",
    "device", "gpu", "kernels", "peak_gpu_bytes",
}  # fmt: skip


@pytest.mark.parametrize("scores", [SCORES, replace(SCORES, lpips=0.1, region_overlap=(0.5, 1.0), peak_gpu_bytes=9)])
def test_scores_are_the_same_after_their_file(scores: Scores, tmp_path: Path) -> None:
    write_json(tmp_path / "scores.json", scores.to_json())
    content = json.loads((tmp_path / "scores.json").read_text())
    assert set(content) - {"region_overlap"} == KEYS
    assert ("region_overlap" in content) == (scores.region_overlap is not None)
    assert Scores.from_json(content) == scores


def test_a_number_that_json_has_not_is_nan(tmp_path: Path) -> None:
    write_json(tmp_path / "scores.json", replace(SCORES, psnr_foreground=math.nan).to_json())
    assert math.isnan(Scores.from_json(json.loads((tmp_path / "scores.json").read_text())).psnr_foreground)


@given(st.sampled_from(sorted(KEYS | {"region_overlap"})), any_json)
def test_any_value_is_read_or_refused(key: str, value: object) -> None:
    try:
        found = Scores.from_json({**SCORES.to_json(), key: value})
    except BadInput as error:
        refused = str(error)
    else:
        refused = key
        again = found.to_json().get(key)
        assert again == value or (value is None and isinstance(again, float) and math.isnan(again))
    assert key in refused


def test_a_scene_is_scored_by_what_it_shows() -> None:
    scene = cube_scene()
    cameras = sphere_cameras(3, (0.0, 0.0, 0.0), 3.0, 0.5, 24)
    truth = np.random.default_rng(0).integers(0, 256, (3, 24, 24, 4), dtype=np.uint8)
    told: list[float] = []
    scores = evaluate_scene(
        scene, ViewSet(tuple(cameras), truth, ("a", "b", "c")), "base", lambda done, _: told.append(done)
    )
    shown = [scene.render(camera, "base", (1.0, 1.0, 1.0)).rgba[..., :3] for camera in cameras]
    mean = Likeness.mean([Likeness.of(*pair) for pair in zip(shown, truth, strict=True)])
    assert (scores.psnr, scores.psnr_foreground, scores.ssim) == (mean.psnr, mean.psnr_foreground, mean.ssim)
    assert (scores.views, scores.size, scores.network, scores.background) == (3, (24, 24), "base", "white")
    assert scores.seconds_per_view > 0 and told == sorted(told) and told[-1] == 1.0


def shown_by(cameras: Sequence[Camera], seen_from: Sequence[Camera] | None = None) -> ViewSet:
    """Return views of the cube, or what other cameras see of it, said to be those of ``cameras``."""
    images = [cube_scene().render(camera, "base").rgba for camera in seen_from or cameras]
    return ViewSet(
        tuple(cameras), np.rint(255 * np.stack(images)).astype(np.uint8), tuple("abcdefghijkl"[: len(images)])
    )


def test_views_that_contradict_themselves_or_the_scene_are_told_before_scoring(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    cameras = sphere_cameras(12, (0.0, 0.0, 0.0), 3.0, 0.5, 64)
    assert check_views(cube_scene(), shown_by(cameras)) == []
    far = sphere_cameras(12, (0.0, 0.0, 0.0), 6.0, 0.5, 64)
    moved = sphere_cameras(12, (0.8, 0.0, 0.0), 3.0, 0.5, 64)
    for other in (far, moved):  # they agree among themselves
        *_, said = check_views(cube_scene(), shown_by(cameras, other))
        assert "% of their outlines in common" in said
    around = sphere_cameras(24, (0.0, 0.0, 0.0), 6.0, float(np.radians(30.0)), 96)
    shifted = np.stack([picture(around[k - 1]) for k in range(24)])
    with pytest.raises(BadInput, match="contradict their cameras"):
        check_views(cube_scene(), ViewSet(tuple(around), shifted, tuple(map(str, range(24)))))
    cube_scene().save(tmp_path / "cube.svv")
    shown_by(cameras, far).write(tmp_path / "views", "test")
    monkeypatch.setattr("svv.train.pipeline.evaluate_scene", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        app(["evaluate", str(tmp_path / "cube.svv"), "--views", str(tmp_path / "views")], standalone_mode=False)
    assert "outlines in common" in capsys.readouterr().err


def test_without_weights_it_is_said_how_to_get_them_beside_the_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """On standard error; the table and the JSON stay as they are. A job's page leaves LPIPS out."""
    cube_scene().save(tmp_path / "cube.svv")
    shown_by(sphere_cameras(3, (0.0, 0.0, 0.0), 3.0, 0.5, 32)).write(tmp_path / "views", "test")
    command = ["evaluate", str(tmp_path / "cube.svv"), "--views", str(tmp_path / "views"), "--json"]

    def evaluated() -> tuple[str, str, Scores]:
        app([*command, str(tmp_path / "scores.json")], prog_name="svv", standalone_mode=False)
        said = capsys.readouterr()
        return said.out, said.err, Scores.from_json(json.loads((tmp_path / "scores.json").read_text()))

    table, said, scores = evaluated()
    assert scores.lpips is None and "lpips" in table and weights.NO_LPIPS not in table
    assert said.splitlines().count(weights.NO_LPIPS) == 1 and "svv features --get alexnet " in weights.NO_LPIPS
    page = _scores({"pcn": scores})
    assert "LPIPS" not in page.columns and weights.NO_LPIPS not in page.text, "nobody asked for it"
    monkeypatch.setattr("svv.train.evaluate.load_lpips", lambda: Lpips().eval())
    _, said, scores = evaluated()
    assert scores.lpips is not None and "LPIPS" not in said
    assert weights.NO_LPIPS not in _scores({"pcn": scores}).text
