"""ParaView's surfaces with handles in the view, as texts of a scene's cuts (:meth:`svv.Cut.parse`).

A filter holds the text, not the surface: results depend on it, and other processes are told it.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkCommonDataModel import vtkBox, vtkCylinder, vtkImplicitFunction, vtkPlane, vtkSphere

from svv.errors import BadInput
from svv.pv.panel.function_edits import observe_for
from svv.pv.panel.properties import Owner, Property, shape
from svv.pv.panel_values import by_name

Vector = NDArray[np.float64]


def cutting_shape(name: str, help: str) -> Property:
    """Return the property of :func:`svv.pv.panel.properties.shape`, for which ``values`` holds the surface's text."""
    current: weakref.WeakKeyDictionary[Owner, vtkImplicitFunction] = weakref.WeakKeyDictionary()

    def take(self: Owner) -> None:
        function = current.get(self)
        text = "" if function is None else text_of(function)
        if by_name(self.values)[name] != text:
            by_name(self.values)[name] = text
            self.Modified()

    def setter(self: Owner, function: vtkImplicitFunction | None) -> None:
        if function is None:
            current.pop(self, None)
        elif current.get(self) is not function:
            current[self], reference = function, weakref.ref(self)

            def moved(*_: object) -> None:
                this = reference()
                if this is not None:
                    take(this)

            observe_for(self, function, moved)
        take(self)

    return replace(shape(name, help), default="", setters={f"Set{name}": setter})


def text_of(function: vtkImplicitFunction) -> str:
    """Return the text of a plane's side to which its normal points, or of a box, a sphere or a cylinder.

    It is empty for a box without inside, whose length along an axis is 0. ParaView turns boxes and cylinders by the
    function's transform, which leads from the world to where it is evaluated.
    """
    to_own = np.eye(4)
    if function.GetTransform() is not None:
        matrix = function.GetTransform().GetMatrix()
        to_own = np.array([[matrix.GetElement(row, column) for column in range(4)] for row in range(4)])
    turn, shift = to_own[:3, :3], to_own[:3, 3]
    if not np.linalg.det(turn):
        return ""
    world = np.linalg.inv(turn)

    def placed(point: Iterable[float]) -> Vector:
        return world @ (np.array(tuple(point)) - shift)

    if isinstance(function, vtkBox):
        return _text_of_box(function, turn, placed)
    if isinstance(function, vtkSphere):
        return f"sphere:{_numbers(function.GetCenter())}:{function.GetRadius()!r}"
    if isinstance(function, vtkCylinder):
        axis = _numbers(world @ np.array(function.GetAxis()))  # turned around the centre
        return f"cylinder:{_numbers(function.GetCenter())}:{axis}:{function.GetRadius()!r}"
    assert isinstance(function, vtkPlane)
    origin, normal = np.array(function.GetOrigin()), np.array(function.GetNormal())
    if hasattr(function, "GetOffset"):  # since VTK 9.5, whose planes tell of a change before their values have it
        if function.GetAxisAligned():  # always to the positive side of the axis that is nearest
            normal = (np.abs(normal) == np.abs(normal).max()).astype(float)
        origin += function.GetOffset() * normal
    else:  # ParaView's own plane has an offset, which Python sees in its values alone
        origin -= normal * (function.EvaluateFunction(*origin) / (normal @ normal or 1.0))
    return f"plane:{_numbers(placed(origin))}:{_numbers(normal @ turn)}"


def cut_at(shape: str, invert: bool, regions: Sequence[int]) -> str:
    """Return the cut at a shape of :func:`text_of`, of all regions if there are none, for :meth:`svv.Cut.parse`.

    Inverted, it keeps what lies behind a plane or inside another shape; otherwise the rest. Raises BadInput if there is
    no shape.
    """
    if not shape:
        raise BadInput("The shape of Cut Open By has no inside: choose a shape, and for a box lengths that are not 0.")
    front = shape.startswith("plane:") and "&" not in shape
    of = f"{','.join(map(str, regions))}=" if regions else ""
    return f"{of}{'' if invert == front else 'outside '}{shape}"


def _text_of_box(box: vtkBox, turn: Vector, placed: Callable[[Iterable[float]], Vector]) -> str:
    """Return the text of six planes, from the rows of ``turn``, which are across the faces, and two corners."""
    low, high = [0.0] * 3, [0.0] * 3
    box.GetXMin(low)
    box.GetXMax(high)
    across = turn / np.linalg.norm(turn, axis=1, keepdims=True)
    ends = (_numbers(placed(low)), across), (_numbers(placed(high)), -across)
    return "&".join(f"plane:{corner}:{_numbers(normal)}" for corner, normals in ends for normal in normals)


def _numbers(values: Iterable[float]) -> str:
    return ",".join(repr(float(value)) for value in values)
