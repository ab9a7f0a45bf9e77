"""N5 datasets, as tensorstore and others write them: values, order of axes, levels, sizes, and damage."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from svv.bricks.opened import open_bricks
from svv.dvr.read.volumes import read_here
from svv.errors import BadInput
from tests.ell_volume import FIRST, STEP, assert_shown, ell

tensorstore = pytest.importorskip("tensorstore")

ORIGIN = (0.0, 0.0, 0.0)


def dataset(folder: Path, values: np.ndarray, packing: str = "gzip", **attributes: Any) -> Path:
    """Write an array (z, y, x) as a dataset, whose first axis is the fastest."""
    shape = list(values.shape[::-1])
    told = {"dataType": values.dtype.name, "dimensions": shape, "blockSize": [8] * len(shape)}
    opened = tensorstore.open(
        {
            "driver": "n5", "kvstore": {"driver": "file", "path": str(folder)},
            "metadata": {**told, "compression": {"type": packing}},
        },
        create=True,
    ).result()  # fmt: skip
    opened[...] = values.transpose()
    add(folder, **attributes)
    return folder


def add(folder: Path, **attributes: Any) -> None:
    """Add attributes to those of a folder."""
    file = folder / "attributes.json"
    file.write_text(json.dumps({**(json.loads(file.read_text()) if file.exists() else {}), **attributes}))


@pytest.mark.parametrize("packing", ["raw", "gzip", "bzip2", "xz"])
@pytest.mark.parametrize("kind", ["u1", "u2", "i4", "f4", "f8"])
def test_datasets_are_in_their_places(tmp_path: Path, packing: str, kind: str) -> None:
    folder = dataset(tmp_path / "a.n5", ell(kind), packing, resolution=STEP.tolist(), units=["um", "um", "um"])
    assert_shown(folder, first=ORIGIN)
    assert open_bricks(folder) is not None


def test_without_a_resolution_a_voxel_is_said_to_be_one(tmp_path: Path) -> None:
    assert_shown(dataset(tmp_path / "a.n5", ell()), (1, 1, 1), ORIGIN, says="no voxel size")


@pytest.mark.parametrize("where", ["group", "levels"])
def test_levels_of_n5_viewer(tmp_path: Path, where: str) -> None:
    group, factors = tmp_path / "a.n5" / "volume", [[1, 1, 1], [2, 2, 1]]
    for k, (x, y, z) in enumerate(factors):
        told = {} if where == "group" else {"downsamplingFactors": factors[k]}
        dataset(group / f"s{k}", ell()[::z, ::y, ::x], **told)
    add(tmp_path / "a.n5", n5="2.0.0")
    add(group, pixelResolution={"unit": "um", "dimensions": STEP.tolist()})
    if where == "group":
        add(group, downsamplingFactors=factors)
    assert_shown(group, first=ORIGIN)
    assert_shown(tmp_path / "a.n5", first=ORIGIN, array="volume")
    source = open_bricks(group)
    assert source is not None
    np.testing.assert_allclose([level.spacing for level in source.levels], [STEP, STEP * [2, 2, 1]])
    np.testing.assert_allclose(source.levels[1].origin, 0.5 * STEP * [1, 1, 0])
    with pytest.raises(BadInput, match=r"is no dataset: name one of .*volume, volume/s0, volume/s1"):
        read_here(tmp_path / "a.n5")


def test_transforms_of_cosem_are_in_the_order_of_python(tmp_path: Path) -> None:
    transform = {
        "axes": ["z", "y", "x"], "scale": STEP[::-1].tolist(), "translate": FIRST[::-1].tolist(), "units": ["nm"] * 3
    }  # fmt: skip
    dataset(tmp_path / "a.n5" / "em" / "s0", ell("u1"), transform=transform)
    add(tmp_path / "a.n5" / "em", multiscales=[])
    assert_shown(tmp_path / "a.n5" / "em")


def test_named_axes_channels_and_time_points(tmp_path: Path) -> None:
    folder = dataset(
        tmp_path / "a.n5", np.stack([ell(), 2 * ell()]), axes=["x", "y", "z", "t"], resolution=[1.5, 2, 3, 1]
    )
    assert_shown(folder, first=ORIGIN, time=1, factor=2.0)
    turned = dataset(tmp_path / "b.n5", ell().transpose(2, 1, 0).copy(), axes=["z", "y", "x"])
    assert_shown(turned, (1, 1, 1), ORIGIN, says="no voxel size")


@pytest.mark.parametrize(
    "damage",
    [
        {"dimensions": [22, 18]}, {"dimensions": [-2, 18, 14]}, {"dimensions": "22"}, {"blockSize": [0, 8, 8]},
        {"dataType": "words"}, {"compression": {"type": "none"}}, {"axes": ["x", "y"]}, {"resolution": [1.0, "a", 2]},
        {"resolution": [float("nan"), 1, 1]}, {"dimensions": [10**12, 18, 14]}, {"dataType": "float64"},
    ],
)  # fmt: skip
def test_damaged_attributes_are_one_sentence(tmp_path: Path, damage: dict[str, Any]) -> None:
    folder = dataset(tmp_path / "a.n5", ell("u2"))
    add(folder, **damage)
    with pytest.raises(BadInput) as caught:
        read_here(folder)
    assert "\n" not in str(caught.value)


def test_damaged_and_missing_blocks_are_told(tmp_path: Path) -> None:
    folder = dataset(tmp_path / "a.n5", ell("u2"))
    for text in ("", "{", "[]", '"a"'):
        (tmp_path / "b").mkdir(exist_ok=True)
        (tmp_path / "b" / "attributes.json").write_text(text)
        with pytest.raises(BadInput):
            read_here(tmp_path / "b")
    blocks = [path for path in folder.rglob("*") if path.is_file() and path.name != "attributes.json"]
    whole = blocks[0].read_bytes()
    for k in range(10):
        blocks[0].write_bytes(whole[: len(whole) * k // 10])
        with pytest.raises(BadInput) as caught:
            read_here(folder)
        assert "\n" not in str(caught.value)
    for block in blocks:
        block.unlink()
    with pytest.raises(BadInput, match="without its blocks"):
        read_here(folder)
