"""Voxels exactly at a jump of the transfer function look alike in every ray caster, and as the function says."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("vtkmodules")

from vtkmodules.vtkCommonCore import vtkVersion
from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction
from vtkmodules.vtkRenderingCore import vtkColorTransferFunction

from svv.core.colour.shading import Shading
from svv.core.geometry.cameras import Camera, look_at
from svv.dvr.draw.large import LargeVolume, open_volume
from svv.dvr.draw.views import make_views, render_views
from svv.dvr.functions.jumps import settled
from svv.dvr.functions.prolab import between
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.appearance import Appearance
from svv.dvr.read.grids import from_array
from svv.errors import BadInput
from tests.nightly import nightly

FLAT = Shading(on=False)
KINDS = (np.uint8, np.int16, np.int32, np.float32, np.float64)
WHITE = ((0.0, 1.0, 1.0, 1.0), (9.0, 1.0, 1.0, 1.0))


def opacities(*points: tuple[float, float]) -> tuple[tuple[float, float, float, float], ...]:
    return tuple((value, level, 0.5, 0.0) for value, level in points)


def of_one_value(value: float, last: float, kind: type, gain: float = 1.0) -> np.ndarray:
    """Return a volume of one value, apart from two corners that give it the range from 0."""
    values = np.full((10, 10, 10), value)
    values[0, 0, 0], values[-1, -1, -1] = 0, last
    return (gain * values).astype(kind)


CAMERA = Camera(look_at((4.5, 4.5, 40.0), (4.5, 4.5, 4.5)), 0.2, 12, 12)


def centre(values: np.ndarray, tf: TransferFunction, mapper: str) -> np.ndarray:
    (image,) = render_views(from_array(values), tf, [CAMERA], mapper, FLAT, 0.5)
    return image[5:7, 5:7].reshape(-1, 4).mean(axis=0)


@pytest.fixture(params=["bricks", "cpu", "gpu"])
def mapper(request: pytest.FixtureRequest) -> str:
    if request.param == "gpu":
        request.getfixturevalue("off_screen")
    return str(request.param)


STEPS = {
    "up at 3": opacities((0, 0), (3, 0), (3, 1), (9, 1)),
    "down at 5": opacities((0, 1), (5, 1), (5, 0), (9, 0)),
    "a band": opacities((0, 0), (3, 0), (3, 1), (5, 1), (5, 0), (9, 0)),
    "just below 3 and above 5": opacities(
        (0, 0), (np.nextafter(3, 0), 0), (3, 1), (5, 1), (np.nextafter(5, 9), 0), (9, 0)
    ),
    "a label alone": opacities((0, 0), (2.9999999, 0), (3, 1), (3.0000001, 0), (9, 0)),
    "three points": opacities((0, 0), (3, 0), (3, 0.5), (3, 1), (9, 1)),
}


@pytest.mark.parametrize("name", STEPS)
@pytest.mark.parametrize("kind", nightly([np.uint8, np.float32], np.uint8))
def test_labels_at_a_step_of_opacity_show_the_second_point(name: str, kind: type, mapper: str) -> None:
    tf = TransferFunction(WHITE, STEPS[name], 0.5)
    for label in (2, 3, 4, 5, 6):
        expected = float(tf.opacity_at(label))
        if expected in (0.0, 1.0):
            corners = float(max(tf.opacity_at([0, 9])))
            try:
                alpha = centre(of_one_value(label, 9, kind), tf, mapper)[3]
            except BadInput:  # nothing is shown at all
                assert expected == corners == 0.0
                continue
            assert alpha == pytest.approx(255 * expected, abs=3), (label, alpha)


@pytest.mark.parametrize("kind", nightly(KINDS, np.int16, np.float64))
def test_the_type_of_the_values_makes_no_difference(kind: type, mapper: str) -> None:
    tf = TransferFunction(WHITE, STEPS["a band"], 0.5).mapped(11.0, 0.0)
    for label, expected in ((3, 255), (5, 0)):
        values = of_one_value(label, 9, kind, gain=11.0)
        values[1, 1, 1] = 44  # something is seen in any case
        assert centre(values, tf, mapper)[3] == pytest.approx(expected, abs=3)


@pytest.mark.parametrize(
    ("kind", "first"),
    nightly(
        [(np.int8, -100), (np.uint8, 200), (np.int16, 0), (np.int16, -30000), (np.uint16, 60000), (np.int32, -(10**6)),
         (np.uint32, 4 * 10**9), (np.float32, 1000), (np.float64, 10**9)],
        (np.int16, -30000), (np.uint32, 4 * 10**9), (np.float32, 1000),
    ),
)  # fmt: skip
def test_labels_far_from_0_keep_their_steps(kind: type, first: int, mapper: str) -> None:
    """A table's first value next to -30000 or 60000 needs more digits than single precision has."""
    white = tuple((first + value, *colour) for value, *colour in WHITE)
    steps = tuple((first + value, *rest) for value, *rest in STEPS["a band"])
    for label, expected in ((2, 0), (3, 255), (4, 255), (5, 0), (6, 0)):
        values: np.ndarray = (of_one_value(label, 9, np.int64) + first).astype(kind)
        values[1, 1, 1] = first + 4  # something is seen in any case
        assert centre(values, TransferFunction(white, steps, 0.5), mapper)[3] == pytest.approx(expected, abs=3), label


@pytest.mark.parametrize("space", ["RGB", "HSV", "Lab", "Lab/CIEDE2000"])
def test_labels_at_a_step_of_colour_show_the_first_point(space: str, mapper: str) -> None:
    colours = ((0.0, 1.0, 0.0, 0.0), (3.0, 1.0, 0.0, 0.0), (3.0, 0.0, 0.0, 1.0), (9.0, 0.0, 0.0, 1.0))
    tf = TransferFunction(colours, opacities((0, 1), (1, 0.9)), 1.0, space=space)
    assert tf.colour_at(3.0).tolist() == pytest.approx([1, 0, 0], abs=1e-3)
    shown = centre(of_one_value(3, 9, np.uint8), tf, mapper)
    np.testing.assert_allclose(shown[:3], 255 * tf.colour_at(3.0), atol=4)


@pytest.mark.parametrize("label", [1, 2, 3, 7])
def test_a_label_at_a_point_in_steps_has_the_colour_of_the_point(label: int, mapper: str) -> None:
    hues = ((1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (0, 1, 1))
    colours = tuple((float(at), *hue) for at, hue in zip((0, 1, 2, 3, 7), hues))
    tf = TransferFunction(colours, opacities((0, 1), (1, 0.9)), 1.0, space="Step")
    shown = centre(of_one_value(label, 9, np.uint8), tf, mapper)
    np.testing.assert_allclose(shown[:3], 255 * np.array(hues[(0, 1, 2, 3, 7).index(label)]), atol=4)


@pytest.mark.parametrize("kind", nightly([np.uint8, np.float32], np.float32))
@pytest.mark.parametrize("value", [50, 200])
def test_colours_beyond_the_range_leave_its_ends_alone(kind: type, value: int, mapper: str) -> None:
    colours = ((50.0, 0.0, 0.0, 1.0), (200.0, 1.0, 1.0, 0.0))
    tf = TransferFunction(colours, opacities((0, 1), (1, 0.9)), 1.0, below=(1, 0, 1), above=(0, 1, 0))
    shown = centre(of_one_value(value, 255, kind), tf, mapper)
    np.testing.assert_allclose(shown[:3], 255 * tf.colour_at(value), atol=4)
    for beyond, expected in ((49, (1, 0, 1)), (201, (0, 1, 0))):
        np.testing.assert_allclose(
            centre(of_one_value(beyond, 255, kind), tf, mapper)[:3], 255 * np.array(expected), atol=4
        )
    assert TransferFunction.from_dict(tf.to_dict()) == tf == TransferFunction.from_vtk(*tf.to_vtk(), 1.0)


@pytest.mark.parametrize("kind", nightly([np.uint8, np.int16, np.float32], np.uint8, np.float32))
def test_a_mask_has_one_picture_whatever_its_type(kind: type, mapper: str) -> None:
    ball = sum(grid**2 for grid in np.mgrid[-1:1:16j, -1:1:16j, -1:1:16j]) < 0.4
    tf = TransferFunction(
        ((0.0, 0.0, 0.0, 1.0), (1.0, 1.0, 0.0, 0.0)), opacities((0, 0), (0.125, 0), (0.225, 0.35), (1, 0.6)), 1.0
    )
    how = {"n": 3, "size": 32, "rescale": False, "mapper": mapper, "shading": FLAT}
    images = [make_views(from_array(ball.astype(k)), tf, **how)[0].images.astype(float) for k in (kind, np.float64)]
    assert np.abs(images[0] - images[1]).mean() < 0.3


def test_a_function_between_jumps_stays_as_it_is() -> None:
    tf = TransferFunction(
        ((0.0, 1.0, 0.0, 0.0), (3.0, 0.2, 0.0, 0.0), (3.0, 0.0, 0.0, 1.0), (9.0, 0.0, 0.3, 1.0)),
        STEPS["a band"],
        1.0,
    )
    exact, at = settled(tf, 9.0), np.linspace(0.05, 8.95, 500)
    at = at[(np.abs(at - 3) > 0.01) & (np.abs(at - 5) > 0.01)]
    np.testing.assert_allclose(exact.opacity_at(at), tf.opacity_at(at), atol=1e-9)
    np.testing.assert_allclose(exact.colour_at(at), tf.colour_at(at), atol=2e-3)
    for value in (3.0, 5.0):
        np.testing.assert_allclose(exact.opacity_at(value + np.array([-1e-4, 0, 1e-4])), tf.opacity_at(value))
        np.testing.assert_allclose(
            exact.colour_at(value + np.array([-1e-4, 0, 1e-4])), [tf.colour_at(value)] * 3, atol=1e-4
        )
    assert settled(exact, 9.0) == exact
    smooth = TransferFunction(WHITE, opacities((0, 0), (4, 0.2), (9, 1)), 1.0)
    assert settled(smooth, 9.0) is smooth


@pytest.mark.skipif(
    vtkVersion().GetVTKMajorVersion() * 100 + vtkVersion().GetVTKMinorVersion() < 903, reason="older VTK"
)
def test_values_at_a_jump_are_those_of_vtk() -> None:
    tf = TransferFunction(((0.0, 1, 0, 0), (3.0, 0, 1, 0), (3.0, 0, 0, 1)), STEPS["a band"], 1.0)
    colour, opacity = tf.to_vtk()
    for value in (3.0, 5.0):
        assert float(tf.opacity_at(value)) == opacity.GetValue(value)
        assert tf.colour_at(value).tolist() == list(colour.GetColor(value))


def test_clamping_off_shows_nothing_beyond_the_points() -> None:
    colour, opacity = vtkColorTransferFunction(), vtkPiecewiseFunction()
    for value, level in ((150, 0.3), (200, 0.4)):
        opacity.AddPoint(value, level)
        colour.AddRGBPoint(value, level, 1, level)
    opacity.ClampingOff()
    colour.ClampingOff()
    tf = TransferFunction.from_vtk(colour, opacity)
    at = np.array([-100.0, 149.9, 150.1, 175, 199.9, 200.1, 1e4])
    np.testing.assert_allclose(tf.opacity_at(at), [opacity.GetValue(value) for value in at])
    np.testing.assert_allclose(tf.colour_at(at), [colour.GetColor(value) for value in at], atol=1e-6)


def test_sharp_colours_jump_where_they_do_in_vtk() -> None:
    colour, opacity = vtkColorTransferFunction(), vtkPiecewiseFunction()
    colour.AddRGBPoint(0, 1, 0, 0, 0.5, 1.0)
    colour.AddRGBPoint(4, 0, 0, 1, 0.25, 1.0)
    colour.AddRGBPoint(8, 0, 1, 0)
    opacity.AddPoint(0, 1)
    tf = TransferFunction.from_vtk(colour, opacity)
    at = np.array([0.0, 1.99, 2, 2.01, 4.99, 5, 5.01, 8])
    np.testing.assert_allclose(tf.colour_at(at), [colour.GetColor(value) for value in at], atol=1e-6)


@pytest.mark.parametrize(
    "colours", [((0.0, 0.1, 0.2, 0.9), (1.0, 0.9, 0.3, 0.1)), ((2.0, 0, 0, 0), (3.0, 1, 0, 0), (9.0, 1, 1, 1))]
)
def test_prolab_is_that_of_vtk(colours: tuple) -> None:
    function = vtkColorTransferFunction()
    if not hasattr(function, "SetColorSpaceToProlab"):
        pytest.skip("VTK knows ProLab since 9.5")
    function.SetColorSpaceToProlab()
    for point in colours:
        function.AddRGBPoint(*point)
    tf = TransferFunction.from_dict(
        {"Name": "p", "ColorSpace": "ProLab", "RGBPoints": [x for point in colours for x in point]}
    )
    at = np.linspace(colours[0][0], colours[-1][0], 77)
    assert np.abs(tf.colour_at(at) - [function.GetColor(value) for value in at]).max() < 2e-3
    assert len(between(colours, 16, log=False)) == pytest.approx(16, abs=2)


VP = """1
1
0.9
0.1
0.2
10
14 -3024 0 -86.9767 0 45.3791 0.169643 139.919 0.589286 347.907 0.607143 1224.16 0.607143 3071 0.616071
4 0 {gradient} 255 1
28 -3024 0 0 0 -86.9767 0 0.25098 1 45.3791 1 0 0 139.919 1 0.894893 0.894893 347.907 1 1 0.25098 1224.16 1 1 1 3071 0.827451 0.658824 1
"""  # noqa: E501


def slicer_json(**part: object) -> dict:
    component = {
        "shade": True,
        "lighting": {"ambient": 0.3, "diffuse": 0.6, "specular": 0.5, "specularPower": 40.0},
        "scalarOpacityUnitDistance": 2.5,
        "scalarOpacity": {"points": [
            {"x": 0.0, "y": 0.0, "midpoint": 0.2, "sharpness": 0.6},
            {"x": 100.0, "y": 0.7, "midpoint": 0.5, "sharpness": 0.0},
        ]},
        "gradientOpacity": {"points": [{"x": 0.0, "y": 1.0, "midpoint": 0.5, "sharpness": 0.0}]},
        "rgbTransferFunction": {"points": [
            {"x": 0.0, "color": [0.0, 0.0, 1.0], "midpoint": 0.3, "sharpness": 0.4},
            {"x": 100.0, "color": [1.0, 0.5, 0.0], "midpoint": 0.5, "sharpness": 0.0},
        ]},
    }  # fmt: skip
    whole = {"effectiveRange": [0.0, 100.0], "interpolationType": "linear", "components": [component | part]}
    return {"@schema": "https://x/volume-property-schema-v1.0.0.json#", "volumeProperties": [whole]}


def test_a_text_file_of_slicer_is_read(tmp_path: Path) -> None:
    file = tmp_path / "CT-AAA.vp"
    file.write_text(VP.format(gradient=1))
    tf = TransferFunction.read(file)
    assert tf.unit_distance == 1.0 and tf.shading == Shading(True, 0.1, 0.9, 0.2, 10.0) and not tf.notes
    np.testing.assert_allclose(tf.opacity_at([-3024, 139.919, 3071]), [0, 0.589286, 0.616071])
    np.testing.assert_allclose(tf.colour_at(45.3791), [1, 0, 0], atol=1e-6)
    file.write_text(VP.format(gradient=0))
    with pytest.raises(BadInput, match="depend on gradients"):
        TransferFunction.read(file)
    file.write_text(VP.format(gradient=1).replace("1\n1\n0.9", "0\n1\n0.9", 1))
    assert "--nearest" in TransferFunction.read(file).notes[0]


@pytest.mark.parametrize(
    "content", ["", "1\n1\n", "{", VP.replace("14 -3024", "15 -3024").format(gradient=1), "a\n" * 9]
)
def test_a_damaged_file_of_slicer_is_refused_in_a_sentence(content: str, tmp_path: Path) -> None:
    (tmp_path / "x.vp").write_text(content)
    with pytest.raises(BadInput, match=r"x\.vp"):
        TransferFunction.read(tmp_path / "x.vp")


def test_a_json_file_of_slicer_is_read_as_vtk_draws_it(tmp_path: Path) -> None:
    file = tmp_path / "own.vp.json"
    file.write_text(json.dumps(slicer_json()))
    tf = TransferFunction.read(file)
    assert tf.unit_distance == 2.5 and tf.shading == Shading(True, 0.3, 0.6, 0.5, 40.0)
    colour, opacity = vtkColorTransferFunction(), vtkPiecewiseFunction()
    colour.AddRGBPoint(0, 0, 0, 1, 0.3, 0.4)
    colour.AddRGBPoint(100, 1, 0.5, 0)
    opacity.AddPoint(0, 0, 0.2, 0.6)
    opacity.AddPoint(100, 0.7)
    at = np.linspace(0, 100, 41)
    np.testing.assert_allclose(tf.opacity_at(at), [opacity.GetValue(value) for value in at], atol=1e-9)
    np.testing.assert_allclose(tf.colour_at(at), [colour.GetColor(value) for value in at], atol=4e-3)
    values = np.linspace(0, 100, 512).reshape(8, 8, 8).astype(np.float32)
    assert make_views(from_array(values), file, n=3, size=16)[0].meta.shading == tf.shading
    ramp = {"points": [{"x": 0.0, "y": 0.0}, {"x": 9.0, "y": 1.0}]}
    file.write_text(json.dumps(slicer_json(gradientOpacity=ramp, disableGradientOpacity=True)))
    assert TransferFunction.read(file).unit_distance == 2.5
    for bad, words in (
        (slicer_json(gradientOpacity=ramp), "gradients"),
        (slicer_json(scalarOpacity={}), "lacks 'points'"),
        ({"volumeProperties": []}, "another form"),
        ({"volumeProperties": [{"components": [{}, {}]}]}, "2 components"),
    ):
        file.write_text(json.dumps(bad))
        with pytest.raises(BadInput, match=words):
            TransferFunction.read(file)


def test_views_of_labels_are_told_of_and_drawn_without_interpolation(mapper: str) -> None:
    z, y, x = np.mgrid[:20, :20, :20] / 19
    labels = np.zeros((20, 20, 20), np.uint8)
    labels[np.sqrt((x - 0.35) ** 2 + (y - 0.5) ** 2 + (z - 0.5) ** 2) < 0.3] = 7
    labels[np.sqrt((x - 0.85) ** 2 + (y - 0.5) ** 2 + (z - 0.5) ** 2) < 0.12] = 5
    tf = TransferFunction(WHITE, opacities((0, 0), (4.4, 0), (4.6, 0.9), (5.4, 0.9), (5.6, 0), (9, 0)), 1.0)
    how = {"n": 3, "size": 32, "rescale": False, "mapper": mapper, "frame": "whole"}
    smooth, _ = make_views(from_array(labels), tf, **how)
    assert "--nearest" in (smooth.meta.assumed or "") and smooth.meta.nearest is None
    plain, _ = make_views(from_array(labels), tf, nearest=True, **how)
    assert plain.meta.assumed is None and plain.meta.nearest
    only = np.where(labels == 5, labels, 0)
    only[0, 0, 0] = 7  # the same range
    alone, _ = make_views(from_array(only), tf, nearest=True, **how)
    share, expected = ((views.images[..., 3] > 20).mean() for views in (plain, alone))
    assert share == pytest.approx(expected, rel=0.02) and 0 < share < 0.5 * (smooth.images[..., 3] > 20).mean()
    again = render_views(from_array(labels), tf, plain.cameras, mapper, nearest=True)
    assert np.abs(again.astype(float) - plain.images).mean() < 0.5
    # What training begins with follows the same rule: nothing is at the vertices inside label 7, or on its edge.
    known = plain.classified
    assert known is not None
    seen = known.exponent > known.exponent.min()
    assert seen.any()
    ends = np.argwhere(seen) / known.cells * known.box.size + known.box.low
    assert ends[:, 0].min() > 0.7 * 19


@pytest.mark.parametrize(
    ("values", "function", "said"),
    [
        (np.indices((9, 9, 9)).sum(0).astype(np.uint8), "a band", False),  # smooth: neighbours differ by one
        ((np.indices((9, 9, 9)).sum(0) > 12).astype(np.uint8), "ramp", False),  # a mask
        ((np.indices((9, 9, 9)).sum(0) > 12).astype(np.float32) * 9, "bump", True),
        (np.random.default_rng(0).random((9, 9, 9)).astype(np.float32) * 9, "bump", False),  # no labels
        (np.indices((9, 9, 9)).sum(0).astype(np.uint16) * 62, "greys", False),  # few bits, with a piece of metal
        (np.random.default_rng(0).permutation(25)[np.indices((9, 9, 9)).sum(0)] * 62, "greys", True),  # an atlas
    ],
)
def test_notices_of_labels_are_given_where_interpolation_shows_what_is_not_there(
    values: np.ndarray, function: str, said: bool
) -> None:
    shapes = {
        **STEPS,
        "ramp": opacities((0, 0), (0.4, 0), (1, 0.5)),
        "bump": opacities((0, 0), (4, 0.0), (5, 0.5), (9, 0)),
        "greys": opacities((0, 0), (400, 0), (700, 0.5), (900, 0)),
    }
    values = values.copy()
    if function == "bump":
        values[0, 0, 0] = 5
    if function == "greys":
        values[0, 0, 0] = 24 * 62
    tf = TransferFunction(WHITE, shapes[function], 1.0)
    views, _ = make_views(from_array(values), tf, n=3, size=16, rescale=False)
    assert ("without interpolation" in str(views.meta.assumed) or "--nearest" in str(views.meta.assumed)) == said


def test_left_handed_axes_are_told_of() -> None:
    image = from_array(np.indices((9, 9, 9)).sum(0).astype(np.float32))
    tf = TransferFunction(WHITE, opacities((0, 0), (9, 0.5)), 1.0)
    assert make_views(image, tf, n=3, size=16)[0].meta.assumed is None
    image.SetDirectionMatrix(1, 0, 0, 0, -1, 0, 0, 0, 1)
    assert "left-handed" in str(make_views(image, tf, n=3, size=16)[0].meta.assumed)


def test_coarser_levels_of_large_labels_are_labels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SVV_PYRAMIDS", str(tmp_path / "pyramids"))
    labels = np.random.default_rng(0).choice(np.array([0, 7, 200], np.uint8), (140, 70, 40))
    np.save(tmp_path / "labels.npy", labels)
    volume = open_volume(tmp_path / "labels.npy", mapper="bricks", nearest=True)
    assert isinstance(volume, LargeVolume) and len(volume.source.levels) > 1 and Appearance.of(volume.overview).nearest
    for number, level in enumerate(volume.source.levels):
        values = volume.source.read(number, (0, 0, 0), level.shape)
        assert set(np.unique(values)) == {0, 7, 200}
    means = open_volume(tmp_path / "labels.npy", mapper="bricks")
    assert isinstance(means, LargeVolume)
    assert len(np.unique(means.source.read(1, (0, 0, 0), means.source.levels[1].shape))) > 3  # another pyramid
    with pytest.raises(BadInput, match="nearest=True"):
        make_views(means, nearest=True, n=3, size=16)


@pytest.mark.parametrize(
    "kind",
    nightly(
        ["rectilinear", "structured", "unstructured", "blocks", "image", "sheared", "nan", "array", "zeros", "word"],
        "unstructured", "blocks", "image", "sheared", "nan", "zeros", "word",
    ),
)  # fmt: skip
def test_grids_of_every_kind_are_drawn_or_refused_in_a_sentence(kind: str) -> None:
    pyvista = pytest.importorskip("pyvista")
    image = pyvista.Wavelet(extent=(-6, 6, -6, 6, -6, 6))
    given: Any = {
        "rectilinear": image.cast_to_rectilinear_grid(), "structured": image.cast_to_structured_grid(),
        "unstructured": image.cast_to_unstructured_grid(), "blocks": pyvista.MultiBlock([image]), "image": image,
        "array": image["RTData"].reshape(image.dimensions[::-1]), "zeros": np.zeros((4, 4, 4)), "word": 7,
    }.get(kind, image.copy())  # fmt: skip
    if kind == "sheared":
        given.direction_matrix = np.array([[1, 0.5, 0], [0, 1, 0], [0, 0, 1.0]])
    if kind == "nan":
        given["RTData"][5] = np.nan
    low, high = image["RTData"].min(), image["RTData"].max()
    tf = TransferFunction(((low, 0, 0, 1), (high, 1, 0, 0)), opacities((low, 0), (high, 0.5)), 3.0)
    draw = (
        lambda: make_views(given, tf, n=3, size=24, rescale=False)[0].images,
        lambda: render_views(given, tf, make_views(image, tf, n=3, size=24)[0].cameras, "bricks"),
    )
    words = {"sheared": "perpendicular", "zeros": "the data runs from 0 to 0", "word": "of the type int"}
    for one in draw:
        if kind in words:
            with pytest.raises(BadInput, match=words[kind]):
                one()
        else:
            assert one()[..., 3].max() > 50
