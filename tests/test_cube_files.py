"""Gaussian cube files: densities and orbitals, with the lengths of the file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("vtkmodules")

from svv.dvr.read.grids import index_to_world, to_array
from svv.dvr.read.volumes import read_here, read_volume
from svv.errors import BadInput
from tests.letter import ORIGIN, SPACING, letter

DENSITY = letter() / 1000.0


def cube(
    path: Path,
    values: np.ndarray,
    axes: np.ndarray | None = None,
    atoms: int = 1,
    header: str = "",
    each: str = "",
    sign: int = 1,
    form: str = "{:13.5E}",
) -> Path:
    """Write values (x, y, z, each) as cubegen does: six numbers a line, and a new line after each row along z."""
    axes = np.diag(SPACING) if axes is None else axes
    lines = ["density", "an L", f"{atoms:5d}{ORIGIN[0]:12.6f}{ORIGIN[1]:12.6f}{ORIGIN[2]:12.6f}{each}"]
    lines += [f"{sign * n:5d}" + "".join(f"{x:12.6f}" for x in axis) for n, axis in zip(values.shape, axes.T)]
    lines += [f"{6:5d}{6.0:12.6f}{ORIGIN[0]:12.6f}{ORIGIN[1]:12.6f}{ORIGIN[2]:12.6f}"] * abs(atoms)
    lines += [header] if header else []
    for row in values.reshape(-1, int(np.prod(values.shape[2:]))):
        lines += ["".join(form.format(x) for x in row[k : k + 6]) for k in range(0, len(row), 6)]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("name", ["d.cube", "d.CUB"])
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("read", [read_here, read_volume])
def test_a_density_keeps_values_and_lengths(name: str, sign: int, read: object, tmp_path: Path) -> None:
    """Bohr, or ångström if the counts are negative: the file's unit is that of the world."""
    assert callable(read)
    volume = read(cube(tmp_path / name, DENSITY.T, sign=sign))
    np.testing.assert_allclose(to_array(volume), DENSITY, rtol=1e-5)
    assert volume.GetSpacing() == SPACING and volume.GetOrigin() == ORIGIN


def test_a_turned_box_stays_turned_and_a_sheared_one_is_refused(tmp_path: Path) -> None:
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    volume = read_here(cube(tmp_path / "d.cube", DENSITY.T, turn * SPACING))
    np.testing.assert_allclose(index_to_world(volume)[:3, :3], turn * SPACING)
    left = np.diag(SPACING) * [1.0, 1.0, -1.0]
    np.testing.assert_allclose(index_to_world(read_here(cube(tmp_path / "l.cube", DENSITY.T, left)))[:3, :3], left)
    sheared = np.diag(SPACING) + np.array([[0.0, 1.0, 0.0], [0.0] * 3, [0.0] * 3])
    with pytest.raises(BadInput, match=r"not perpendicular \(a sheared grid\)"):
        read_here(cube(tmp_path / "s.cube", DENSITY.T, sheared))


def test_orbitals_are_channels(tmp_path: Path) -> None:
    both = np.stack([DENSITY.T, -2.0 * DENSITY.T], -1)
    path = cube(tmp_path / "o.cube", both, atoms=-2, header="    2   17   18")
    with pytest.raises(BadInput, match=r"^o.cube has 2 channels \(0 orbital 17, 1 orbital 18\): choose one with --ch"):
        read_here(path)
    for channel in ("1", "orbital 18"):
        np.testing.assert_allclose(to_array(read_here(path, channel=channel)), -2.0 * DENSITY, rtol=1e-5)
    one = cube(tmp_path / "one.cube", DENSITY.T, atoms=-1, header="    1   17")
    np.testing.assert_allclose(to_array(read_here(one)), DENSITY, rtol=1e-5)
    many = np.stack([DENSITY.T * k for k in range(1, 13)], -1)
    ids = "   12" + "".join(f"{k:5d}" for k in range(1, 10)) + "\n" + "".join(f"{k:5d}" for k in range(10, 13))
    path = cube(tmp_path / "many.cube", many, atoms=-1, header=ids)
    np.testing.assert_allclose(to_array(read_here(path, channel="11")), 12.0 * DENSITY, rtol=1e-5)


def test_a_density_and_its_gradient_are_channels(tmp_path: Path) -> None:
    four = np.stack([DENSITY.T * k for k in (1, 2, 3, 4)], -1)
    path = cube(tmp_path / "g.cube", four, each="    4")
    with pytest.raises(BadInput, match=r"has 4 channels \(0 to 3\): choose one with --channel"):
        read_here(path)
    np.testing.assert_allclose(to_array(read_here(path, channel="2")), 3.0 * DENSITY, rtol=1e-5)


def test_numbers_as_fortran_writes_them(tmp_path: Path) -> None:
    path = cube(tmp_path / "f.cube", DENSITY.T)
    text = path.read_text().replace(" 0.00000E+00", " 1.23456-101").replace("E-", "D-")
    path.write_text(text)
    np.testing.assert_allclose(to_array(read_here(path)), np.maximum(DENSITY, 1.23456e-101), rtol=1e-5)


@pytest.mark.parametrize("keep", [40, 200, 1000])
def test_a_file_that_is_cut_off_is_refused(keep: int, tmp_path: Path) -> None:
    path = cube(tmp_path / "d.cube", DENSITY.T)
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(BadInput, match="damaged"):
        read_here(path)
