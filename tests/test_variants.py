"""Several paintings in one scene: separate colours over one base, one palette and one set of edits."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from svv.errors import BadInput
from svv.fields.scene.model import UNNAMED
from svv.fields.scene.scene import Scene
from svv.fields.scene.variants import LONGEST_NAME
from svv.io import scene_file
from tests.cube import cube_camera, cube_paint

FINER = (16,)
"""Level of a painting beyond the cube's own."""


def image(scene: Scene, network: str | None = None) -> np.ndarray:
    return scene.render(cube_camera(), network).rgba


@pytest.fixture(scope="module")
def two(cube: Scene) -> Scene:
    """Ink on region 0, oil on all and on finer cells; ink is shown."""
    ink = cube.painted(cube_paint(cube, 1), {0: "brush"}, {"seed": 1}, "ink")
    every = {0: "oil", 1: "oil", 2: "canvas"}
    return ink.painted(cube_paint(cube, 2, FINER), every, {"seed": 2}, "oil").with_variant("ink")


def test_a_variant_is_shown_as_if_it_were_the_only_one(cube: Scene, two: Scene) -> None:
    ink = cube.painted(cube_paint(cube, 1), {0: "brush"}, {}, "ink")
    oil = cube.painted(cube_paint(cube, 2, FINER), {0: "oil", 1: "oil", 2: "canvas"}, {}, "oil")
    np.testing.assert_array_equal(image(two), image(ink))
    np.testing.assert_array_equal(image(two.with_variant("oil")), image(oil))
    np.testing.assert_array_equal(image(two, "pcn"), image(cube))
    assert not np.array_equal(image(ink), image(oil))
    assert two.variants == ("ink", "oil")
    assert (two.variant, two.with_variant("oil").variant, cube.variant) == ("ink", "oil", None)
    assert [r.style for r in two.with_variant("oil").regions] == ["oil", "oil", "canvas"]
    assert two.with_variant("oil").made["stylized"] == {"seed": 2}


@given(st.lists(st.sampled_from(["ink", "oil"]), max_size=5))
def test_going_to_and_fro_changes_nothing(two: Scene, names: list[str]) -> None:
    scene = two
    for name in names:
        scene = scene.with_variant(name)
    back = scene.with_variant("ink")
    assert back == two


def test_the_file_holds_all_variants(two: Scene, tmp_path: Path) -> None:
    two.save(tmp_path / "a.svv")
    again = Scene.load(tmp_path / "a.svv")
    assert (again.variants, again.variant, again.regions) == (two.variants, "ink", two.regions)
    assert again.info()["variants"] == {"ink": {"0": "brush"}, "oil": {"0": "oil", "1": "oil", "2": "canvas"}}
    assert again.info()["paint_resolutions"] == (4, 8)
    assert again.with_variant("oil").info()["paint_resolutions"] == (4, 8, 16)
    for name in ("ink", "oil"):
        np.testing.assert_allclose(image(again.with_variant(name)), image(two.with_variant(name)), atol=0.03)
    alone = two.without_variant("oil")
    alone.save(tmp_path / "b.svv")
    table = two.others[0].network.encoding.table
    saved = (tmp_path / "a.svv").stat().st_size - (tmp_path / "b.svv").stat().st_size
    assert saved < 2 * table.numel() + 20_000  # base and palette are there once


def test_edits_stay_when_another_variant_is_shown(two: Scene) -> None:
    """Opacity and lighting everywhere, colour where the palette holds it."""
    edited = two.edited(0, opacity=0.4).edited(1, colour=(1.0, 1.0, 0.0)).edited(2, lighting=0.0)
    assert not np.array_equal(image(edited), image(two))
    oil = edited.with_variant("oil")
    assert [(r.opacity, r.lighting, r.edited_colour) for r in oil.regions] == [
        (r.opacity, r.lighting, r.edited_colour) for r in edited.regions
    ]
    uncoloured = replace(oil, regions=tuple(replace(r, edited_colour=None) for r in oil.regions))
    np.testing.assert_array_equal(image(oil), image(uncoloured))  # the paint covers it
    np.testing.assert_array_equal(image(oil.with_variant("ink")), image(edited))
    np.testing.assert_array_equal(image(edited.undone().undone().undone()), image(two))


def test_the_colour_of_a_styled_region_is_not_edited_and_why(two: Scene) -> None:
    with pytest.raises(BadInput, match="Region 0 is styled: its colours come from the style 'brush', not from the pal"):
        two.edited(0, colour=(1.0, 0.0, 0.0))
    assert two.edited(1, colour=(1.0, 0.0, 0.0)).regions[1].edited_colour == (1.0, 0.0, 0.0)


def test_strength_goes_from_the_palette_to_the_paint(two: Scene) -> None:
    np.testing.assert_allclose(image(two.with_strength(0.0)), image(two, "pcn"), atol=1e-6)
    half = two.with_strength(0.5, 0)
    assert [r.strength for r in half.regions] == [0.5, 1.0, 1.0]
    np.testing.assert_array_equal(image(half.undone()), image(two))


def test_a_dropped_variant_is_gone_and_the_next_is_shown(cube: Scene, two: Scene) -> None:
    oil = two.without_variant("ink")
    assert (oil.variants, oil.variant) == (("oil",), "oil")
    ink = two.without_variant("oil")
    assert (ink.variants, ink.variant) == (("ink",), "ink")
    none = oil.without_variant("oil")
    assert (none.variants, none.networks, none.regions) == ((), ("base", "pcn"), cube.regions)
    np.testing.assert_array_equal(image(none), image(cube))


def test_a_variant_without_a_name_is_replaced(cube: Scene) -> None:
    first = cube.painted(cube_paint(cube, 1), {0: "a"}, {}, cube.free_name(None))
    again = first.painted(cube_paint(cube, 2), {1: "b"}, {}, first.free_name(None))
    assert again.variants == (UNNAMED,)
    assert [r.style for r in again.regions] == [None, "b", None]


@pytest.mark.parametrize("name", ["", "  ", "a\nb", "x" * (LONGEST_NAME + 1)])
def test_names_that_cannot_be(cube: Scene, name: str) -> None:
    with pytest.raises(BadInput, match="name must be"):
        cube.free_name(name)


def test_variants_that_cannot_be_are_one_sentence(cube: Scene, two: Scene) -> None:
    with pytest.raises(BadInput, match="already a variant 'ink'"):
        two.free_name("ink")
    with pytest.raises(BadInput, match="no variant 'gold': the scene has ink, oil"):
        two.with_variant("gold")
    with pytest.raises(BadInput, match="no variant 'gold'"):
        two.without_variant("gold")
    with pytest.raises(BadInput, match="never painted"):
        cube.with_variant("ink")


def test_styled_scenes_of_the_format_before_are_read(
    cube: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    painted = cube.painted(cube_paint(cube, 1), {0: "brush"}, {}, None).edited(1, opacity=0.5)
    header, arrays = painted.to_arrays()
    old = {k: v for k, v in header.items() if k not in ("history", "painting", "variants", "paint_resolutions")}
    old["regions"] = [{k: v for k, v in r.items() if k not in ("hidden", "ranges")} for r in old["regions"]]
    with monkeypatch.context() as patch:
        patch.setattr(scene_file, "FORMAT_VERSION", 2)
        scene_file.write_scene_file(tmp_path / "old.svv", old, arrays)
    again = Scene.load(tmp_path / "old.svv")
    assert (again.regions, again.variants, again.history.past) == (painted.regions, (UNNAMED,), ())
    np.testing.assert_allclose(image(again), image(painted), atol=0.03)


@pytest.mark.parametrize("damage", ["styles", "network", "name"])
def test_damaged_variants_are_refused(two: Scene, tmp_path: Path, damage: str) -> None:
    header, arrays = two.to_arrays()
    told = dict(header["variants"][0])
    if damage == "styles":
        told["styles"] = ["oil"]
    elif damage == "name":
        del told["name"]
    else:
        arrays = {k: v for k, v in arrays.items() if not k.startswith("variant0")}
    scene_file.write_scene_file(tmp_path / "a.svv", {**header, "variants": [told]}, arrays)
    with pytest.raises(BadInput, match="damaged"):
        Scene.load(tmp_path / "a.svv")


@pytest.mark.parametrize("levels", [[0], [4, 8, 10**6], [-1], "x", {"a": 1}, [4, 8]])
def test_levels_of_paint_that_cannot_be_are_refused(two: Scene, tmp_path: Path, levels: object) -> None:
    header, arrays = two.with_variant("oil").to_arrays()
    scene_file.write_scene_file(tmp_path / "a.svv", {**header, "paint_resolutions": levels}, arrays)
    with pytest.raises(BadInput, match="damaged"):
        Scene.load(tmp_path / "a.svv")


def test_a_copy_on_another_device_has_all_variants(two: Scene) -> None:
    there = two.on(torch.device("meta"))
    assert {p.device.type for v in there.every_variant for p in v.network.parameters()} == {"meta"}
    assert there.variants == two.variants
