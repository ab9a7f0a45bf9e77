"""Metadata of view sets: any JSON is either read or refused, and metadata that was read is written unchanged."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from svv.core.colour.shading import Shading
from svv.core.geometry.cameras import CameraRig, sphere_cameras
from svv.errors import BadInput
from svv.io.views.view_meta import ViewMeta, VolumeGrid, known
from svv.io.views.viewset import ViewSet, read_meta
from tests.any_json import any_json

WHOLE: dict[str, object] = {
    "volume": "engine.mhd",
    "grid": {
        "dimensions": [256, 256, 128],
        "spacing": [1.0, 1.0, 2.0],
        "origin": [0.0, -1.0, 0.5],
        "direction": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        "type": "uint8",
        "range": [0.0, 255.0],
    },
    "bounds": [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]],
    "rig": {"centre": [127.5, 127.5, 127.0], "radius": 500.0, "fov_x": 0.5235987755982988},
    "tf": {"Name": "bone", "ColorSpace": "Lab", "RGBPoints": [0.0, 0.0, 0.0, 0.0], "Points": [0.0, 0.0, 0.5, 0.0]},
    "tf_rescaled": False,
    "shading": {"on": True, "ambient": 0.1, "diffuse": 0.7, "specular": 0.2, "specular_power": 10.0},
    "sample_distance": 0.5,
    "mapper": "cpu",
    "vtk": "9.4.1",
    "seconds": 11.25,
}
"""As the first version wrote it."""

finite = st.floats(allow_nan=False, allow_infinity=False)
vectors = st.tuples(finite, finite, finite)
whole = st.integers(1, 4096)
rigs = st.builds(CameraRig, vectors, st.floats(0.0, 1e9), st.floats(1e-3, 3.1), st.none() | st.tuples(whole, whole))
grids = st.builds(
    VolumeGrid, st.tuples(whole, whole, whole), vectors, vectors, st.tuples(vectors, vectors, vectors), st.text(),
    st.tuples(finite, finite),
)  # fmt: skip
presets = st.dictionaries(st.text(max_size=3), finite | st.text(max_size=3) | st.lists(finite, max_size=3), max_size=3)
unknown = st.dictionaries(st.text(max_size=3).map("x_{}".format), finite | st.text() | presets, max_size=3)
metas = st.builds(
    ViewMeta, st.text(), st.none() | grids, st.none() | st.tuples(vectors, vectors), st.none() | rigs,
    st.none() | presets, st.none() | st.booleans(),
    st.none() | st.builds(Shading, st.booleans(), *[st.floats(0.0, allow_infinity=False)] * 4), st.none() | finite,
    st.none() | st.text(), st.none() | st.text(), st.none() | finite, st.none() | st.booleans(), st.none() | st.text(),
    unknown, file=st.none() | st.fixed_dictionaries({"content": st.text()}, optional={"array": st.text()}),
)  # fmt: skip


def objects_like(example: dict[str, object]) -> st.SearchStrategy[object]:
    """JSON objects with some of an example's keys and others, some of whose values are as they should be."""
    keys = {
        key: st.just(value) | any_json | (objects_like(value) if isinstance(value, dict) else st.nothing())
        for key, value in example.items()
    }
    known_keys: st.SearchStrategy[dict[str, object]] = st.fixed_dictionaries({}, optional=keys)
    others = st.dictionaries(st.text(max_size=4), any_json, max_size=2)
    return st.builds(lambda other, own: {**other, **own}, others, known_keys)


def foreign(folder: Path, **keys: object) -> None:
    """A set of three views as other programs write it, with these keys in its JSON file."""
    frames = []
    for number, camera in enumerate(sphere_cameras(3, (0.0, 0.0, 0.0), 4.0, 0.5, 8)):
        file = folder / "train" / f"r_{number}.png"
        file.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(np.full((8, 8, 4), (250, 200, 200, 200), np.uint8)).save(file)
        frames.append({"file_path": f"./train/r_{number}", "transform_matrix": camera.camera_to_world.tolist()})
    (folder / "transforms_train.json").write_text(json.dumps({"camera_angle_x": 0.5, "frames": frames, **keys}))


@given(metas)
def test_what_is_known_is_the_same_after_json(meta: ViewMeta) -> None:
    assert ViewMeta.from_json(json.loads(json.dumps(meta.to_json()))) == meta


@given(any_json | objects_like({**WHOLE, "assumed": "nothing"}))
def test_any_json_is_read_or_refused_and_written_as_it_was(content: object) -> None:
    try:
        meta = ViewMeta.from_json(content)
    except BadInput as error:
        refused = str(error)
    else:
        refused = ""
        assert sorted_json(meta.to_json()) == sorted_json({} if content is None else content)
    assert refused == "" or (refused.endswith(".") and "\n" not in refused)


def sorted_json(content: object) -> str:
    """Text by which JSON values are compared, NaN included."""
    return json.dumps(content, sort_keys=True)


def test_the_first_versions_views_are_read() -> None:
    meta = ViewMeta.from_json(WHOLE)
    assert meta.other == {} and meta.to_json() == WHOLE
    assert known(meta.grid, "grid").dimensions == (256, 256, 128)
    assert known(meta.rig, "rig") == CameraRig((127.5, 127.5, 127.0), 500.0, 0.5235987755982988)
    assert known(meta.shading, "shading") == Shading(True, 0.1, 0.7, 0.2, 10.0)
    assert (meta.tf, meta.mapper, meta.seconds, meta.assumed) == (WHOLE["tf"], "cpu", 11.25, None)


@pytest.mark.parametrize("name", ["ambient", "diffuse", "specular", "specular_power"])
@pytest.mark.parametrize("value", [-0.5, float("nan"), float("inf")])
def test_shading_that_cannot_be_is_refused(name: str, value: float) -> None:
    """Views were drawn with it: black where less light than none fell, and everywhere if it was no number."""
    with pytest.raises(BadInput, match=rf"The {name.replace('_', ' ')} of .* at least 0, not"):
        Shading(**{name: value})


def test_unknown_keys_survive_a_folder_and_a_change(tmp_path: Path) -> None:
    """Those of a newer version, in objects that are known as well."""
    newer = {**WHOLE, "rig": {**WHOLE["rig"], "roll": 0.1}, "denoised": {"by": 3}, "key": "a-b"}  # type: ignore[dict-item]
    foreign(tmp_path, svv=newer)
    views = ViewSet.read(tmp_path)
    changed = replace(views, meta=replace(views.meta, seconds=1.0, rig=CameraRig((0.0, 0.0, 0.0), 1.0, 0.5)))
    changed.write(tmp_path / "again")
    expected = {**newer, "seconds": 1.0, "rig": {"centre": [0.0] * 3, "radius": 1.0, "fov_x": 0.5, "roll": 0.1}}
    assert json.loads((tmp_path / "again" / "transforms_train.json").read_text())["svv"] == expected


@pytest.mark.parametrize("keys", [{}, {"svv": None}, {"svv": {}}])
def test_other_peoples_sets_say_nothing(tmp_path: Path, keys: dict[str, object]) -> None:
    foreign(tmp_path, **keys)
    assert ViewSet.read(tmp_path).meta == read_meta(tmp_path) == ViewMeta()
    with pytest.raises(BadInput, match="do not state their rig"):
        known(read_meta(tmp_path).rig, "rig")


def broken(*path: str, value: object) -> dict[str, object]:
    """The whole, but for one value."""
    first, *rest = path
    inner = WHOLE.get(first)
    return {**WHOLE, first: {**inner, rest[0]: value} if rest and isinstance(inner, dict) else value}


@pytest.mark.parametrize("reader", [ViewSet.read, read_meta])
@pytest.mark.parametrize(
    ("svv", "said"),
    [
        ([1], "svv must be an object"),
        (broken("seconds", value="eleven"), "svv.seconds must be a finite number"),
        (broken("seconds", value=10**400), "a number in it is too large"),
        (broken("sample_distance", value=float("nan")), "svv.sample_distance must be a finite number"),
        (broken("tf", value=[]), "svv.tf must be an object"),
        (broken("tf_rescaled", value=1), "svv.tf_rescaled must be true or false"),
        (broken("mapper", value=3), "svv.mapper must be text"),
        (broken("bounds", value=[[0.0, 1.0, 2.0]]), "svv.bounds must be a list of 2 values"),
        (broken("shading", "on", value="yes"), "svv.shading.on must be true or false"),
        (broken("shading", value={"on": True}), "svv.shading needs ambient"),
        (broken("grid", "dimensions", value=[1.5, 2, 3]), "svv.grid.dimensions must be a whole number"),
        (broken("grid", "direction", value=[[1.0, 0.0, 0.0]]), "svv.grid.direction must be a list of 3 values"),
        (broken("rig", "centre", value=None), "svv.rig.centre must be a list of 3 values"),
        (broken("rig", "fov_x", value=4.0), "fov_x of a camera rig must lie between"),
    ],
)
def test_a_broken_value_is_refused_in_one_sentence(
    tmp_path: Path, reader: Callable[[Path], object], svv: object, said: str
) -> None:
    """With the names of the file and of the key."""
    foreign(tmp_path, svv=svv)
    with pytest.raises(BadInput, match=re.escape(said)) as refused:
        reader(tmp_path)
    assert str(tmp_path / "transforms_train.json") in str(refused.value)
    assert str(refused.value).endswith(".") and "\n" not in str(refused.value)
