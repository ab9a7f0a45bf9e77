"""Single values far from all others: hot voxels, dead pixels of a detector, fill values."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

pytest.importorskip("vtkmodules")

from svv.cli.app import app
from svv.dvr.draw.tables import is_resolved, limits
from svv.dvr.draw.views import make_views, render_views
from svv.dvr.functions.histogram import default_transfer_function, usual_range
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.grids import from_array
from svv.errors import BadInput
from svv.io.views.empty_views import check_shown, empty_views
from svv.io.views.viewset import ViewSet
from svv.train.pipeline import train_scene
from tests.nightly import nightly

BLOB = np.exp(-sum(np.square((a - c) / s) for a, c, s in zip(np.mgrid[:30, :26, :22], (14, 12, 9), (8, 6, 4))))
VALUES = (200 * BLOB).astype(np.float32)
"""From nearly 0 to nearly 200."""

CORNER = (0, 0, 0)
HOT = (1e4, 32767.0, -32768.0, -9999.0, 2e8, -1e20, 3e38)

PLACED = {
    "ramp": [(0, 0), (40, 0), (200, 0.6)],
    "bump": [(95, 0), (100, 0.9), (105, 0)],
    "step": [(0, 0), (100, 0), (100, 0.5), (200, 0.5)],
    "two bumps": [(20, 0), (22, 0.2), (24, 0), (150, 0), (151, 0.9), (152, 0)],
}


def function(points: list[tuple[float, float]]) -> TransferFunction:
    return TransferFunction([(0, 0, 0, 1), (200, 1, 0, 0)], [(value, opacity, 0.5, 0) for value, opacity in points])


STRETCHED = TransferFunction.from_dict({"Name": "plain", "RGBPoints": [0, 0, 0, 1, 200, 1, 0, 0]})


def with_value(value: float, at: tuple[int, int, int] = CORNER, dtype: str = "f4") -> np.ndarray:
    values = VALUES.astype(dtype)
    values[at] = value
    return values


def premultiplied(views: ViewSet) -> np.ndarray:
    images = views.images.astype(float)
    return np.concatenate([images[..., :3] * images[..., 3:] / 255, images[..., 3:]], axis=-1)


def drawn(values: np.ndarray, tf: TransferFunction | None, mapper: str) -> ViewSet:
    return make_views(from_array(values), tf, n=3, test=0, size=32, mapper=mapper, frame="whole", step=0.25)[0]


@pytest.mark.parametrize("value", HOT)
def test_an_outlier_does_not_change_the_default_function(value: float) -> None:
    hot = from_array(with_value(value))
    usual = usual_range(hot)
    clean = default_transfer_function(from_array(VALUES))
    assert usual is not None and (usual.beyond, usual.count) == (1, VALUES.size)
    rest = np.delete(VALUES.ravel(), 0)
    assert (usual.low, usual.high) == (rest.min(), rest.max())
    found = default_transfer_function(hot, usual)
    assert [p[1] for p in found.opacities] == [p[1] for p in clean.opacities]
    np.testing.assert_allclose([p[0] for p in found.opacities], [p[0] for p in clean.opacities], atol=200 / 256)
    # What is beyond has the colour and the opacity of the end.
    end = usual.high if value > 0 else usual.low
    assert found.opacity_at(value) == found.opacity_at(end) and (found.colour_at(value) == found.colour_at(end)).all()


def test_several_outliers_at_both_ends_and_a_dead_pixel_are_left_out() -> None:
    values = with_value(1e20)
    values[3, 3, 3], values[4, 9, 9], values[8, 2, 2] = 1e6, -1e6, -9999.0
    usual = usual_range(from_array(values))
    assert usual is not None and usual.beyond == 4 and usual.high <= 200 and usual.low >= 0
    values = VALUES.copy()
    values[:, 20, 2] = 65535.0
    usual = usual_range(from_array(values))
    assert usual is not None and usual.beyond == len(values)
    assert str(usual).startswith("30 voxels of 17,160 (as far as 65535) lie far beyond the others, which run from ")


def test_fill_values_are_outliers_however_many_they_are() -> None:
    values = VALUES.copy()
    values[:12] = 1e20
    usual = usual_range(from_array(values))
    assert usual is not None and usual.beyond == 12 * 26 * 22 and usual.high <= 200


NOISE = np.random.default_rng(0).random((40, 40, 40)).astype(np.float32)
FAR = np.sqrt(sum(np.square(a - 19.5) for a in np.mgrid[:40, :40, :40]))
SPARSE = np.zeros_like(NOISE)
SPARSE.flat[::997] = 100 + 100 * NOISE.flat[::997]
VESSELS = NOISE.copy()
VESSELS.reshape(40, -1)[:, ::197] = 30.0
CLEAN = {
    "blob": VALUES,
    "noise": NOISE,
    "a small bright tumour in noise": np.where(FAR < 2, np.float32(100), NOISE),
    "a small smooth tumour in noise": NOISE + 100 * np.exp(-np.square(FAR / 1.5)),
    "one bright voxel in nothing": np.where(np.arange(64000) == 7, 1.0, 0.0).reshape(40, 40, 40),
    "99.9 % nothing": SPARSE,
    "vessels of half a percent": VESSELS,
    "a long tail": np.random.default_rng(0).lognormal(0, 1.5, NOISE.shape),
    "labels": np.where(FAR < 5, 500, 2 * (FAR < 15)).astype(np.uint16),
    "a mask": (FAR < 9).astype(np.uint8),
}


@pytest.mark.parametrize("name", CLEAN)
def test_volumes_without_outliers_keep_their_default(name: str) -> None:
    assert usual_range(from_array(CLEAN[name])) is None


def test_the_object_of_a_sparse_volume_stays_beside_an_outlier() -> None:
    values = SPARSE.copy()
    values[3, 3, 3] = 1e6
    usual = usual_range(from_array(values))
    assert usual is not None and (usual.low, usual.high, usual.beyond) == (0.0, float(SPARSE.max()), 1)


@pytest.mark.parametrize(
    ("name", "mapper"),
    nightly(
        itertools.product([None, *PLACED], ["bricks", "cpu", "gpu"]),
        *((name, "bricks") for name in PLACED), (None, "cpu"), ("bump", "cpu"), ("step", "gpu"),
    ),
)  # fmt: skip
def test_no_outlier_changes_the_views(name: str | None, mapper: str, request: pytest.FixtureRequest) -> None:
    if mapper == "gpu":
        request.getfixturevalue("off_screen")
    tf = None if name is None else function(PLACED[name])
    cleans = {used: premultiplied(drawn(VALUES, tf, used)) for used in {mapper, "bricks"}}
    for value in HOT:
        hot = drawn(with_value(value), tf, mapper)
        away, clean = premultiplied(hot), cleans[str(hot.meta.mapper)]
        assert clean[..., 3].mean() > 2.0
        # The cell with the outlier, in a corner, is seen in some pixels.
        assert abs(away[..., 3].mean() / clean[..., 3].mean() - 1) < 0.03, value
        assert np.median(np.abs(away - clean)[clean[..., 3] > 20]) <= 2.0, value
        if hot.meta.mapper != mapper:
            assert hot.meta.mapper == "bricks" and "do not tell the steps of" in str(hot.meta.assumed)
        assert ("1 voxel of 17,160" in str(hot.meta.assumed)) == (name is None)


def test_integers_and_other_images_of_a_volume_with_an_outlier() -> None:
    tf = function([(95, 0), (100, 0.9), (105, 0)])
    views = drawn(VALUES.astype("i4"), tf, "cpu")
    hot = with_value(2e8, dtype="i4")
    assert abs(drawn(hot, tf, "cpu").images.mean() - views.images.mean()) < 0.02 * views.images.mean()
    images = render_views(from_array(hot), tf, views.cameras, "cpu", step=0.25)
    assert abs(images.mean() - views.images.mean()) < 0.02 * views.images.mean()
    wide = with_value(-32768, dtype="i2")
    wide[1, 1, 1] = 32767
    assert abs(drawn(wide, tf, "cpu").images.mean() - drawn(VALUES.astype("i2"), tf, "bricks").images.mean()) < 0.5


@pytest.mark.parametrize("caster", ["cpu", "gpu"])
def test_ordinary_functions_are_resolved(caster: str) -> None:
    for points in PLACED.values():
        assert is_resolved(caster, function(points), (0.0, 200.0), "f4", VALUES)
    labels = function([(0, 0), (4.6, 0), (5, 1), (5.4, 0), (200, 0)])
    assert is_resolved(caster, labels, (0.0, 255.0), "u1", np.arange(256))


@pytest.mark.parametrize("name", PLACED)
@pytest.mark.parametrize("value", HOT)
def test_values_limited_for_the_ranks_of_a_parallel_run_are_resolved(name: str, value: float) -> None:
    tf, span = function(PLACED[name]), (min(0.0, value), max(200.0, value))
    low, high = limits(tf, span, "f4")
    assert span[0] <= low <= 0.0 and 200.0 <= high <= span[1]
    for at in (value, *np.linspace(0, 200, 50)):  # what is beyond looks as the limits do
        assert tf.opacity_at(at) == tf.opacity_at(np.clip(at, low, high))
    assert is_resolved("cpu", tf, (low, high), "f4", np.empty(0)) or name == "two bumps"
    assert limits(tf, (0.0, 200.0), "f4") == (0.0, 200.0)


def test_a_function_stretched_over_outliers_is_told() -> None:
    said = drawn(with_value(1e6), STRETCHED, "bricks").meta.assumed
    assert said is not None and said.startswith("1 voxel of 17,160 (at 1e+06) lies far beyond the others, which run ")
    assert "'plain' shows 0.01% of the voxels" in said and 'give it "Points" at values of the data' in said
    said = drawn(with_value(-9999.0), STRETCHED, "bricks").meta.assumed
    assert said is not None and "'plain' shows 99.99% of the voxels" in said
    assert drawn(VALUES, STRETCHED, "bricks").meta.assumed is None
    assert drawn(with_value(1e6), function(PLACED["ramp"]), "bricks").meta.assumed is None


def test_nothing_is_learned_from_views_that_show_nothing() -> None:
    views = drawn(VALUES, function(PLACED["ramp"]), "bricks")
    assert check_shown(views) is None
    few = replace(views, images=views.images * np.array([0, 1, 0], np.uint8)[:, None, None, None])
    assert str(empty_views(few)).startswith("2 of 3 views (r_0000, r_0002) show nothing: check the transfer function")
    for colour, how in ((0, "transparent"), (255, "of one colour")):
        none = replace(views, images=np.full_like(views.images, colour))
        with pytest.raises(BadInput, match=f"None of the 3 views shows anything: all are {how} throughout; check"):
            train_scene(none, "draft")


def test_commands_tell_and_refuse(tmp_path: Path) -> None:
    np.save(tmp_path / "hot.npy", with_value(1e9))
    (tmp_path / "plain.json").write_text(json.dumps(STRETCHED.to_dict()))
    small = ["--n", "4", "--test", "0", "--size", "24"]
    tf = ["--tf", str(tmp_path / "plain.json")]
    made = CliRunner().invoke(app, ["views", str(tmp_path / "hot.npy"), *tf, "-o", str(tmp_path / "views"), *small])
    assert made.exit_code == 0 and "1 voxel of 17,160 (at 1e+09) lies far beyond the others" in made.output
    assert "of 4 views (r_0000, " in made.output or "None of the 4 views shows anything" in made.output
    none = ViewSet.read(tmp_path / "views", "train")
    replace(none, images=np.zeros_like(none.images)).write(tmp_path / "none", "train")
    for arguments in (["train", "-o", str(tmp_path / "a.svv")], ["run", "-o", str(tmp_path / "out")]):
        refused = CliRunner().invoke(app, [arguments[0], str(tmp_path / "none"), *arguments[1:], "--preset", "draft"])
        assert isinstance(refused.exception, BadInput) or refused.exit_code == 2
        assert "None of the 4 views shows anything" in f"{refused.exception} {refused.output}"
    assert not (tmp_path / "a.svv").exists()
