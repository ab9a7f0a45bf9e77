"""Names under which ParaView's filters keep results: the same in every process, different for different content."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from svv.core.geometry.cameras import sphere_cameras
from svv.errors import BadInput
from svv.fields.scene.scene import Scene
from svv.io.files.cache import NAME
from svv.io.files.keyed_results import digest, digest_of_file
from svv.io.views.view_meta import ViewMeta
from svv.io.views.viewset import ViewSet
from svv.pv.results.keys import (
    digest_of_edits,
    digest_of_mask,
    digest_of_scene,
    digest_of_views,
    key_in,
    key_of,
    name_of,
    settings_in,
    source_of,
)
from svv.pv.results.time_steps import Moment
from tests.cube import cube_paint, cube_scene

NOW = Moment(digest("settings"), "look", "data")


def test_a_name_says_what_it_is_of_and_is_one_that_a_cache_takes() -> None:
    for kind in ("views", "scene", "palette", "painting"):
        name = name_of(kind, source_of(NOW), NOW.settings)
        assert NAME.fullmatch(name), name
        assert key_in(name) == key_of(NOW) and settings_in(name, kind) == NOW.settings
        assert settings_in(name, "other") == ""
    for foreign in ("", "scene", "scene-x-y", "../scene"):
        assert settings_in(foreign, "scene") == ""


def test_a_digest_is_the_same_in_another_process_and_for_values_that_went_through_a_file() -> None:
    parts = ["text", 0.1, (1, 2.5, None), {"b": 1, "a": [True, "x"]}]
    same = [*parts[:2], [1, 2.5, None], {"a": [True, "x"], "b": 1}]
    script = f"from svv.io.files.keyed_results import digest; print(digest(*{parts!r}))"
    command, environ = [sys.executable, "-c", script], {**os.environ, "PYTHONHASHSEED": "7"}
    said = subprocess.run(command, capture_output=True, text=True, env=environ, check=True)
    assert said.stdout.strip() == digest(*parts) == digest(*same)
    assert digest(np.float64(0.1)) == digest(0.1) != digest(0.1 + 1e-16 * 2)


def test_where_and_when_a_moment_is_does_not_count_in_its_name() -> None:
    assert key_of(replace(NOW, asked=1.0, time=2.0, here="0x1 scene.svv")) == key_of(NOW)
    others = [replace(NOW, look="other"), replace(NOW, data="other"), replace(NOW, settings=digest("other"))]
    assert len({key_of(one) for one in (NOW, *others)}) == 4


def test_views_are_known_by_their_content(tmp_path: Path) -> None:
    images = np.random.default_rng(0).integers(0, 256, (6, 16, 16, 4)).astype(np.uint8)
    cameras = tuple(sphere_cameras(6, (0.0, 0.0, 0.0), 4.0, 0.5, 16))
    meta = ViewMeta(seconds=1.0, bounds=((0.0,) * 3, (1.0,) * 3), other={"key": "before"})
    views = ViewSet(cameras, images, tuple(map(str, range(6))), meta)
    views.write(tmp_path)
    assert digest_of_views(ViewSet.read(tmp_path)) == digest_of_views(views)
    assert digest_of_views(replace(views, meta=replace(meta, seconds=2.0, other={"key": "now"}))) == digest_of_views(
        views
    )
    assert digest_of_views(replace(views, meta=replace(meta, mapper="gpu"))) != digest_of_views(views)
    other = views.images.copy()
    other[0, 0, 0, 0] ^= 1
    assert digest_of_views(replace(views, images=other)) != digest_of_views(views)
    assert digest_of_views(views.take([0, 1, 2])) != digest_of_views(views)


def test_a_scene_is_known_by_what_it_learned_and_not_by_its_edits() -> None:
    scene = Scene.from_bytes(cube_scene().to_bytes())
    edited = scene.edited(0, (1.0, 0.0, 0.0), 0.5).hidden(1)
    again = Scene.from_bytes(scene.to_bytes())
    assert digest_of_scene(edited) == digest_of_scene(scene) == digest_of_scene(again)
    assert digest_of_edits(again) == digest_of_edits(scene) != digest_of_edits(edited)
    painted = scene.painted(cube_paint(scene, 0), {0: "ink"}, {})
    assert digest_of_scene(painted) == digest_of_scene(Scene.from_bytes(painted.to_bytes())) == digest_of_scene(scene)
    assert digest_of_edits(painted) != digest_of_edits(scene)


def test_what_a_scene_gives_out_after_its_file_is_the_same_to_the_bit_ever_after() -> None:
    scene = Scene.from_bytes(cube_scene().to_bytes())
    assert Scene.from_bytes(scene.to_bytes()).to_bytes() == scene.to_bytes()


def test_files_are_known_by_their_content_and_masks_by_their_points_too(tmp_path: Path) -> None:
    one, other = tmp_path / "one.png", tmp_path / "other.png"
    for path in (one, other):
        Image.new("L", (16, 16), 255).save(path)
    assert digest_of_file(one) == digest_of_file(other)
    before = digest_of_mask(one)
    os.utime(one, (1, 1))
    assert digest_of_mask(one) == before
    (tmp_path / "one.json").write_text("{}")
    assert digest_of_mask(one) != before == digest_of_mask(other)
    Image.new("L", (16, 16), 254).save(one)
    assert digest_of_file(one) != digest_of_file(other)
    with pytest.raises(BadInput, match=r"Cannot read .*gone\.png: No such file"):
        digest_of_file(tmp_path / "gone.png")
