"""The choice between volume and views, and views only: everywhere it is offered, and what reports say of it."""

from __future__ import annotations

import argparse
import inspect
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from svv.cli import app
from svv.core.geometry.cameras import sphere_cameras
from svv.dvr.draw.views import make_views
from svv.errors import Cancelled
from svv.io.views.equal_views import equal_views
from svv.io.views.viewset import ViewSet
from svv.job import steps
from svv.options.arguments import add_arguments, options_of
from svv.options.described import described
from svv.options.making import PaletteOptions, TrainOptions
from svv.train.pipeline import train_scene
from svv.train.run.config import PRESETS, ReconstructSettings
from svv_bench.stability.scenes import SCENES
from tests.balls import two_balls

TINY = replace(
    PRESETS["draft"], reconstruct=ReconstructSettings(iterations=4, rays=256, cells=16),
    recolour=replace(PRESETS["draft"].recolour, iterations=1),
)  # fmt: skip


@pytest.fixture(scope="module")
def views() -> ViewSet:
    """Views that come with their volume."""
    scene = SCENES["one-region"]
    return make_views(scene.volume(24), scene.transfer_function(), n=8, size=32, mapper="cpu")[0]


def run(monkeypatch: pytest.MonkeyPatch, *words: object) -> None:
    monkeypatch.setattr(sys, "argv", ["svv", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        app.main()
    assert not ended.value.code


def test_python_learns_from_the_volume_unless_told_otherwise(views: ViewSet) -> None:
    both, first = train_scene(views, TINY)
    only, second = train_scene(views, TINY, views_only=True)
    bare, third = train_scene(replace(views, classified=None), TINY)
    _, paper = train_scene(views, replace(TINY, reconstruct=replace(TINY.reconstruct, use_volume=False)))
    assert first["learned_from"] == both.made["learned_from"] == "volume and views"
    assert {r["learned_from"] for r in (second, third, paper)} == {"views only"}
    assert all(region.values for region in both.regions) and not any(region.values for region in only.regions)
    for found, report in ((both, first), (only, second)):
        assert report["notes"][0].startswith(f"learned from {found.made['learned_from']}: ")
    for name, value in only.base.state_dict().items():
        assert value.equal(bare.base.state_dict()[name]), "views only is as if there had never been a volume"


@pytest.mark.parametrize("command", ["train", "run", "demo", "palette"])
def test_every_command_that_trains_offers_the_choice(command: str) -> None:
    function, _ = app.command_of(command)
    assert "views_only" in inspect.signature(function).parameters


@pytest.mark.slow
@pytest.mark.parametrize("alone", [False, True])
def test_the_whole_job_passes_the_choice_on(
    views: ViewSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, alone: bool
) -> None:
    views.write(tmp_path / "views")
    monkeypatch.setitem(PRESETS, "draft", TINY)
    words = ["run", tmp_path / "views", "--out", tmp_path / "out", "--preset", "draft", "--orbit", 2]
    run(monkeypatch, *words, "--orbit-size", 16, *["--views-only"] * alone)
    said = "views only" if alone else "volume and views"
    assert json.loads((tmp_path / "out" / "train.json").read_text())["learned_from"] == said
    assert said in (tmp_path / "out" / "report.html").read_text()


def test_the_demo_passes_the_choice_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given = []

    def train(job: steps.Job) -> None:
        given.append(job.settings.train.views_only)
        raise Cancelled

    monkeypatch.setattr(steps.Job, "train", train)
    for more in ([], ["--views-only"]):
        monkeypatch.setattr(sys, "argv", ["svv", "demo", "--out", str(tmp_path), "--resolution", "16", "--n", "4",
                                          "--test", "0", "--size", "16", *more])  # fmt: skip
        with pytest.raises(SystemExit):
            app.main()
    assert given == [False, True]


def test_scripts_and_panels_offer_the_choice() -> None:
    parser = argparse.ArgumentParser()
    add_arguments(parser, TrainOptions(), {"preset": "--preset", "views_only": "--views-only"})
    assert options_of(TrainOptions, parser.parse_args([])).views_only is False
    assert options_of(TrainOptions, parser.parse_args(["--views-only"])).views_only is True
    for kind in (TrainOptions, PaletteOptions):
        (field,) = (field for field in described(kind) if field.name == "views_only")
        assert field.property_name == "ViewsOnly" and not field.setting.advanced


def test_equal_pictures_of_different_cameras_are_noted() -> None:
    cameras = sphere_cameras(12, (0.0, 0.0, 0.0), 4.0, np.radians(30), 40)
    images = np.stack([two_balls(camera) for camera in cameras])
    images[..., 0] -= np.arange(12, dtype=np.uint8)[:, None, None] * (images[..., 3] > 0)  # two balls look alike twice
    views = ViewSet(tuple(cameras), images, tuple(f"r_{k}" for k in range(12)))
    assert equal_views(views) is None
    images = images.copy()
    images[7] = images[3]
    twice = replace(views, images=images)
    said = equal_views(twice)
    assert said is not None and said.startswith("2 of 12 views (r_3, r_7) have exactly the same picture")
    _, report = train_scene(twice, TINY)
    wrong, equal = report["warnings"]
    assert wrong.startswith("The picture r_7 disagrees") and equal == said and said in report["notes"]
    assert train_scene(views, TINY)[1]["warnings"] == []


def test_one_pixel_makes_a_difference_and_the_same_view_twice_none() -> None:
    cameras = sphere_cameras(6, (0.0, 0.0, 0.0), 4.0, np.radians(30), 40)
    image = two_balls(cameras[0])
    images = np.stack([image] * 6)
    names = tuple("abcdef")
    said = equal_views(ViewSet(tuple(cameras), images, names))
    assert said is not None and said.startswith("6 of 6 views (a, b, c, ...)")
    assert equal_views(ViewSet((cameras[0],) * 6, images, names)) is None  # one camera: nothing contradicts
    images[np.arange(6), 17, 19 + np.arange(6) % 3, 0] ^= 1 + (np.arange(6) // 3).astype(np.uint8)
    assert equal_views(ViewSet(tuple(cameras), images, names)) is None
    empty = np.zeros_like(images)
    assert equal_views(ViewSet(tuple(cameras), empty, names)) is None
