"""Palettes corrected by hand, with stage 2 trained again: views of similar hues, and ranges of a known volume."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from svv.core.colour.correction import Correction
from svv.dvr.draw.views import make_views
from svv.errors import BadInput, Cancelled
from svv.fields.scene.parts import no_parts
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet
from svv.train.correct import correct_palette
from svv.train.palette.ranges import region_overlaps
from svv.train.pipeline import train_scene
from svv.train.run.config import PRESETS, ReconstructSettings
from svv_bench.stability.measures import matched, overlaps
from svv_bench.stability.scenes import BLUE, GREEN, ORANGE, RED, SCENES, KnownScene, Range, ring_and_balls, shells
from tests.cube import cube_paint

LIKE_ORANGE = (0.95, 0.64, 0.1)
"""Its hue is 0.037 from orange's: one region to whoever looks at pixels alone."""

SHORT = replace(
    PRESETS["draft"], reconstruct=ReconstructSettings(iterations=120, rays=1024, samples=8192, cells=32),
    recolour=replace(PRESETS["draft"].recolour, iterations=120, rays=1024, samples=8192),
)  # fmt: skip

Drawn = tuple[Scene, ViewSet]


def drawn(known: KnownScene, views: int = 16, size: int = 80) -> tuple[ViewSet, ViewSet, np.ndarray]:
    """Views to train on, views to measure on, and the classes of the latter's pixels."""
    volume = known.volume(32)
    train, test = make_views(volume, known.transfer_function(), n=views, size=size, test=4, mapper="cpu")
    assert test is not None
    return train, test, known.class_maps(volume, test.cameras)


def accuracy(scene: Scene, test: ViewSet, classes: np.ndarray, ranges: int) -> list[float]:
    """Intersection over union of each true class with its region, over the pixels of views that belong to a class."""
    maps = np.stack([scene.render(camera, "pcn").region for camera in test.cameras])
    return matched(overlaps(np.where(classes < 0, -2, classes), maps, ranges, len(scene.regions)))


@pytest.fixture(scope="module")
def alike() -> tuple[Scene, ViewSet, ViewSet, np.ndarray]:
    """A ring and three balls of nearly one hue, learned from views alone."""
    known = KnownScene(ring_and_balls, (Range(-0.5, 0.3, 0.9, ORANGE), Range(0.7, 1.5, 0.9, LIKE_ORANGE)))
    train, test, classes = drawn(known)
    train = replace(train, classified=None)
    return train_scene(train, SHORT)[0], train, test, classes


@pytest.fixture(scope="module")
def nested() -> Drawn:
    """Three shells in each other, two of one colour, learned with the volume."""
    parts = Range(0.1, 0.24, 0.12, BLUE), Range(0.38, 0.52, 0.25, RED), Range(0.66, 1.5, 0.9, RED)
    train, _, _ = drawn(KnownScene(shells, parts))
    return train_scene(train, SHORT)[0], train


def test_similar_hues_are_told_apart_by_the_points_that_have_them(
    alike: tuple[Scene, ViewSet, ViewSet, np.ndarray],
) -> None:
    scene, _, test, classes = alike
    assert len(scene.regions) == 2
    assert min(accuracy(scene, test, classes, 2)) > 0.8


def test_hues_that_were_one_region_are_told_apart_by_the_colour_that_was_missing(
    alike: tuple[Scene, ViewSet, ViewSet, np.ndarray],
) -> None:
    both, train, test, classes = alike
    assert len(both.made["confidence"]) == 2
    about = [*both.made["warnings"], "Region 1 may be wrong"]
    scene, _ = correct_palette(
        replace(both, made={**both.made, "warnings": about}), train, Correction(merge=((0, 1),)), SHORT
    )
    assert len(scene.regions) == 1
    assert "confidence" not in scene.made and about[-1] not in scene.made["warnings"]  # they were about the old regions
    assert scene.expected is not None and both.expected is not None
    assert scene.expected.to_json() != both.expected.to_json()
    edited = scene.edited(0, opacity=0.9)
    painted = edited.painted(cube_paint(scene, 1), {0: "ink"}, {}, "ink")
    correction = Correction(colours={0: ORANGE}, add=(LIKE_ORANGE,))
    found, report = correct_palette(painted, train, correction, SHORT)
    assert len(found.regions) == 2
    assert min(accuracy(found.reset(), test, classes, 2)) > 0.8
    for name, value in scene.base.state_dict().items():
        assert torch.equal(found.base.state_dict()[name], value)
    assert [region.opacity for region in found.regions] == [0.9, 1.0]  # who took over a region has its edits
    assert (found.variants, found.networks, found.history.past) == ((), ("base", "pcn"), ())
    assert any("paintings of the old regions dropped: ink" in note for note in report["notes"])
    assert found.made["corrected"][1:] == [report]
    assert set(report["seconds"]) == {"pcn", "sampling", "total"}


@pytest.mark.slow
def test_more_colours_than_dimensions_are_told_apart_by_the_views_alone() -> None:
    """Five opaque layers, whose hues are mixtures of each other; where eq. 4 alone decides, two of them are nowhere."""
    known = SCENES["regions-5"]
    train, test, classes = drawn(known, views=24, size=96)
    longer = replace(SHORT, reconstruct=replace(SHORT.reconstruct, iterations=200, rays=4096),
                     recolour=replace(SHORT.recolour, iterations=250, rays=4096))  # fmt: skip
    scene, _ = train_scene(replace(train, classified=None), longer)
    found = accuracy(scene, test, classes, 5)
    assert len(scene.regions) == 5
    assert min(found) > 0.7


@pytest.mark.slow
def test_merged_ranges_are_one_region_and_split_are_two(nested: Drawn) -> None:
    scene, train = nested
    assert len(scene.regions) == 3 and train.classified is not None
    reds = [k for k, region in enumerate(scene.regions) if region.colour[0] > 0.5]
    split = scene.with_part(0, 0.5)
    territory = no_parts(scene.occupancy.occupied.shape, scene.occupancy.cells).with_part(scene.occupancy.occupied > 0)
    undone = replace(split, parts=territory).undone()
    merged, _ = correct_palette(undone, train, Correction(merge=(tuple(reds),)), SHORT)
    merged = Scene.from_bytes(merged.to_bytes())
    assert len(merged.every_region) == 2
    red = int(np.argmax([region.colour[0] for region in merged.regions]))
    assert len(merged.regions[red].ranges) == 2
    assert merged.regions[red].values == pytest.approx((0.38, 1.5), abs=0.6)
    assert min(region_overlaps(merged, train, train.classified)) > 0.9
    again, _ = correct_palette(merged, train, Correction(split=(red,)), SHORT)
    assert [len(region.ranges) for region in again.regions] == [1, 1, 1]
    assert min(region_overlaps(again, train, train.classified)) > 0.9


def test_a_removed_range_is_part_of_its_neighbour(nested: Drawn) -> None:
    scene, train = nested
    assert train.classified is not None
    middle = int(np.argsort([region.values[0] for region in scene.regions if region.values])[1])
    found, _ = correct_palette(scene, train, Correction(remove=(middle,)), SHORT)
    assert sorted(len(region.ranges) for region in found.regions) == [1, 2]
    assert min(region_overlaps(found, train, train.classified)) > 0.9


@pytest.mark.slow
def test_a_colour_within_a_range_is_where_the_views_show_it() -> None:
    """One range of values whose colour map goes from blue to green is two regions if somebody says so."""
    known = KnownScene(ring_and_balls, (Range(-0.5, 0.3, 0.9, GREEN), Range(0.7, 1.5, 0.9, BLUE)))
    train, test, classes = drawn(known)
    assert train.classified is not None
    owner = np.zeros_like(train.classified.owner)
    whole = replace(train.classified.ranges[0], low=-0.5, high=1.5)
    train = replace(train, classified=replace(train.classified, owner=owner, ranges=(whole,)))
    scene, _ = train_scene(train, SHORT)
    assert len(scene.regions) == 1
    found, report = correct_palette(scene, train, Correction(colours={0: GREEN}, add=(BLUE,)), SHORT)
    assert any("shares the range" in note for note in report["notes"])
    assert min(accuracy(found, test, classes, 2)) > 0.8
    assert region_overlaps(found, train, train.classified) == []
    one, _ = correct_palette(found, train, Correction(merge=((0, 1),)), SHORT)
    assert [region.ranges for region in one.regions] == [scene.regions[0].ranges]


@pytest.mark.slow
def test_a_stopped_correction_goes_on_to_the_same_scene(nested: Drawn, tmp_path: Path, every_step: None) -> None:
    scene, train = nested
    correction = Correction(merge=((0, 1),))
    expected, _ = correct_palette(scene, train, correction, SHORT)
    path = tmp_path / "scene.svv.checkpoint"

    def stop(fraction: float, label: str) -> None:
        if fraction > 0.3 and "loss" in label:
            raise Cancelled

    with pytest.raises(Cancelled):
        correct_palette(scene, train, correction, SHORT, progress=stop, checkpoint=path)
    assert path.exists()
    seen: list[float] = []
    found, _ = correct_palette(scene, train, correction, SHORT, progress=lambda f, _: seen.append(f), checkpoint=path)
    assert seen[0] > 0.2
    assert found.palette_network is not None and expected.palette_network is not None
    for name, value in expected.palette_network.state_dict().items():
        torch.testing.assert_close(found.palette_network.state_dict()[name], value, atol=1e-5, rtol=1e-4)


def test_corrections_that_cannot_be_are_one_sentence(nested: Drawn) -> None:
    scene, train = nested
    some = Correction(merge=((0, 1),))
    with pytest.raises(BadInput, match="no palette network"):
        correct_palette(replace(scene, palette_network=None, regions=()), train, some, SHORT)
    with pytest.raises(BadInput, match="time limit"):
        correct_palette(scene, train, some, SHORT, time_limit=0.0)
    with pytest.raises(BadInput, match="no region 7"):
        correct_palette(scene, train, Correction(remove=(7,)), SHORT)
    with pytest.raises(BadInput, match="Nothing to correct"):
        correct_palette(scene, train, Correction(), SHORT)
    moved = []
    for camera in train.cameras:
        pose = camera.camera_to_world.copy()
        pose[:3, 3] += 1.0
        moved.append(replace(camera, camera_to_world=pose))
    with pytest.raises(BadInput, match="views are of another scene"):
        correct_palette(scene, replace(train, cameras=tuple(moved)), some, SHORT)
