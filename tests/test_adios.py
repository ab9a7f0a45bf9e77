"""Files of ADIOS: values, places, steps and damage, and the process that reads them."""

from __future__ import annotations

import gc
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from svv.bricks.formats.axes import Choice
from svv.bricks.opened import data_files, open_bricks
from svv.dvr.read.volumes import read_here
from svv.errors import BadInput
from svv.io import adios_process, adios_script
from svv.io.adios_process import AdiosFile
from tests.ell_volume import FIRST, STEP, assert_shown, ell
from tests.nightly import nightly

ORIGIN = (0.0, 0.0, 0.0)


def written(
    path: Path, arrays: dict[str, NDArray[Any]], attributes: dict[str, Any] | None = None, engine: str = "BP5",
    steps: int = 1,
) -> Path:  # fmt: skip
    """Write arrays, to which the number of each step is added, and attributes."""
    adios2 = pytest.importorskip("adios2")
    io = adios2.Adios().declare_io("writer")
    io.set_engine(engine)
    with adios2.Stream(io, str(path), "w") as stream:
        for step in range(steps):
            stream.begin_step()
            for name, values in arrays.items():
                shifted = np.ascontiguousarray(values + np.asarray(step, values.dtype))
                stream.write(name, shifted, list(values.shape), [0] * values.ndim, list(values.shape))
            for name, value in (attributes or {}).items() if step == 0 else ():
                stream.write_attribute(name, value)
            stream.end_step()
    return path


PLACED = {"density/spacing": STEP[::-1].tolist(), "density/offset": FIRST[::-1].tolist()}


@pytest.mark.parametrize(
    ("engine", "kind"),
    nightly([("BP3", "f4"), ("BP4", "u2"), ("BP5", "i4"), ("BP5", "f8")], ("BP3", "f4"), ("BP5", "i4")),
)
def test_values_are_in_their_places(tmp_path: Path, engine: str, kind: str) -> None:
    path = written(tmp_path / "a.bp", {"density": ell(kind)}, PLACED, engine)
    assert_shown(path)
    assert open_bricks(path) is not None
    assert bool(data_files(path)) == (engine == "BP3")  # whose values lie beside it
    with pytest.raises(BadInput, match=r"no volume 'speed'; volumes: density"):
        read_here(path, array="speed")


def test_without_attributes_a_voxel_is_said_to_be_one(tmp_path: Path) -> None:
    assert_shown(written(tmp_path / "a.bp", {"density": ell()}), (1, 1, 1), ORIGIN, says="no voxel size")


def test_steps_are_time_points(tmp_path: Path) -> None:
    path = written(tmp_path / "a.bp", {"density": ell()}, PLACED, steps=3)
    assert_shown(path, background=2.0, time=2)
    with pytest.raises(BadInput, match=r"3 time points \(0 to 2\): choose one with --time"):
        read_here(path)
    with pytest.raises(BadInput, match="no time point 3"):
        read_here(path, time=3)


@pytest.mark.parametrize(("layout", "order"), [("groups", "C"), ("steps", "F")])
def test_meshes_of_open_pmd(tmp_path: Path, layout: str, order: str) -> None:
    arrays: dict[str, NDArray[Any]] = {}
    attributes: dict[str, Any] = {}
    axes, turn = (["z", "y", "x"], -1) if order == "C" else (["x", "y", "z"], 1)
    for k, iteration in enumerate(("100", "200") if layout == "groups" else ("",)):
        mesh = f"/data/{iteration}/meshes/E" if iteration else "/data/meshes/E"
        arrays[f"{mesh}/x"] = ell() + np.float32(k)
        attributes |= {
            f"{mesh}/geometry": "cartesian", f"{mesh}/dataOrder": order, f"{mesh}/axisLabels": axes,
            f"{mesh}/gridSpacing": (1000.0 * STEP[::turn]).tolist(), f"{mesh}/gridUnitSI": 1e-3,
            f"{mesh}/gridGlobalOffset": (1000.0 * (FIRST - 0.5 * STEP)[::turn]).tolist(),
            f"{mesh}/x/position": [0.5, 0.5, 0.5], f"{mesh}/x/unitSI": 2.0,
        }  # fmt: skip
    path = written(tmp_path / "a.bp", arrays, attributes, steps=1 if layout == "groups" else 2)
    if order == "F":  # labels are in the order of Fortran, in which the first axis is the fastest
        assert_shown(path, factor=2.0, background=2.0, time=1)
        return
    assert_shown(path, factor=2.0, background=2.0, time=1, array="meshes/E/x")
    with pytest.raises(BadInput, match="2 time points"):
        read_here(path)


@pytest.mark.parametrize("kind", nightly(["PointData", "CellData", "points", "cells"], "CellData", "points"))
def test_models_for_vtk_and_fides(tmp_path: Path, kind: str) -> None:
    on_cells = kind in ("CellData", "cells")
    first = FIRST - 0.5 * STEP if on_cells else FIRST
    if kind.endswith("Data"):
        numbers = [" ".join(map(str, values)) for values in (first.tolist(), STEP.tolist())]
        attributes: dict[str, Any] = {
            "vtk.xml": f'<VTKFile type="ImageData"><ImageData WholeExtent="0 22 0 18 0 14" Origin="{numbers[0]}" '
            f'Spacing="{numbers[1]}"><Piece><{kind}><DataArray Name="U"/></{kind}></Piece></ImageData></VTKFile>'
        }
    else:
        attributes = {
            "Fides_Data_Model": "uniform", "Fides_Origin": first.tolist(), "Fides_Spacing": STEP.tolist(),
            "Fides_Variable_List": ["U", "V"], "Fides_Variable_Associations": [kind, "points"],
        }  # fmt: skip
    arrays = {"U": ell(), "V": ell() + np.float32(1)}
    path = written(tmp_path / "a.bp", arrays, attributes)
    assert_shown(path, array="U")
    with pytest.raises(BadInput, match=r"several volumes of one size: name one of them \(U, V\)"):
        read_here(path)


COUNTED = np.arange(3 * 7 * 6 * 5, dtype=np.int32).reshape(3, 7, 6, 5)


@pytest.fixture(scope="module")
def counted(tmp_path_factory: pytest.TempPathFactory) -> AdiosFile:
    """A file with an array and, in its second step, this and 1."""
    return AdiosFile(written(tmp_path_factory.mktemp("adios") / "a.bp", {"a": COUNTED}, steps=2))


@given(data=st.data())
@settings(max_examples=40, deadline=None)
def test_boxes_are_those_of_the_array(data: st.DataObject, counted: AdiosFile) -> None:
    spans = [sorted(data.draw(st.sets(st.integers(0, n), min_size=2, max_size=2))) for n in COUNTED.shape]
    step = data.draw(st.integers(0, 1))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(adios_process, "BLOCK", data.draw(st.sampled_from([64, 500, 1 << 26])))
        found = counted.read("a", [a for a, _ in spans], [b - a for a, b in spans], step)
    np.testing.assert_array_equal(found, (COUNTED + step)[tuple(slice(a, b) for a, b in spans)])


def test_a_process_that_ended_is_replaced_and_none_is_left(tmp_path: Path) -> None:
    opened = AdiosFile(written(tmp_path / "a.bp", {"density": ell()}))
    first = opened._process
    first.kill()
    first.wait()
    np.testing.assert_array_equal(opened.read("density", [0, 0, 0], [14, 18, 22], 0), ell())
    second = opened._process
    assert second is not first and second.poll() is None
    del opened
    gc.collect()
    assert second.poll() is not None


def test_what_is_no_volume_is_one_sentence(tmp_path: Path) -> None:
    adios2 = pytest.importorskip("adios2")
    flat = written(tmp_path / "flat.bp", {"a": np.zeros((4, 5), np.float32), "t": np.zeros(3)})
    with pytest.raises(BadInput, match=r"no variable with three axes and a global shape; volumes: none"):
        read_here(flat)
    with adios2.Stream(str(tmp_path / "grows.bp"), "w") as stream:
        for n in (4, 5):
            stream.begin_step()
            stream.write("a", np.zeros((n, 4, 4), np.float32), [n, 4, 4], [0, 0, 0], [n, 4, 4])
            stream.end_step()
    with pytest.raises(BadInput, match="shape changes from step to step"):
        read_here(tmp_path / "grows.bp", time=0)
    wrong = written(tmp_path / "wrong.bp", {"U": ell()}, {"Fides_Spacing": [1.0, 2.0]})
    with pytest.raises(BadInput, match="three numbers each"):
        read_here(wrong)
    complex_ = written(tmp_path / "complex.bp", {"U": ell("c8")})
    with pytest.raises(BadInput, match="float complex in U, which cannot be shown"):
        read_here(complex_)


def test_files_that_are_cut_off_are_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(tmp_path / "a.bp", {"density": ell()}, PLACED)
    index, values = (path / name for name in ("md.idx", "data.0"))
    whole = index.read_bytes()
    for size in (0, 20, 70):
        index.write_bytes(whole[:size])
        with pytest.raises(
            BadInput, match=r"is damaged, incomplete, or not a file of ADIOS|has no variables"
        ) as caught:
            read_here(path)
        assert "\n" not in str(caught.value) and "\x1b" not in str(caught.value)
    index.write_bytes(whole)
    values.write_bytes(values.read_bytes()[:5000])
    monkeypatch.setattr(adios_process, "SECONDS", 1)
    with pytest.raises(BadInput, match="no answer within 1 s"):  # ADIOS waits for the rest
        read_here(path)
    (tmp_path / "text.bp").write_text("no file of ADIOS, but long enough to hold the end of one" * 4)
    with pytest.raises(BadInput, match="is damaged, incomplete, or not a file of ADIOS"):
        read_here(tmp_path / "text.bp")


BEGINNING = 'print(\'{"variables": {"a": {"shape": [4, 4, 4], "type": "float", "steps": 1}}, "attributes": {}}\')\n'


@pytest.mark.parametrize(
    ("program", "says"),
    [
        ("import os; os.abort()", "ADIOS ended with SIGABRT"), ("raise SystemExit(3)", "ADIOS ended with exit code 3"),
        ("print('{\"missing\": \"adios2\"}')", r"needs the package adios2: pip install 'svv\[formats\]'"),
        ("print('{\"says\": \"\\\\u001b[1m [ADIOS2 EXCEPTION] <Toolkit> : why \\\\n: no\"}')", r"\(why : no\)"),
        (f"import sys\n{BEGINNING}sys.stdout.flush()\ninput()\nraise SystemExit(4)", "exit code 4"),
        (f"{BEGINNING}print('{{\"dtype\": \"<f4\", \"bytes\": 8}}')\nprint('abcdefg')", "other values than it says"),
    ],
)  # fmt: skip
def test_whatever_ends_the_process_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, program: str, says: str
) -> None:
    (tmp_path / "program.py").write_text(program)
    (tmp_path / "a.bp").write_text("anything")
    monkeypatch.setattr(adios_script, "__file__", str(tmp_path / "program.py"))
    with pytest.raises(BadInput, match=says):
        source = open_bricks(tmp_path / "a.bp", choice=Choice())
        assert source is not None
        source.read(0, (0, 0, 0), (4, 4, 4))


def test_programs_of_paraview_need_to_know_a_python(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.bp").write_text("anything")
    monkeypatch.setattr(sys, "executable", "/opt/ParaView/bin/pvbatch")
    monkeypatch.delenv("SVV_PYTHON", raising=False)
    with pytest.raises(BadInput, match="start it with `svv paraview`"):
        AdiosFile(tmp_path / "a.bp")
