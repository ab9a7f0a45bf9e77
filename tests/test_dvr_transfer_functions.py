"""Transfer functions: presets, bumps, defaults, and refused inputs."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("vtkmodules")

from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction
from vtkmodules.vtkRenderingCore import vtkColorTransferFunction

from svv.dvr.functions.histogram import default_transfer_function
from svv.dvr.functions.transfer_functions import COLOUR_SPACES, TransferFunction, unit_distance_for
from svv.dvr.read.grids import from_array, level_of_image
from svv.errors import BadInput

PRESET = {
    "Name": "two",
    "ColorSpace": "RGB",
    "RGBPoints": [0, 0, 0, 0, 10, 1, 0.5, 0],
    "Points": [0, 0, 0.5, 0, 4, 0.8, 0.5, 0, 6, 0, 0.5, 0, 10, 0, 0.5, 0],
}


def preset(**changes: object) -> TransferFunction:
    return TransferFunction.from_dict({**PRESET, **changes})


def test_a_preset_is_read_as_paraview_means_it() -> None:
    for data in (PRESET, [PRESET]):
        tf = TransferFunction.from_dict(data)
        assert tf.name == "two" and tf.range == (0.0, 10.0) and tf.unit_distance is None
        np.testing.assert_allclose(tf.opacity_at([-1, 0, 2, 4, 5, 6, 11]), [0, 0, 0.4, 0.8, 0.4, 0, 0])
        np.testing.assert_allclose(tf.colour_at([0, 5, 99]), [[0, 0, 0], [0.5, 0.25, 0], [1, 0.5, 0]])


def test_without_points_opacity_is_paraviews_ramp() -> None:
    tf = TransferFunction.from_dict({key: PRESET[key] for key in ("ColorSpace", "RGBPoints")})
    np.testing.assert_allclose(tf.opacity_at([0, 2.5, 10]), [0, 0.25, 1])


def test_midpoint_and_sharpness_shape_the_way() -> None:
    tf = preset(Points=[0, 0, 0.2, 0, 10, 1, 0.5, 0])
    np.testing.assert_allclose(tf.opacity_at([1, 2, 10]), [0.25, 0.5, 1])
    sharp = preset(Points=[0, 0, 0.5, 1, 10, 1, 0.5, 0])
    np.testing.assert_allclose(sharp.opacity_at([1, 5, 9]), [0, 0.5, 1], atol=1e-6)


@pytest.mark.parametrize(
    ("space", "middle"),
    [
        ("RGB", (0.5, 0.5, 0)),
        ("HSV", (1, 1, 0)),
        ("Step", (0, 1, 0)),
        ("Lab", None),
        ("Lab/CIEDE2000", None),
        ("Diverging", None),
    ],
)
def test_colour_spaces(space: str, middle: tuple | None) -> None:
    """Half way from red to green: olive in RGB, yellow along the hues, green in steps."""
    tf = preset(ColorSpace=space, RGBPoints=[0, 1, 0, 0, 10, 0, 1, 0])
    if middle is not None:
        np.testing.assert_allclose(tf.colour_at(5), middle, atol=1e-6)
    else:
        assert np.abs(tf.colour_at(5) - preset(RGBPoints=[0, 1, 0, 0, 10, 0, 1, 0]).colour_at(5)).max() > 0.05


def test_paraviews_blue_to_red_rainbow_has_green_in_the_middle() -> None:
    tf = preset(ColorSpace="HSV", RGBPoints=[0, 0, 0, 1, 1, 1, 0, 0])
    np.testing.assert_allclose(tf.colour_at(0.5), (0, 1, 0), atol=1e-6)


def test_two_points_of_one_value_make_a_jump() -> None:
    tf = preset(Points=[0, 0, 0.5, 0, 5, 0, 0.5, 0, 5, 0.9, 0.5, 0, 10, 0.9, 0.5, 0])
    np.testing.assert_allclose(tf.opacity_at([4.99, 5.01]), [0, 0.9], atol=1e-6)


unit = st.floats(0, 1)


@settings(max_examples=40, deadline=None)
@given(
    values=st.lists(st.floats(-1e9, 1e9), min_size=1, max_size=6, unique=True),
    data=st.data(),
    space=st.sampled_from(["RGB", "HSV", "Lab", "Diverging", "Lab/CIEDE2000", "Step"]),
    distance=st.one_of(st.none(), st.floats(1e-9, 1e9)),
)
def test_json_round_trip(values: list[float], data: st.DataObject, space: str, distance: float | None) -> None:
    def points() -> tuple:
        return tuple((v, data.draw(unit), data.draw(unit), data.draw(unit)) for v in sorted(values))

    tf = TransferFunction(points(), points(), distance, "any", space)
    assert TransferFunction.from_dict(json.loads(json.dumps([tf.to_dict()]))) == tf


def test_bumps_are_triangles_of_one_colour_each(tmp_path: Path) -> None:
    bumps = [
        {"centre": 10, "width": 4, "opacity": 0.2, "colour": [1, 0, 0]},
        {"centre": 20, "width": 6, "opacity": 0.8},
    ]
    (tmp_path / "tf.json").write_text(json.dumps({"Name": "b", "bumps": bumps, "ScalarOpacityUnitDistance": 2}))
    tf = TransferFunction.read(tmp_path / "tf.json")
    assert tf.name == "b" and tf.unit_distance == 2
    assert replace(TransferFunction.from_dict(bumps), name="b", unit_distance=2) == tf, "the list alone"
    values = [8, 9, 10, 11, 12, 15, 17, 18.5, 20, 23]
    np.testing.assert_allclose(tf.opacity_at(values), [0, 0.1, 0.2, 0.1, 0, 0, 0, 0.4, 0.8, 0])
    np.testing.assert_allclose(tf.colour_at([8, 10, 12]), [[1, 0, 0]] * 3)
    assert np.abs(tf.colour_at(20) - tf.colour_at(10)).max() > 0.5


def test_where_bumps_overlap_the_larger_opacity_holds() -> None:
    tf = TransferFunction.from_bumps(
        [{"centre": 10, "width": 8, "opacity": 0.5}, {"centre": 12, "width": 8, "opacity": 0.5}]
    )
    np.testing.assert_allclose(tf.opacity_at([10, 11, 12]), [0.5, 0.375, 0.5])


@settings(max_examples=30, deadline=None)
@given(scale=st.floats(1e-6, 1e6), offset=st.floats(-1e6, 1e6), value=st.floats(-2, 12))
def test_mapping_moves_the_values_and_nothing_else(scale: float, offset: float, value: float) -> None:
    if scale < 1e-9 * abs(offset):
        return  # the points fall together in floating point
    moved = preset().mapped(scale, offset)
    at = scale * value + offset
    np.testing.assert_allclose(moved.opacity_at(at), preset().opacity_at((at - offset) / scale), atol=1e-5)


def test_rescaling_follows_its_rule() -> None:
    unit_preset = preset(RGBPoints=[0, 0, 0, 0, 1, 1, 1, 1], Points=[0, 0, 0.5, 0, 1, 0.5, 0.5, 0])
    assert unit_preset.fitted(0, 200).range == (0, 200)
    assert unit_preset.fitted(0, 1e-3).range == (0, 1e-3)
    assert unit_preset.fitted(0, 1.2).range == (0, 1)
    assert unit_preset.fitted(0, 200, rescale=False).range == (0, 1)
    assert preset().fitted(0, 200).range == (0, 10)
    assert [unit_preset.is_stretched(0, high) for high in (200, 1.2)] == [True, False]
    stretched = preset().fitted(-100, 100, rescale=True)
    np.testing.assert_allclose(stretched.opacity_at([-100, -20, 20, 100]), [0, 0.8, 0, 0], atol=1e-9)


JET = {"Name": "Jet", "ColorSpace": "RGB", "RGBPoints": [-1, 0, 0, 0.5, 0.5, 1, 1, 0, 1, 0.5, 0, 0]}


@pytest.mark.parametrize(("low", "high"), [(-1000, 1000), (100, 300), (-1, 1), (0, 0.9), (101325, 101326)])
def test_a_preset_without_opacity_points_is_stretched_over_any_data(low: float, high: float) -> None:
    """As ParaView does with *Use preset range* off: the preset's values mean nothing."""
    tf = TransferFunction.from_dict([JET])
    assert not tf.placed and TransferFunction.from_dict(json.loads(json.dumps(tf.to_dict()))) == tf
    fitted = tf.fitted(low, high)
    assert fitted.placed and fitted.range == (low, high) and tf.is_stretched(low, high)
    shares = np.array([0.0, 0.25, 0.75, 1.0])
    at = low + shares * (high - low)
    np.testing.assert_allclose(fitted.opacity_at(at), shares, atol=1e-9)
    np.testing.assert_allclose(fitted.colour_at(at), tf.colour_at(2 * shares - 1), atol=1e-6)
    assert tf.fitted(-0.5, 0.8, rescale=False).range == (-1, 1)


def test_a_function_from_minus_one_to_one_is_stretched_over_data_elsewhere() -> None:
    tf = TransferFunction.from_dict({**JET, "Points": [-1, 0, 0.5, 0, 1, 1, 0.5, 0]})
    assert [tf.fitted(*data).range for data in ((-1000, 1000), (0, 10), (0.3, 0.4))] == [
        (-1000, 1000),
        (0, 10),
        (0.3, 0.4),
    ]
    assert [tf.fitted(*data).range for data in ((-0.9, 1.2), (-2, 1), (0, 1))] == [(-1, 1)] * 3


def test_colours_and_opacities_are_stretched_each_from_their_own_range() -> None:
    """ParaView applies a preset to both functions, one after the other."""
    tf = preset(RGBPoints=[-1, 0, 0, 0, 1, 1, 1, 1], Points=[0, 0, 0.5, 0, 1, 1, 0.5, 0, 4, 0.5, 0.5, 0])
    fitted = tf.fitted(100, 300, rescale=True)
    assert [point[0] for point in fitted.colours] == [100, 300]
    assert [point[0] for point in fitted.opacities] == [100, 150, 300]


def test_colours_for_categories_only_are_refused() -> None:
    with pytest.raises(BadInput, match="'Set' has colours for categories only"):
        TransferFunction.from_dict([{"Name": "Set", "IndexedColors": [1, 0, 0, 0, 1, 0]}])


@pytest.mark.parametrize("space", [space for space in COLOUR_SPACES if space != "Lab/CIEDE2000"])  # 15 ms a colour
@pytest.mark.parametrize(("low", "high"), [(1.0, 1000.0), (10.0, 300.0), (0.1, 1e5)])
def test_a_logarithmic_scale_looks_as_vtks_table_of_colours(space: str, low: float, high: float) -> None:
    """Volumes show its entries, which are evenly spaced in the logarithm, evenly spaced over the values."""
    tf = preset(
        ColorSpace=space,
        RGBPoints=[1, 0, 0, 1, 20, 0.2, 1, 0, 1000, 1, 0, 0],
        UseLogScale=1,
        Points=[1, 0, 0.5, 0, 1000, 1, 0.5, 0],
    )
    table = [0.0] * 3003
    tf.to_vtk()[0].GetTable(low, high, 1001, table)
    fitted = tf.fitted(low, high)
    away = np.abs(fitted.colour_at(np.linspace(low, high, 1001)) - np.reshape(table, (-1, 3)))
    assert away.mean() < 2e-3 and not fitted.log_scale
    assert tf.to_dict()["UseLogScale"] == 1 and TransferFunction.from_dict(tf.to_dict()) == tf


def test_opacities_on_a_logarithmic_scale_become_straight_lines() -> None:
    points = [1, 0, 0.3, 0.4, 50, 0.9, 0.5, 0, 1e6, 0.1, 0.5, 0]
    tf = preset(Points=points, OpacityUseLogScale=1, RGBPoints=[1, 0, 0, 0, 1e6, 1, 1, 1])
    at = np.geomspace(1, 1e6, 2001)
    away = np.abs(tf.fitted(1, 1e6).opacity_at(at) - tf.opacity_at(at))
    assert away.mean() < 1e-3 and away.max() < 0.02
    assert tf.opacity_at(1e3) < 0.7 < 0.89 < preset(Points=points).opacity_at(1e3)


@pytest.mark.parametrize(
    ("changes", "data", "words"),
    [
        (
            {"RGBPoints": [1, 0, 0, 0, 9, 1, 1, 1], "Points": [1, 0, 0.5, 0, 9, 1, 0.5, 0]},
            (0, 9),
            "smallest value is 0",
        ),
        ({"RGBPoints": [1, 0, 0, 0, 9, 1, 1, 1], "Points": [-1, 0, 0.5, 0, 9, 1, 0.5, 0]}, (1, 9), "a point at -1"),
    ],
)
def test_logarithms_of_what_is_not_positive_are_refused(changes: dict, data: tuple, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        preset(**changes, UseLogScale=1).fitted(*data)


def test_colours_beyond_the_range_begin_at_its_ends() -> None:
    outside = {
        "UseBelowRangeColor": 1,
        "BelowRangeColor": [1, 0, 1],
        "UseAboveRangeColor": 1,
        "AboveRangeColor": [1, 1, 0],
    }
    tf = preset(RGBPoints=[2, 0, 0, 1, 8, 1, 0, 0], **outside)
    shown = tf.colour_at([0, 1.99, 2.01, 5, 7.99, 8.01, 10])
    expected = [[1, 0, 1], [1, 0, 1], [0, 0, 1], [0.5, 0, 0.5], [1, 0, 0], [1, 1, 0], [1, 1, 0]]
    np.testing.assert_allclose(shown, expected, atol=5e-3)
    with pytest.raises(BadInput, match="need three numbers, not 7"):
        preset(UseAboveRangeColor=1, AboveRangeColor=7)


def test_hues_take_the_shorter_way_if_asked() -> None:
    tf = preset(ColorSpace="HSV", RGBPoints=[0, 0, 0, 1, 10, 1, 0, 0], HSVWrap=1)
    np.testing.assert_allclose(tf.colour_at(5), (1, 0, 1), atol=1e-6)
    assert TransferFunction.from_dict(tf.to_dict()) == tf == TransferFunction.from_vtk(*tf.to_vtk(), None, "two")


@given(
    st.lists(st.tuples(st.floats(-3, 3), st.sampled_from([0.0, 0.0, 0.4, 1.0])), min_size=2, max_size=7),
    st.floats(-1e9, 0.0), st.floats(1.0, 1e9),
)  # fmt: skip
@settings(max_examples=60)
def test_values_outside_of_those_told_apart_look_like_the_ends_or_are_invisible(
    points: list[tuple[float, float]], low: float, high: float
) -> None:
    points = sorted({round(value, 3): opacity for value, opacity in points}.items())
    function = TransferFunction([(-0.5, 1.0, 0.0, 0.0), (0.5, 0.0, 0.0, 1.0)], [(*p, 0.5, 0.0) for p in points])
    first, last = function.varying_range(low, high)
    assert low <= first < last <= high
    for end, beyond in ((first, np.linspace(low, first, 50)), (last, np.linspace(last, high, 50))):
        opacity = function.opacity_at(beyond)
        alike = np.allclose(opacity, function.opacity_at([end]), atol=1e-6)
        same_colour = np.allclose(function.colour_at(beyond), function.colour_at([end]), atol=1e-6)
        assert (alike and (same_colour or not opacity.any())) or not opacity[np.abs(beyond - end) > 1e-9].any()


def test_visible_ranges_are_where_something_shows() -> None:
    tf = preset(Points=[0, 0, 0.5, 0, 2, 0.5, 0.5, 0, 4, 0, 0.5, 0, 7, 0, 0.5, 0, 9, 1, 0.5, 0])
    ranges = tf.visible_ranges(-5, 20)
    np.testing.assert_allclose(ranges, [(0, 4), (7, 20)], atol=1e-9)
    # A bump far narrower than any sampling of the data's range is not missed.
    narrow = preset(RGBPoints=[0, 1, 1, 1, 1e9, 1, 1, 1], Points=[5, 0, 0.5, 0, 5.1, 0.5, 0.5, 0, 5.2, 0, 0.5, 0])
    np.testing.assert_allclose(narrow.visible_ranges(0, 1e9), [(5, 5.2)], atol=1e-6)


BAD = {
    "no points": ({"RGBPoints": []}, "RGBPoints"),
    "odd count": ({"Points": [0, 1, 0.5]}, "four for each"),
    "no numbers": ({"RGBPoints": ["a", "b", "c", "d"]}, "finite numbers"),
    "nan": ({"Points": [0, float("nan"), 0.5, 0, 1, 1, 0.5, 0]}, "finite numbers"),
    "not ascending": ({"Points": [1, 0, 0.5, 0, 0, 1, 0.5, 0]}, "ascending"),
    "opacity 2": ({"Points": [0, 2, 0.5, 0, 1, 1, 0.5, 0]}, "between 0 and 1"),
    "colour -1": ({"RGBPoints": [0, -1, 0, 0, 1, 1, 1, 1]}, "between 0 and 1"),
    "space": ({"ColorSpace": "CMYK"}, "colour space"),
    "unit distance": ({"ScalarOpacityUnitDistance": 0}, "unit distance"),
    "unit distance text": ({"ScalarOpacityUnitDistance": "x"}, "must be a finite number"),
    "bumps": ({"bumps": [{"centre": 1}]}, "centre, width and opacity"),
    "no bumps": ({"bumps": []}, "at least one bump"),
    "flat bump": ({"bumps": [{"centre": 1, "width": 0, "opacity": 1}]}, "width above 0"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_functions_are_refused(case: str) -> None:
    changes, words = BAD[case]
    with pytest.raises(BadInput, match=words) as caught:
        preset(**changes)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("data", [None, [], 3, {"x": 1}, [[1]], "text"])
def test_what_is_no_function_is_refused(data: object) -> None:
    with pytest.raises(BadInput, match="not a transfer function"):
        TransferFunction.from_dict(data)


def test_files_that_cannot_be_read_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="No such file"):
        TransferFunction.read(tmp_path / "no.json")
    (tmp_path / "tf.json").write_text("[{")
    with pytest.raises(BadInput, match="not valid JSON"):
        TransferFunction.read(tmp_path / "tf.json")


@pytest.mark.parametrize(
    ("points", "words"),
    [
        ([0, 0, 0.5, 0, 10, 0, 0.5, 0], "transparent everywhere"),
        ([0, 0, 0.5, 0, 1, 0, 0.5, 0, 1.5, 1, 0.5, 0, 2, 0, 0.5, 0], "transparent everywhere"),  # but outside [3, 9]
        ([0, 1, 0.5, 0, 10, 1, 0.5, 0], "opaque everywhere"),
    ],
)
def test_functions_that_show_nothing_of_the_data_are_refused(points: list, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        preset(Points=points).fitted(3, 9)


def test_a_function_outside_the_data_is_refused() -> None:
    for low, high in ((11, 20), (-5, -1)):
        with pytest.raises(BadInput, match="rescale"):
            preset().fitted(low, high)


def test_unit_distance_is_paraviews() -> None:
    """ParaView's Wavelet (21^3 points, spacing 1) shows 1.7320508075688774."""
    assert unit_distance_for(level_of_image(from_array(np.zeros((21, 21, 21))))) == pytest.approx(np.sqrt(3), rel=1e-12)
    image = from_array(np.zeros((5, 9, 17)), (1, 2, 3))
    assert unit_distance_for(level_of_image(image)) == pytest.approx(
        np.sqrt(16**2 + 16**2 + 12**2) / np.cbrt(16 * 8 * 4)
    )


@pytest.mark.parametrize("background", [0, 1, 2])
def test_the_default_shows_two_classes_and_hides_the_background(background: int) -> None:
    rng = np.random.default_rng(0)
    sizes = [600, 600, 600]
    sizes[background] = 8000
    means = (10.0, 50.0, 90.0)
    voxels = np.concatenate([rng.normal(mean, 2, size) for mean, size in zip(means, sizes)])
    tf = default_transfer_function(from_array(voxels[:9200].reshape(20, 20, 23)))
    shown = tf.opacity_at(means) > 0.05
    assert shown.tolist() == [i != background for i in range(3)]
    others = [mean for i, mean in enumerate(means) if i != background]
    assert np.abs(np.subtract(*tf.colour_at(others))).max() > 0.3
    tf.fitted(float(voxels.min()), float(voxels.max()))


def test_a_constant_volume_has_no_default() -> None:
    with pytest.raises(BadInput, match="the value 7"):
        default_transfer_function(from_array(np.full((3, 3, 3), 7)))


@pytest.mark.parametrize("space", COLOUR_SPACES)
def test_from_vtk_is_the_inverse_of_to_vtk(space: str) -> None:
    tf = TransferFunction(
        ((0.0, 0.1, 0.2, 0.9), (0.5, 0.9, 0.5, 0.1), (0.5, 0.2, 0.8, 0.1), (2.0, 1.0, 1.0, 0.0)),
        ((0.0, 0.0, 0.5, 0.0), (1.0, 0.7, 0.3, 0.6), (2.0, 0.1, 0.5, 0.0)),
        0.25,
        "mine",
        space,
    )
    assert TransferFunction.from_vtk(*tf.to_vtk(), 0.25, "mine") == tf


def test_from_vtk_keeps_the_colours_of_a_logarithmic_scale() -> None:
    colour, opacity = TransferFunction(
        ((1.0, 0.0, 0.0, 1.0), (100.0, 1.0, 0.0, 0.0)), ((1.0, 0.0, 0.5, 0.0), (100.0, 1.0, 0.5, 0.0))
    ).to_vtk()
    colour.SetScaleToLog10()
    values = np.linspace(1.0, 100.0, 37)
    shown = [colour.GetColor(float(v)) for v in values]
    np.testing.assert_allclose(TransferFunction.from_vtk(colour, opacity).colour_at(values), shown, atol=0.02)
    assert shown[0] == (0.0, 0.0, 1.0) and shown[9][0] > 0.6  # about half of the way is over at a tenth of the range


def test_from_vtk_refuses_functions_without_points() -> None:
    with pytest.raises(BadInput, match="has no points"):
        TransferFunction.from_vtk(vtkColorTransferFunction(), vtkPiecewiseFunction())


@pytest.mark.parametrize("air", [0, 1, 2])
@pytest.mark.parametrize("radius", [6.0, 11.0])
def test_what_surrounds_an_object_is_background_however_much_it_fills(air: int, radius: float) -> None:
    """The rest of a volume of 24^3 holds more than half of it around a small ball, and less around a large one."""
    rng = np.random.default_rng(0)
    levels = np.roll([10.0, 100.0, 200.0], 1 - air) if air != 1 else np.array([100.0, 10.0, 200.0])
    centre = np.indices((24, 24, 24)) - 11.5
    away = np.sqrt(np.square(centre).sum(axis=0))
    values = np.where(away < 0.5 * radius, levels[2], np.where(away < radius, levels[1], levels[0]))
    tf = default_transfer_function(from_array((values + rng.normal(0.0, 2.0, values.shape)).astype(np.float32)))
    outside, shell, core = (float(tf.opacity_at(np.array([level]))[0]) for level in levels)
    assert outside == 0.0 and min(shell, core) > 0.05


def test_where_no_class_surrounds_the_object_the_most_frequent_is_background() -> None:
    """Layers, of which each reaches the sides."""
    values = np.repeat([10.0, 100.0, 200.0], (5, 12, 7))[:, None, None] + np.zeros((24, 24, 24))
    tf = default_transfer_function(from_array(values.astype(np.float32)))
    low, middle, high = (float(v) for v in tf.opacity_at(np.array([10.0, 100.0, 200.0])))
    assert middle == 0.0 and min(low, high) > 0.05
