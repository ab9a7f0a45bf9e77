"""Plotfiles of AMReX, as yt 4.4.3 and VTK read them: place, levels, and damage."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from svv.dvr.read.grids import assumed_of, index_to_world, to_array
from svv.dvr.read.plotfiles import plotfile_reader
from svv.dvr.read.volumes import read_here
from svv.errors import BadInput

pytest.importorskip("vtkmodules.vtkIOAMR")


def plotfile(folder: Path, levels: int = 1, names: tuple[str, ...] = ("density",)) -> Path:
    """Write a cube of 16 cells of .5 a side at (1, 2, 3); the values are x + 10 y + 100 z of the cells' centres."""
    low = np.array([1.0, 2.0, 3.0])
    boxes = [((0, 0, 0), (15, 15, 15)), ((8, 8, 8), (15, 15, 15))][:levels]  # the second of cells half as large

    def text(numbers: np.ndarray) -> str:
        return " ".join(f"{number:.17g}" for number in numbers)

    spans = [f"({','.join(map(str, a))}) ({','.join(map(str, b))})" for a, b in boxes]
    grids = []
    for level, (first, last) in enumerate(boxes):
        step = 0.5 / 2**level
        begin, end = low + step * np.array(first), low + step * (np.array(last) + 1)
        grids.append(f"{level} 1 0.5\n0\n" + "".join(f"{a:.17g} {b:.17g}\n" for a, b in zip(begin, end)))
        grids.append(f"Level_{level}/Cell\n")
    head = f"HyperCLaw-V1.1\n{len(names)}\n" + "".join(f"{name}\n" for name in names)
    head += f"3\n0.5\n{levels - 1}\n{text(low)}\n{text(low + 8.0)}\n" + " ".join(["2"] * (levels - 1)) + "\n"
    domains = [f"((0,0,0) ({16 * 2**k - 1},{16 * 2**k - 1},{16 * 2**k - 1}) (0,0,0))" for k in range(levels)]
    head += " ".join(domains) + "\n" + " ".join(["0"] * levels) + "\n"
    head += "".join(text(np.full(3, 0.5 / 2**k)) + "\n" for k in range(levels)) + "0\n0\n"
    folder.mkdir(parents=True)
    (folder / "Header").write_text(head + "".join(grids))
    for level, ((first, last), span) in enumerate(zip(boxes, spans)):
        step, place = 0.5 / 2**level, folder / f"Level_{level}"
        x, y, z = (low[k] + step * (np.arange(first[k], last[k] + 1) + 0.5) for k in range(3))
        values = x[None, None, :] + 10 * y[None, :, None] + 100 * z[:, None, None]
        ends = f"1,{len(names)}\n" + f"{values.min():.17g}," * len(names)
        place.mkdir()
        (place / "Cell_H").write_text(
            f"1\n1\n{len(names)}\n0\n(1 0\n({span} (0,0,0))\n)\n1\nFabOnDisk: Cell_D_00000 0\n\n{ends}\n\n{ends}\n"
        )
        fab = f"FAB ((8, (64 11 52 0 1 12 0 1023)),(8, (8 7 6 5 4 3 2 1)))({span} (0,0,0)) {len(names)}\n".encode()
        content = b"".join(((k + 1) * values).astype("<f8").tobytes() for k in range(len(names)))
        (place / "Cell_D_00000").write_bytes(fab + content)
    return folder


@pytest.mark.parametrize("levels", [1, 2])
def test_values_are_those_of_the_cells(tmp_path: Path, levels: int) -> None:
    image = read_here(plotfile(tmp_path / "plt00010", levels))
    values, matrix = to_array(image), index_to_world(image)
    assert image.GetSpacing() == pytest.approx((0.5 / 2 ** (levels - 1),) * 3, rel=1e-4)
    assert "was resampled" in str(assumed_of(image))
    z, y, x = np.indices(values.shape)
    places = np.einsum("ij,jzyx->izyx", matrix, np.stack([x, y, z, np.ones_like(x)]))
    wanted = places[0] + 10 * places[1] + 100 * places[2]
    assert np.abs(values - wanted).max() <= 0.5 * 111 * 0.5 + 1e-6, "a point has the value of the cell it lies in"


def test_one_of_several_arrays_is_chosen(tmp_path: Path) -> None:
    folder = plotfile(tmp_path / "plt00010", 1, ("density", "temperature"))
    one, other = (to_array(read_here(folder, array=name)) for name in ("density", "temperature"))
    np.testing.assert_allclose(other, 2 * one, rtol=1e-6)
    with pytest.raises(BadInput, match="no array 'pressure'"):
        read_here(folder, array="pressure")


@pytest.mark.parametrize("missing", ["Level_0/Cell_H", "Level_0/Cell_D_00000"])
def test_a_missing_file_is_one_sentence(tmp_path: Path, missing: str) -> None:
    folder = plotfile(tmp_path / "plt00010")
    (folder / missing).unlink()
    with pytest.raises(BadInput, match="damaged or incomplete") as caught:
        read_here(folder)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["Header", "Level_0/Cell_H", "Level_0/Cell_D_00000"])
def test_what_breaks_off_is_refused_before_vtk_sees_it(tmp_path: Path, name: str, monkeypatch: Any) -> None:
    folder = plotfile(tmp_path / "plt00010")
    monkeypatch.setattr("vtkmodules.vtkIOAMR.vtkAMReXGridReader", lambda: pytest.fail("VTK got it"))
    whole = (folder / name).read_bytes()
    for k in range(1, 5):
        (folder / name).write_bytes(whole[: len(whole) * k // 10])
        with pytest.raises(BadInput, match="damaged or incomplete"):
            plotfile_reader(folder)
