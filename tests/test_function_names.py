"""Transfer functions by name, colours of matplotlib, ParaView and VisIt without opacities, and functions of yt."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import matplotlib
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import svv
from svv.core.colour.shading import Shading
from svv.dvr.functions.named import file_and_name
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.errors import BadInput
from svv.job.layers import layers
from svv.job.source import VolumeSource
from svv.options.making import ShownVolumeOptions

NODE = (
    '<VolumeProperty name="{0}" interpolation="1" shade="1" diffuse="0.9" ambient="0.1" specular="0.2" '
    'specularPower="10" scalarOpacity="6 -100 0 {1} 0.25 900 0.5" gradientOpacity="4 0 1 255 {2}" '
    'colorTransfer="8 -100 0 0 0 900 1 0.5 0"/>'
)


def presets(folder: Path, gradient: float = 1.0) -> Path:
    nodes = NODE.format("CT-Bone", 300, 1) + NODE.format("CT-Lung", 0, 1) + NODE.format("US-Fetal", 0, gradient)
    (folder / "presets.xml").write_text(f'<?xml version="1.0"?><MRML>{nodes}</MRML>')
    return folder / "presets.xml"


def visit(folder: Path, extra: str = "", more: str = "", name: str = "a.ct", plot: bool = False) -> Path:
    points = "".join(
        f'<Object name="ColorControlPoint"><Field name="colors" type="unsignedCharArray" length="4">{rgb} 255 </Field>'
        f'<Field name="position" type="float">{place}</Field></Object>'
        for rgb, place in (("255 0 0", 0.2), ("0 255 0", 0.4), ("0 0 255", 0.8))
    )
    colours = f'<Object name="ColorControlPointList">{points}{extra}</Object>{more}'
    root = f'<Object name="VolumeAttributes">{colours}</Object>' if plot else colours
    (folder / name).write_text(f'<?xml version="1.0"?><Object name="ColorTable">{root}</Object>')
    return folder / name


def test_a_name_after_a_colon_picks_a_property_of_slicer(tmp_path: Path) -> None:
    file = presets(tmp_path)
    bone = TransferFunction.read(f"{file}:CT-Bone")
    assert bone.name == "CT-Bone" and bone.unit_distance == 1.0
    assert bone.shading == Shading(True, 0.1, 0.9, 0.2, 10.0)
    text = "1\n1\n0.9\n0.1\n0.2\n10\n6 -100 0 300 0.25 900 0.5\n4 0 1 255 1\n8 -100 0 0 0 900 1 0.5 0\n"
    (tmp_path / "bone.vp").write_text(text)
    alone = TransferFunction.read(tmp_path / "bone.vp")
    assert (bone.colours, bone.opacities, bone.shading) == (alone.colours, alone.opacities, alone.shading)
    assert TransferFunction.read(f"{file}:CT-Lung").opacities != bone.opacities
    with pytest.raises(BadInput, match=r"Did you mean CT-Bone.*There are: CT-Bone, CT-Lung, US-Fetal"):
        TransferFunction.read(f"{file}:CT-Bon")
    with pytest.raises(BadInput, match="name one"):
        TransferFunction.read(file)
    with pytest.raises(BadInput, match="depend on gradients"):
        TransferFunction.read(f"{presets(tmp_path, 0.5)}:US-Fetal")
    (tmp_path / "presets.xml:CT-Lung").write_bytes((tmp_path / "bone.vp").read_bytes())
    with pytest.raises(BadInput, match="not valid JSON"):  # a file of exactly this name comes first
        TransferFunction.read(f"{file}:CT-Lung")


def test_a_name_picks_a_preset_of_paraview(tmp_path: Path) -> None:
    list_of = [{"Name": n, "RGBPoints": [0, 0, 0, 0, 1, k, k, k]} for n, k in (("Dark", 0.25), ("Light", 1.0))]
    (tmp_path / "all.json").write_text(json.dumps(list_of))
    assert TransferFunction.read(f"{tmp_path}/all.json:Light").colours[-1] == (1.0, 1.0, 1.0, 1.0)
    assert TransferFunction.read(tmp_path / "all.json").name == "Dark"
    with pytest.raises(BadInput, match="There are: Dark, Light"):
        TransferFunction.read(f"{tmp_path}/all.json:Grey")
    points = '<Point x="1" o="1" r="0" g="0" b="1"/><Point x="-1" o="1" r="1" g="0" b="0"/>'
    maps = f'<ColorMap name="A" space="Wrapped">{points}</ColorMap><ColorMap name="B" indexedLookup="true"/>'
    (tmp_path / "maps.xml").write_text(f"<ColorMaps>{maps}</ColorMaps>")
    found = TransferFunction.read(f"{tmp_path}/maps.xml:A")
    assert found.colours == ((-1.0, 1.0, 0.0, 0.0), (1.0, 0.0, 0.0, 1.0))
    assert (found.space, found.hsv_wrap, found.placed) == ("HSV", True, False)
    with pytest.raises(BadInput, match="categories only"):
        TransferFunction.read(f"{tmp_path}/maps.xml:B")


@pytest.mark.parametrize("name", ["viridis", "coolwarm_r", "gist_ncar", "tab10", "Set3"])
def test_a_colour_map_of_matplotlib_is_a_function_with_a_ramp(name: str) -> None:
    tf, known = TransferFunction.read(name), matplotlib.colormaps[name]
    fitted = tf.fitted(-50.0, 150.0)
    x = (np.arange(known.N) + 0.5) / known.N
    inside = x if known.N < 64 else x[1:-1]
    np.testing.assert_allclose(fitted.colour_at(-50.0 + 200.0 * inside), known(inside)[:, :3], atol=2e-6)
    np.testing.assert_allclose(fitted.colour_at([-50.0, 150.0]), known([0.0, 1.0])[:, :3], atol=2e-6)
    np.testing.assert_allclose(fitted.opacity_at(-50.0 + 200.0 * x), x, atol=1e-9)
    assert "ramp from 0 at the smallest value to 1" in tf.notes[0]
    again = TransferFunction.read(f"matplotlib:{name}")
    assert again == tf


def test_unknown_colour_maps_and_no_matplotlib_are_a_sentence(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"neither a file nor a colour map of matplotlib\. Close ones: viridis"):
        TransferFunction.read("viridi")
    with pytest.raises(BadInput, match="There are: Accent, "):
        TransferFunction.read("matplotlib:no such one")
    with pytest.raises(BadInput, match="Cannot read"):
        TransferFunction.read("viridis.json")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "viridis").write_text('{"bumps": [{"centre": 1, "width": 2, "opacity": 0.5}]}')
    assert TransferFunction.read("viridis").opacities[-1][0] == 2.0
    (tmp_path / "viridis").unlink()
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(BadInput, match="pip install matplotlib"):
        TransferFunction.read("viridis")


def test_views_say_the_ramp_and_are_known_by_the_name(tmp_path: Path) -> None:
    file = tmp_path / "a.npy"
    values = np.linspace(0, 1, 12**3, dtype=np.float32).reshape(12, 12, 12)
    np.save(file, values)
    source = VolumeSource(file, Path("viridis"), spacing=(1, 1, 1))
    meta = source.make_views(tmp_path / "out", svv.ViewOptions(n=12, test=0, size=16), lambda *_: None)
    assert meta.tf is not None and meta.tf["Name"] == "viridis" and "ramp from 0" in str(meta.assumed)
    other = VolumeSource(file, Path("magma"), spacing=(1, 1, 1))
    assert source.identity() != other.identity()
    both = [VolumeSource(file, Path(f"{presets(tmp_path)}:{one}")).identity() for one in ("CT-Bone", "CT-Lung")]
    assert both[0] != both[1] and both[0]["files"] == both[1]["files"]
    with pytest.raises(BadInput, match="no transfer function"):
        VolumeSource(file, tmp_path / "missing.json").identity()
    with pytest.raises(BadInput, match="Close ones"):
        VolumeSource(file, Path("viridi")).identity()


def test_layers_are_named_after_functions(tmp_path: Path) -> None:
    named = tuple(Path(f"{presets(tmp_path)}:{one}") for one in ("CT-Bone", "CT-Lung"))
    assert [*layers([Path("a.npy")], ShownVolumeOptions(tf=(*named, Path("viridis"))))] == [
        "CT-Bone", "CT-Lung", "viridis",
    ]  # fmt: skip


@given(st.text(min_size=1, max_size=12))
@settings(max_examples=200, deadline=None)
def test_any_word_is_a_file_or_a_name(word: str) -> None:
    if "\0" in word or Path(word).exists():
        return
    file, name = file_and_name(word)
    assert (file is None) != (name is None)


@pytest.mark.parametrize(
    ("extra", "at", "expected"),
    [
        ("", [0, 0.2, 0.3, 0.6, 1], [(1, 0, 0), (1, 0, 0), (0.5, 0.5, 0), (0, 0.5, 0.5), (0, 0, 1)]),
        ("<Field name='smoothing' type='string'>None</Field>",
         [0, 0.29, 0.31, 0.59, 0.61, 1], [(1, 0, 0), (1, 0, 0), (0, 1, 0), (0, 1, 0), (0, 0, 1), (0, 0, 1)]),
        ("<Field name='smoothingFlag' type='bool'>false</Field><Field name='equalSpacingFlag' type='bool'>true</Field>",
         [0, 0.32, 0.34, 0.66, 0.67], [(1, 0, 0), (1, 0, 0), (0, 1, 0), (0, 1, 0), (0, 0, 1)]),
        ("<Field name='equalSpacingFlag' type='bool'>true</Field>",
         [0, 1 / 3, 2 / 3, 1], [(1, 0, 0), (0.5, 0.5, 0), (0, 0.5, 0.5), (0, 0, 1)]),
    ],
)  # fmt: skip
def test_colours_of_visit_are_where_visit_draws_them(
    tmp_path: Path, extra: str, at: list[float], expected: list[tuple[float, ...]]
) -> None:
    fitted = TransferFunction.read(visit(tmp_path, extra)).fitted(0.0, 100.0)
    np.testing.assert_allclose(fitted.colour_at(100.0 * np.array(at)), expected, atol=2e-6)
    np.testing.assert_allclose(fitted.opacity_at([0.0, 50.0, 100.0]), [0.0, 0.5, 1.0])


def test_volume_plots_of_visit_have_colours_limits_and_a_note(tmp_path: Path) -> None:
    limits = "".join(
        f"<Field name='useColorVar{end}'>true</Field><Field name='colorVar{end}' type='float'>{value}</Field>"
        for end, value in (("Min", 10), ("Max", 30))
    )
    tf = TransferFunction.read(visit(tmp_path, "", limits, "plot.xml", True))
    assert tf.range == (10.0, 30.0) and tf.placed and "opacities of 'plot.xml' are not read" in tf.notes[0]
    np.testing.assert_allclose(tf.fitted(0.0, 100.0).colour_at([14.0, 18.0, 26.0]), np.eye(3), atol=1e-6)
    assert not TransferFunction.read(visit(tmp_path, "", "", "plot.xml", True)).placed
    compact = (
        "<Object name='ColorControlPointList'><Field name='compactColors'>255 0 0 255 0 0 255 255</Field>"
        "<Field name='compactPositions'>0 1</Field></Object>"
    )
    (tmp_path / "b.ct").write_text(f"<Object name='ColorTable'>{compact}</Object>")
    assert TransferFunction.read(tmp_path / "b.ct").colours == ((0.0, 1.0, 0.0, 0.0), (1.0, 0.0, 0.0, 1.0))


@pytest.mark.parametrize(
    ("there", "other", "says"),
    [
        ("255 0 0", "red", "as VisIt writes it"), ("255 0 0", "999 0 0", "beyond 0 and 255"),
        (">0.2<", ">-0.2<", "between 0 and 1"), ("ColorControlPointList", "List", "0 lists"), ("</Object>", "", "XML"),
        ("<?xml version", "<!ENTITY a><?xml version", "XML"), ("Object", "Svg", "begins with Svg"),
    ],
)  # fmt: skip
def test_what_visit_does_not_write_is_one_sentence(tmp_path: Path, there: str, other: str, says: str) -> None:
    file = visit(tmp_path)
    assert there in file.read_text()
    file.write_text(file.read_text().replace(there, other))
    with pytest.raises(BadInput, match=says) as caught:
        TransferFunction.read(file)
    assert "\n" not in str(caught.value)


def test_what_visit_draws_otherwise_is_one_sentence(tmp_path: Path) -> None:
    for extra, more, says in (
        ("<Field name='smoothing' type='string'>CubicSpline</Field>", "", "Smoothing to Linear"),
        ("", "<Field name='scaling' type='string'>Log</Field>", "Scale to Linear"),
        ("", "<Field name='useColorVarMin' type='bool'>true</Field>", "both limits"),
    ):
        with pytest.raises(BadInput, match=says):
            TransferFunction.read(visit(tmp_path, extra, more))
    whole = visit(tmp_path, plot=True).read_text()
    (tmp_path / "two.session").write_text(f"<Object name='VisIt'>{2 * whole[21:]}</Object>")
    with pytest.raises(BadInput, match="2 volume plots"):
        TransferFunction.read(tmp_path / "two.session")


@dataclass
class Table:
    """A table of a yt function."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]


def yt_function(alphas: NDArray[np.float64], colours: NDArray[np.float64], grey: bool = True) -> SimpleNamespace:
    x = np.linspace(-3.0, 5.0, len(alphas))
    tables = dict(zip(("red", "green", "blue", "alpha"), (Table(x, y) for y in (*colours.T, alphas))))
    return SimpleNamespace(grey_opacity=grey, **tables)


def marched(tf: SimpleNamespace, values: NDArray[np.float64], share: float) -> NDArray[np.float64]:
    """Premultiplied colour and alpha of a ray through values, each over a part of the camera's depth, as yt adds
    them (FIT_eval_transfer).
    """
    rgba = np.zeros(4)
    for value in values:
        inside = tf.alpha.x[0] < value < tf.alpha.x[-1]
        red, green, blue, alpha = (
            np.interp(value, part.x, part.y) if inside else 0.0 for part in (tf.red, tf.green, tf.blue, tf.alpha)
        )
        rgba = share * alpha * np.array([red, green, blue, 1.0]) + max(1.0 - share * alpha, 0.0) * rgba
    return rgba


@given(st.integers(0, 2**32 - 1), st.floats(0.05, 60.0), st.floats(0.01, 1e4))
@settings(max_examples=25, deadline=None)
def test_a_function_of_yt_draws_what_yt_draws(seed: int, most: float, depth: float) -> None:
    rng = np.random.default_rng(seed)
    alphas = most * rng.random(64) * (rng.random(64) > 0.4)
    given_tf = yt_function(alphas, rng.random((64, 3)))
    if not alphas.any():
        return
    tf = TransferFunction.from_yt(given_tf, depth)
    values = np.repeat(rng.uniform(-4.0, 6.0, 40), 200)  # outside its bounds, too
    expected = marched(given_tf, values, 1.0 / len(values))
    length = depth / len(values)
    assert tf.unit_distance is not None
    kept = (1.0 - tf.opacity_at(values[::200]).repeat(200)) ** (length / tf.unit_distance)
    rgba, colours = np.zeros(4), tf.colour_at(values[::200]).repeat(200, axis=0)
    for share, colour in zip(1.0 - kept, colours):
        rgba = share * np.array([*colour, 1.0]) + (1.0 - share) * rgba
    np.testing.assert_allclose(rgba, expected, atol=0.012)


def test_functions_of_yt_that_nothing_else_draws_are_refused() -> None:
    alphas, colours = np.array([0.0, 1.0, 0.0]), np.full((3, 3), 0.5)
    for tf, depth, says in (
        (yt_function(alphas, colours, grey=False), 1.0, "grey_opacity=True"),
        (yt_function(alphas, 3.0 * colours), 1.0, "colours up to 1.5"),
        (yt_function(-alphas, colours), 1.0, "negative"),
        (yt_function(alphas, colours), 0.0, "positive"), (yt_function(alphas, colours), np.inf, "positive"),
        (object(), 1.0, "no yt"), (yt_function(np.array([0.0, np.nan, 0.0]), colours), 1.0, "negative"),
    ):  # fmt: skip
        with pytest.raises(BadInput, match=says):
            TransferFunction.from_yt(tf, depth)
