"""ADIOS2: a folder (BP4, BP5) or a file (BP3), by adios2 in a process of its own (:mod:`svv.io.adios_process`).

Steps, and openPMD's iterations, are time points. Sizes are those of openPMD, of a model for VTK (``vtk.xml``) or Fides,
or attributes of the variable.

Sources: https://adios2.readthedocs.io (VTK), https://fides.readthedocs.io and :mod:`svv.bricks.formats.open_pmd`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from svv.bricks.formats.axes import Choice
from svv.bricks.formats.chunked import ChunkedSource, source_of
from svv.bricks.formats.open_pmd import axes_of_mesh
from svv.bricks.formats.places import Axis, sized, text_of
from svv.core.xml_values import parsed_xml
from svv.errors import BadInput
from svv.io.adios_process import AdiosFile

BYTES = (1, 2, 4, 8)
TYPES = {
    "char": "i1", "float": "f4", "double": "f8",
    **{f"int{8 * n}_t": f"i{n}" for n in BYTES}, **{f"uint{8 * n}_t": f"u{n}" for n in BYTES},
}  # fmt: skip
"""Types of values that can be shown, by ADIOS's names."""

ITERATION = r"/?data/(?P<t>\d+)/(?P<rest>(?:meshes|fields)/.+)"
"""Pattern of the names of openPMD's meshes, which in its older layout are other ones at each iteration."""


def is_bp(folder: Path) -> bool:
    """Return whether a folder is one of ADIOS."""
    return (folder / "md.idx").is_file() and (folder / "md.0").is_file()


def open_bp(path: Path, choice: Choice = Choice(), array: str | None = None) -> ChunkedSource:  # noqa: B008 - frozen
    """Open a variable; by default the only or the largest one with three axes.

    Args:
        path: The folder or file.
        choice: The time point, and the channel of an axis of that name.
        array: Name of the variable, or the end of it after a slash.

    Raises:
        BadInput: It is damaged, has no such variable, or adios2 is not installed.
    """
    opened = AdiosFile(path)
    names = _variable(opened, path, array)
    name, told = names[0], opened.variables[names[0]]
    shape, steps = tuple(told["shape"]), len(names) if len(names) > 1 else told["steps"]
    if told["type"] not in TYPES:
        raise BadInput(f"{path.name} has values of the type {told['type']} in {name}, which cannot be shown.")
    try:
        axes, attributes = _layout(opened.attributes, name, shape, path.name)
    except (KeyError, TypeError, ValueError) as error:
        raise BadInput(f"{path.name} has attributes of {name} that do not fit it ({error}).") from error
    data = Steps(opened, names, steps)
    whole = [Axis("t"), *axes], (steps, *shape)
    return source_of(path.name, data, TYPES[told["type"]], whole[1], whole[0], choice, attributes)


@dataclass(frozen=True, eq=False)
class Steps:
    """A variable with its steps as the first axis, or several as such."""

    file: AdiosFile
    names: list[str]
    steps: int

    def __getitem__(self, index: tuple[int | slice, ...]) -> NDArray[Any]:
        step, *rest = index
        assert isinstance(step, int)
        spans = [(k, k + 1) if isinstance(k, int) else (k.start, k.stop) for k in rest]
        start, count = [a for a, _ in spans], [b - a for a, b in spans]
        several = len(self.names) > 1
        values = self.file.read(self.names[step if several else 0], start, count, 0 if several else step)
        return values[tuple(0 if isinstance(k, int) else slice(None) for k in rest)]


def _variable(opened: AdiosFile, path: Path, array: str | None) -> list[str]:
    """Return the names of the variable that is shown; several if each is a time point.

    Raises BadInput if there is none, several of the largest size and no name, or its shape changes from step to step.
    """
    if not opened.variables:
        raise BadInput(f"{path} has no variables: it is damaged, or was not written to its end.")
    shapes = {name: told["shape"] for name, told in opened.variables.items()}
    families: dict[str, dict[int, str]] = {}
    for name, shape in shapes.items():
        if shape is None or sum(side > 1 for side in shape) >= 3:
            fits = re.fullmatch(ITERATION, name)
            own, time = (fits["rest"], int(fits["t"])) if fits else (name.strip("/"), 0)
            families.setdefault(own, {})[time] = name
    asked = (array or "").strip("/")
    if exact := next((name for name in shapes if name.strip("/") == asked), None):
        shown = {asked: {0: exact}} if families.get(asked) is None else {asked: families[asked]}
    else:
        shown = {own: one for own, one in families.items() if f"/{own}".endswith(f"/{asked}" if asked else "")}
    if not shown:
        wanted = f"no volume '{array}'" if array else "no variable with three axes and a global shape"
        raise BadInput(f"{path} has {wanted}; volumes: {', '.join(families) or 'none'}.")
    sizes = {own: max(int(np.prod(shapes[n] or 0)) for n in one.values()) for own, one in shown.items()}
    largest = [own for own, size in sizes.items() if size == max(sizes.values())]
    if len(largest) > 1:
        raise BadInput(f"{path} has several volumes of one size: name one of them ({', '.join(largest)}) with --array.")
    names = [name for _, name in sorted(shown[largest[0]].items())]
    if len({str(shapes[name]) for name in names}) > 1 or shapes[names[0]] is None:
        raise BadInput(f"{path} has a volume {largest[0]} whose shape changes from step to step: save one step of it.")
    return names


def _layout(
    attributes: Mapping[str, Any], name: str, shape: tuple[int, ...], title: str
) -> tuple[list[Axis], Mapping[str, Any]]:
    """Return the axes of a variable, and how its values are packed."""
    own, above = (_below(attributes, place) for place in (name, name.rpartition("/")[0]))
    for mesh in (own, above):
        if "gridSpacing" in mesh:
            return axes_of_mesh(mesh, own, title)
    step, first = _for_vtk(attributes, name)
    if step and len(shape) == 3:
        return [Axis(letter, a, b) for letter, a, b in zip("zyx", step[::-1], first[::-1])], own
    return sized([Axis() for _ in shape], own, shape), own


def _below(attributes: Mapping[str, Any], place: str) -> dict[str, Any]:
    """Return the attributes of a variable or a group."""
    return {key[len(place) + 1 :]: value for key, value in attributes.items() if key.startswith(f"{place}/")}


def _for_vtk(attributes: Mapping[str, Any], name: str) -> tuple[list[float], list[float]]:
    """Return the step and the first place along x, y, z of a uniform grid that is described for VTK or Fides.

    Raises ValueError if it is damaged.
    """
    told = [value for key, value in attributes.items() if key.rpartition("/")[2] == "vtk.xml"]
    for text in told:
        grid = parsed_xml(text_of(text)).find("ImageData")
        arrays = {} if grid is None else {one.get("Name"): kind for kind in grid.iter() for one in kind}
        if grid is not None and name.rpartition("/")[2] in arrays:
            step, first = (
                [float(word) for word in grid.get(key, usual).split()]
                for key, usual in (("Spacing", "1 1 1"), ("Origin", "0 0 0"))
            )
            half = 0.5 if arrays[name.rpartition("/")[2]].tag == "CellData" else 0.0
            return _three(step, [a + half * b for a, b in zip(first, step)])
    if "Fides_Spacing" in attributes:
        on_cells = "cell" in text_of(_associated(attributes, name))
        step = [float(one) for one in np.ravel(attributes["Fides_Spacing"])]
        first = [float(one) for one in np.ravel(attributes.get("Fides_Origin", [0.0] * 3))]
        return _three(step, [a + (0.5 if on_cells else 0.0) * b for a, b in zip(first, step)])
    return [], []


def _associated(attributes: Mapping[str, Any], name: str) -> str:
    """Return whether Fides takes the values of a variable for those of points or of cells."""
    names = list(np.ravel(attributes.get("Fides_Variable_List", [])))
    kinds = list(np.ravel(attributes.get("Fides_Variable_Associations", [])))
    return str(kinds[names.index(name)]) if name in names and len(kinds) == len(names) else "points"


def _three(step: list[float], first: list[float]) -> tuple[list[float], list[float]]:
    if len(step) != 3 or len(first) != 3 or not np.isfinite([*step, *first]).all():
        raise ValueError("its spacing and origin need three numbers each")
    return step, first
