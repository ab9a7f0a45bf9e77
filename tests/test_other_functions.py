"""Transfer functions of Inviwo and Voreen and colour tables of ImageJ: values, opacities per length, and damage."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import svv
from svv.bricks.formats.source import Level
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.grids import from_array
from svv.errors import BadInput
from svv.job.opacities import unit_for

ITF = """<?xml version="1.0" encoding="UTF-8" ?>
<InviwoWorkspace version="3">
    <maskMin content="{0}" />
    <maskMax content="{1}" />
    <type content="0" />
    <Points>
        <Point> <pos content="0.25" /> <rgba x="1" y="0.5" z="0" w="0" /> </Point>
        <Point> <pos content="0.75" /> <rgba x="0" y="0.5" z="1" w="0.4" /> </Point>
    </Points>
</InviwoWorkspace>
"""

KEY = (
    '<key type="TransFuncMappingKey"><intensity value="{0}"/><split value="{1}"/>'
    '<colorL r="255" g="0" b="0" a="{2}"/><colorR r="0" g="0" b="255" a="{3}"/></key>'
)

TFI = """<?xml version="1.0" ?>
<VoreenData version="1"><TransFuncIntensity type="TransFuncIntensity">
<domain x="{0}" y="{1}" /><threshold x="{2}" y="{3}" /><alphaMode value="1" /><gammaValue value="1" /><Keys>
{4}</Keys></TransFuncIntensity></VoreenData>
"""


def inviwo(folder: Path, low: float = 0.0, high: float = 1.0) -> Path:
    (folder / "a.itf").write_text(ITF.format(low, high))
    return folder / "a.itf"


def voreen(folder: Path, domain: tuple[float, float] = (0, 1), threshold: tuple[float, float] = (0, 1)) -> Path:
    keys = [KEY.format(0, "false", 0, 0), KEY.format(0.5, "true", 0, 51), KEY.format(1, "false", 102, 0)]
    (folder / "a.tfi").write_text(TFI.format(*domain, *threshold, "\n".join(keys)))
    return folder / "a.tfi"


def test_places_are_parts_of_the_datas_range(tmp_path: Path) -> None:
    function = TransferFunction.read(inviwo(tmp_path))
    for low, high in ((0.0, 1.0), (0.2, 0.8), (-1000.0, 3000.0)):
        fitted = function.fitted(low, high)
        at = low + (high - low) * np.array([0.0, 0.25, 0.5, 0.75, 1.0])
        np.testing.assert_allclose(fitted.opacity_at(at), [0.0, 0.0, 0.2, 0.4, 0.4], atol=1e-9)
        np.testing.assert_allclose(fitted.colour_at(at)[:, 0], [1.0, 1.0, 0.5, 0.0, 0.0], atol=1e-6)
    again = TransferFunction.from_dict(function.to_dict())
    assert again.opacities == function.opacities and not again.placed


def test_what_lies_outside_a_mask_is_not_shown(tmp_path: Path) -> None:
    fitted = TransferFunction.read(inviwo(tmp_path, 0.5, 0.8)).fitted(0.0, 10.0)
    np.testing.assert_allclose(fitted.opacity_at([4.9, 5.1, 7.5, 7.9, 8.1]), [0, 0.208, 0.4, 0.4, 0], atol=1e-9)
    fitted = TransferFunction.read(voreen(tmp_path, threshold=(0.6, 1.0))).fitted(0.0, 10.0)
    np.testing.assert_allclose(fitted.opacity_at([5.5, 6.1, 10.0]), [0, 0.244, 0.4], atol=1e-9)


def test_a_domain_is_one_of_values_and_split_keys_are_jumps(tmp_path: Path) -> None:
    function = TransferFunction.read(voreen(tmp_path, (100.0, 300.0)))
    fitted = function.fitted(0.0, 1000.0)
    np.testing.assert_allclose(
        fitted.opacity_at([99, 199.9, 200.1, 250, 300, 999]), [0, 0, 0.2, 0.3, 0.4, 0.4], atol=1e-3
    )
    np.testing.assert_allclose(fitted.colour_at([199.9, 200.1]), [[1, 0, 0], [0, 0, 1]], atol=2e-3)


@pytest.mark.parametrize(("write", "slabs"), [(inviwo, 150), (voreen, 200)])
def test_opacities_are_those_of_a_part_of_the_volumes_side(tmp_path: Path, write: object, slabs: int) -> None:
    function = TransferFunction.read(write(tmp_path))  # type: ignore[operator]
    cube = Level((20, 20, 20), 0.5 * np.eye(3), np.zeros(3))
    assert function.unit_in(cube) == pytest.approx(10.0 / slabs)
    long = Level((10, 20, 40), 0.5 * np.eye(3), np.zeros(3))
    assert function.unit_in(long) == pytest.approx(10.0 / slabs)
    values = np.full((20, 20, 20), 0.75, np.float32)
    values[0, 0, 0], values[-1, -1, -1] = 0.0, 1.0
    np.save(tmp_path / "a.npy", values)
    views, _ = svv.make_views(
        tmp_path / "a.npy", tmp_path / f"a.{'itf' if slabs == 150 else 'tfi'}",
        svv.ViewOptions(n=12, test=0, size=48, mapper="cpu", projection="orthographic"),
    )  # fmt: skip
    assert views.meta.tf is not None
    assert views.meta.tf["ScalarOpacityUnitDistance"] == pytest.approx(20.0 / slabs)
    known = float(function.fitted(0.0, 1.0).opacity_at([0.75])[0])
    deepest = views.images[..., 3].max() / 255.0
    assert deepest > 1.0 - (1.0 - known) ** (0.9 * 19.0 / (20.0 / slabs)) - 0.02


def test_other_opacities_of_a_scene_count_by_its_volume(tmp_path: Path) -> None:
    function = TransferFunction.read(voreen(tmp_path, (100.0, 300.0)))
    image = from_array(np.zeros((20, 20, 20), np.float32))
    assert unit_for(function, 3.0, image) == pytest.approx(20.0 / 200)
    assert unit_for(replace(function, slabs=None), 3.0, image) == 3.0
    with pytest.raises(BadInput, match="name the volume, too"):
        unit_for(function, 3.0, None)


@pytest.mark.parametrize("kind", ["bytes", "header", "text", "numbered"])
def test_tables_of_imagej_are_colours_with_a_ramp(tmp_path: Path, kind: str) -> None:
    table = np.stack([np.arange(256), 255 - np.arange(256), np.full(256, 7)], 1).astype(np.uint8)
    rows = [" ".join(map(str, row)) for row in table.tolist()]
    numbered = ["Index Red Green Blue", *(f"{k} {row}" for k, row in enumerate(rows))]
    content = {
        "bytes": table.T.tobytes(), "header": b"ICOL" + bytes(28) + table.T.tobytes(), "text": "\n".join(rows).encode(),
        "numbered": "\n".join(numbered).encode(),
    }[kind]  # fmt: skip
    (tmp_path / "a.lut").write_bytes(content)
    fitted = TransferFunction.read(tmp_path / "a.lut").fitted(-10.0, 245.0)
    np.testing.assert_allclose(fitted.colour_at([-10.0, 117.0, 245.0]) * 255, table[[0, 127, 255]], atol=0.01)
    np.testing.assert_allclose(fitted.opacity_at([-10.0, 245.0]), [0.0, 1.0])


@pytest.mark.parametrize(
    ("name", "there", "other"),
    [
        ("itf", "<?xml", "<"), ("itf", "</Points>", ""), ("itf", "pos content", "pos at"), ("itf", 'x="1"', 'x="red"'),
        ("itf", 'type content="0"', 'type content="1"'), ("itf", 'w="0.4"', 'w="4"'), ("itf", "Point>", "Dot>"),
        ("tfi", "<Keys>", "<Pixels>"), ("tfi", "gammaValue value=\"1\"", "gammaValue value=\"2\""),
        ("tfi", "alphaMode value=\"1\"", "alphaMode value=\"2\""), ("tfi", 'r="255"', 'r="999"'),
        ("tfi", 'y="1"', 'y="-1"'), ("tfi", "intensity", "value"), ("tfi", "<key", "<!ENTITY"),
    ],
)  # fmt: skip
def test_damage_is_one_sentence(tmp_path: Path, name: str, there: str, other: str) -> None:
    file = inviwo(tmp_path) if name == "itf" else voreen(tmp_path)
    assert there in file.read_text()
    file.write_text(file.read_text().replace(there, other))
    with pytest.raises(BadInput) as caught:
        TransferFunction.read(file).fitted(0.0, 1.0)
    assert "\n" not in str(caught.value)


def test_other_tables_are_refused(tmp_path: Path) -> None:
    for content in (b"", b"1 2 3\n" * 200, b"\xff" * 767, b"a b c\n" * 256, b"999 0 0\n" * 256):
        (tmp_path / "a.lut").write_bytes(content)
        with pytest.raises(BadInput, match="256 colours"):
            TransferFunction.read(tmp_path / "a.lut")
