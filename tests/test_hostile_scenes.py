"""Scene files and checkpoints that are damaged or meant to harm: what they say is checked before it is believed."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from campaign.of_scenes import put_together, scenes, small, taken_apart
from svv.core.colour.light import Lamp
from svv.errors import BadInput
from svv.fields.radiance.encodings import LatticeAdam
from svv.fields.radiance.networks import BaseField
from svv.fields.scene.scene import Scene
from svv.io.scene_file import parse_scene, scene_bytes
from svv.io.views.viewset import CLASSIFIED, read_classified
from svv.train.run.checkpoint import Checkpoint
from tests.cube import cube_camera, cube_scene

PLAIN, LIT, PAINTED, PARTS, STEPS = range(5)


def changed(number: int, change: Callable[[dict[str, Any], dict[str, np.ndarray]], object]) -> bytes:
    """A scene whose header and arrays were changed."""
    header, tensors = parse_scene(scenes()[number], "s")
    change(header, tensors)
    return scene_bytes(header, tensors)


def put(*keys: Any, value: Any) -> Callable[[dict[str, Any], object], None]:
    """A change of one value in a header."""

    def change(header: dict[str, Any], tensors: object) -> None:
        place: Any = header
        for key in keys[:-1]:
            place = place[key]
        place[keys[-1]] = value

    return change


def number_in_table(name: str, value: float, header: object, tensors: dict[str, np.ndarray]) -> None:
    array = tensors[name] = tensors[name].copy()
    array.ravel()[3] = value


@pytest.mark.parametrize("number", range(5))
def test_scenes_of_the_campaign_are_valid(number: int) -> None:
    Scene.from_bytes(scenes()[number]).info()


@pytest.mark.parametrize(
    ("number", "keys", "value"),
    [
        (PLAIN, ("box", "low"), [0, 0]), (PLAIN, ("box", "size"), 0), (PLAIN, ("box", "size"), float("nan")),
        (PLAIN, ("box", "extent"), [1, 1, 2]), (PLAIN, ("box", "extent"), [1, 0, 1]),
        (PLAIN, ("box", "low"), [1e400] * 3),
        (PLAIN, ("shape",), [4, 4]), (PLAIN, ("shape",), [4, 4, 5]), (PLAIN, ("shape",), [10**6] * 3),
        (PLAIN, ("cells",), 10**9), (PLAIN, ("cells",), 0), (PLAIN, ("cells",), "4"), (PLAIN, ("cells",), 4.5),
        (PLAIN, ("settings", "width"), 10**5), (PLAIN, ("settings", "features"), 10**9),
        (PLAIN, ("settings", "resolutions"), [4, 2**14]), (PLAIN, ("settings", "resolutions"), [1024]),
        (PLAIN, ("settings", "resolutions"), []), (PLAIN, ("settings", "encoding"), "__class__"),
        (PLAIN, ("settings", "lighting"), 5), (PLAIN, ("settings", "unknown"), 5), (PLAIN, ("settings",), None),
        (PLAIN, ("regions",), [5]), (PLAIN, ("regions", 0, "colour"), [0.1]), (PLAIN, ("regions", 0, "opacity"), "a"),
        (PLAIN, ("regions", 0, "opacity"), float("inf")), (PLAIN, ("regions", 0, "layer"), None),
        (PLAIN, ("regions", 0, "style"), 3), (PLAIN, ("regions", 0, "nothing"), 3), (PLAIN, ("regions", 0, "layer"), 1),
        (PLAIN, ("marching", "step"), 0), (PLAIN, ("marching", "step"), float("nan")), (PLAIN, ("made",), 5),
        (PLAIN, ("images", "stride"), -1), (PLAIN, ("images", "joined"), []), (PLAIN, ("lamp", "azimuth"), "a"),
        (PLAIN, ("networks",), ["styled"]), (PLAIN, ("variants",), [{}] * 1000), (PLAIN, ("history",), {"past": [3]}),
        (LIT, ("normal_resolutions",), [2**14]), (LIT, ("lamp", "direction"), [0, 0, 0]),
        (PAINTED, ("painting",), 7), (PAINTED, ("paint_resolutions",), [4, 8, 16]),
        (PARTS, ("parts", "cells"), 8), (PARTS, ("undone",), [3]), (PARTS, ("regions", 3, "part_of"), 9),
        (STEPS, ("steps", "times"), []), (STEPS, ("steps", "cells"), 2**20), (STEPS, ("steps", "own"), 5),
        (STEPS, ("values", "visible"), [0.9, 0.1]), (STEPS, ("settings", "encoding"), "hash"),
    ],
)  # fmt: skip
def test_a_header_that_lies_is_a_sentence(number: int, keys: tuple[Any, ...], value: Any) -> None:
    told = changed(number, put(*keys, value=value))
    with pytest.raises(BadInput, match="is damaged"):
        Scene.from_bytes(told, "s.svv")


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(
    ("number", "name"), [(PLAIN, "base.colour_mlp.0.weight"), (PLAIN, "base.encoding.table.ends"),
                         (LIT, "pcn.phong.raw"), (STEPS, "extinction_table"), (PLAIN, "pcn.colours")],
)  # fmt: skip
def test_numbers_that_are_not_finite_are_named_where_they_are(number: int, name: str, bad: float) -> None:
    with pytest.raises(BadInput, match=rf"1 of the \d+ numbers in {name} are not finite"):
        Scene.from_bytes(changed(number, partial(number_in_table, name, bad)))


def test_denormal_weights_are_numbers_like_any_other() -> None:
    """They are slow on some processors, but give a picture that is as good as that of zeros."""

    def denormal(value: float, header: object, tensors: dict[str, np.ndarray]) -> None:
        tensors["base.colour_mlp.0.weight"] = np.full_like(tensors["base.colour_mlp.0.weight"], value)

    tiny, zero = (Scene.from_bytes(changed(PLAIN, partial(denormal, value))) for value in (1e-42, 0.0))
    one, other = (scene.render(cube_camera(), network="base").rgba for scene in (tiny, zero))
    assert np.isfinite(one).all() and np.allclose(one, other, atol=1e-6)


@pytest.mark.parametrize("shape", [[10**30, 1], [1, 10**30], [2**31, 2**31], [4.0, 2], [True, 8], [[4], 2], {"a": 1}])
def test_tables_of_lying_sizes_are_a_sentence(shape: object) -> None:
    outer, own, data = taken_apart(small())
    own["deflated"]["b"] = shape
    with pytest.raises(BadInput, match=r"damaged|more than this computer"):
        parse_scene(put_together(outer, own, data), "s.svv")


@pytest.mark.parametrize("kind", ["F8_E5M2", "F4", "C64", "", "f32", "U128"])
def test_types_of_numbers_that_scenes_do_not_have_are_a_sentence(kind: str) -> None:
    outer, own, data = taken_apart(small())
    outer["c"]["dtype"] = kind
    with pytest.raises(BadInput, match="damaged"):
        parse_scene(put_together(outer, own, data), "s.svv")


def test_a_hundred_thousand_arrays_are_a_sentence() -> None:
    names = {f"t{k}": {"dtype": "U8", "shape": [0], "data_offsets": [0, 0]} for k in range(100_000)}
    with pytest.raises(BadInput, match="header"):
        parse_scene(put_together(names, {"version": 3, "header": {}}, b""), "s.svv")


@pytest.mark.parametrize(
    "own", ["[" * 100_000, "{}", "5", '{"version": 99, "header": {}}', '{"version": [], "header": 1}']
)
def test_headers_that_are_none_are_a_sentence(own: str) -> None:
    outer, _, data = taken_apart(small())
    with pytest.raises(BadInput):
        parse_scene(put_together(outer, own, data), "s.svv")


def test_of_keys_that_occur_twice_the_last_counts() -> None:
    outer, own, data = taken_apart(small())
    text = json.dumps(own)
    twice = put_together(outer, text[:-1] + ', "header": {"a": 1}' + "}", data)
    assert parse_scene(twice, "s.svv")[0] == {"a": 1}


def begun(path: Path) -> Callable[[], object]:
    """A checkpoint of a stage in progress; returns what goes on with it."""
    cube = cube_scene()
    network = BaseField(cube.settings, cube.occupancy).requires_grad_(True)
    mlp = torch.optim.Adam(network.colour_mlp.parameters())

    def resume() -> object:
        return Checkpoint(path, {"a": 1}).stage("base", network, mlp, LatticeAdam(network.encodings))

    held = Checkpoint(path, {"a": 1})
    held.finish("carve", {}, {})
    held.stage("base", network, mlp, LatticeAdam(network.encodings)).save(3, 1.0, {})
    return resume


@pytest.mark.parametrize(
    ("key", "value"), [("done", "a"), ("done", None), ("spent", []), ("done", float("inf")), ("spent", 10**300)]
)
def test_a_checkpoint_that_lies_is_a_sentence(tmp_path: Path, key: str, value: object) -> None:
    resume = begun(tmp_path / "c")
    outer, own, data = taken_apart((tmp_path / "c").read_bytes())
    own["header"]["progress"][key] = value
    (tmp_path / "c").write_bytes(put_together(outer, own, data))
    if value == 10**300:
        resume()  # a number like any other
    else:
        with pytest.raises(BadInput, match="delete it"):
            resume()


@pytest.mark.parametrize("key", ["finished", "progress"])
def test_a_checkpoint_without_its_parts_is_another_runs(tmp_path: Path, key: str) -> None:
    resume = begun(tmp_path / "c")
    outer, own, data = taken_apart((tmp_path / "c").read_bytes())
    own["header"][key] = 7
    (tmp_path / "c").write_bytes(put_together(outer, own, data))
    resume()
    assert Checkpoint(tmp_path / "c", {"a": 1}).finished == {}


def test_a_checkpoint_of_another_network_is_a_sentence(tmp_path: Path) -> None:
    resume = begun(tmp_path / "c")
    header, tensors = parse_scene((tmp_path / "c").read_bytes(), "c")
    name = next(name for name in tensors if name.endswith("moments"))
    (tmp_path / "c").write_bytes(scene_bytes(header, {**tensors, name: np.zeros(3, np.float32)}))
    with pytest.raises(BadInput, match="delete it"):
        resume()


@given(st.tuples(*[st.floats(allow_nan=False, allow_infinity=False)] * 3).filter(any))
def test_a_direction_has_a_length_whatever_its_numbers(direction: tuple[float, float, float]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        kept = Lamp(direction=direction).direction
    assert kept is not None
    assert 0 < np.linalg.norm(kept) < np.inf
    largest = int(np.argmax(np.abs(direction)))
    assert np.argmax(np.abs(kept)) == largest and np.sign(kept[largest]) == np.sign(direction[largest])


@pytest.mark.parametrize("short", [MemoryError(), RuntimeError("DefaultCPUAllocator: can't allocate memory")])
def test_files_are_not_damaged_because_memory_is_short(
    short: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever is told that they are deletes hours of work."""

    def fails(*given: object) -> None:
        raise short

    cube_scene().save(tmp_path / "cube.svv")
    (tmp_path / CLASSIFIED).touch()
    (tmp_path / "transforms_train.json").write_text(json.dumps({"svv_classified": CLASSIFIED}))
    resume = begun(tmp_path / "c")
    monkeypatch.setattr("svv.fields.scene.scene_arrays.scene_of", fails)
    monkeypatch.setattr("svv.io.views.viewset.arrays_of_npz", fails)
    monkeypatch.setattr("svv.train.run.checkpoint.StageState._restore", fails)
    for read in (lambda: Scene.load(tmp_path / "cube.svv"), lambda: read_classified(tmp_path), resume):
        with pytest.raises(type(short)) as raised:
            read()
        assert raised.value is short
