"""Cameras of Cinema databases: from options, ParaView's files, a JSON file, or metadata of single images."""

from __future__ import annotations

import ast
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from svv.core.geometry.cameras import Camera, look_at
from svv.core.json_values import number_in, parsed, switch_in, vector_in
from svv.core.xml_values import parsed_xml
from svv.errors import BadInput

BESIDE = "camera.json"
"""File in a database with the camera that ParaView turned about its focal point."""

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Shot:
    """What phi and theta do not say: where the cameras look, from how far, and how wide. None where it is unknown."""

    focal_point: Vector | None = None
    """The point that the cameras look at, in world units."""
    distance: float | None = None
    """Distance of the cameras from it, in world units."""
    view_angle: float | None = None
    """Full vertical angle of view in degrees, as ``vtkCamera`` has it."""
    parallel_scale: float | None = None
    """Half the height of the image in world units, if the cameras are orthographic."""

    def or_else(self, other: Shot) -> Shot:
        """Return what is known here, with the rest from another."""
        known = {name: value for name, value in vars(self).items() if value is not None}
        if self.view_angle is not None:
            known["parallel_scale"] = None
        return Shot(**{**vars(other), **known})

    def validate(self, where: str) -> Shot:
        """Return itself; raise BadInput, which begins with ``where``, if a value is out of range."""
        for name, most in (("distance", np.inf), ("view_angle", 180.0), ("parallel_scale", np.inf)):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < most:
                below = f" and below {most:g}" if np.isfinite(most) else ""
                raise BadInput(f"{where}: the {name.replace('_', ' ')} must be above 0{below}, not {value}.")
        return self


def read_shot(path: Path) -> Shot:
    """Read a view's camera from a .pvsm, a script, or ``camera.json``; raises BadInput if it has none, or several."""
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise BadInput(f"There is no file {path} with cameras; check the path.") from error
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"Cannot read the cameras in {path} ({error}).") from error
    suffix = path.suffix.lower()
    if suffix == ".json":
        return _of_json(path, text)
    found = _of_state(path, text) if suffix == ".pvsm" else _of_script(path, text)
    shots = list(dict.fromkeys(shot for view in found if (shot := _of_view(view)) != Shot()))
    if not shots:
        raise BadInput(f"{path} contains no view with CameraPosition and CameraFocalPoint.")
    if len(shots) > 1:
        raise BadInput(
            f"{path} contains {len(shots)} views with different cameras; give the right one by --focal-point, "
            "--distance and --view-angle."
        )
    return shots[0].validate(str(path))


View = dict[str, list[float]]
"""Properties of a view by name."""


def camera_of(values: Mapping[str, object], width: int, height: int, name: str) -> Camera | None:
    """Return the camera that the metadata of an image describe, numbers and lists by name; None if they describe none.

    Names are compared without case and underscores, so that ``CameraPos``, ``camera_position`` and ``CamPosition`` are
    one. The image, of a size in pixels, is orthographic if there is a height (TTK and pycinema: the full height in
    world units). Raises BadInput if a value is missing or invalid.
    """
    plain = {re.sub(r"^cam(era)?", "", key.lower().replace("_", "")): value for key, value in values.items()}

    def first(*names: str) -> Any:
        return next((plain[n] for n in names if plain.get(n) is not None), None)

    matrix = first("toworld")
    position = first("position", "pos")
    if matrix is None and position is None:
        return None
    if matrix is None:
        eye, up = _vector(position, name), _vector(first("up", "viewup", "updirection"), name, (0.0, 1.0, 0.0))
        towards, point = first("dir", "direction", "viewdirection", "view"), first("focalpoint", "focus", "target")
        if towards is None and point is None:
            raise BadInput(f"{name} has a camera position without a direction or a focal point.")
        target = eye + _vector(towards, name) if point is None else _vector(point, name)
        matrix = look_at(eye, target, up)
    else:
        matrix = np.array(matrix, np.float64).reshape(4, 4) if np.size(matrix) == 16 else np.zeros((1, 1))
    span, angle, fov = first("height"), first("viewangle", "angle", "fovy"), first("fov")
    try:
        if span is not None:
            return Camera.orthographic(matrix, _number(span, name) * width / height, width, height)
        if fov is not None:
            return Camera(matrix, np.radians(_number(fov, name)), width, height)
        if angle is not None:
            return Camera(matrix, fov_x(_number(angle, name), width, height), width, height)
    except BadInput as error:
        raise BadInput(f"{name}: {str(error).removeprefix(name + ': ')}") from None
    raise BadInput(f"{name} has a camera without an angle of view (CameraAngle) or a height (CameraHeight).")


def fov_x(view_angle: float, width: int, height: int) -> float:
    """Return the horizontal angle of view in radians of a vertical one in degrees."""
    return float(2.0 * np.arctan(np.tan(0.5 * np.radians(view_angle)) * width / height))


def view_angle(fov: float, width: int, height: int) -> float:
    """Return the vertical angle of view in degrees of a horizontal one in radians."""
    return float(np.degrees(2.0 * np.arctan(np.tan(0.5 * fov) * height / width)))


def _of_json(path: Path, text: str) -> Shot:
    try:
        content = parsed(text)
    except ValueError as error:
        raise BadInput(f"{path} is not JSON ({error}).") from error
    if not isinstance(content, dict) or not {"focal_point", "distance", "view_angle", "parallel_scale"} & set(content):
        raise BadInput(f"{path} contains no camera: it needs focal_point, distance and view_angle.")

    def number(key: str) -> float | None:
        return number_in(content[key], f"{path}: {key}") if content.get(key) is not None else None

    parallel = switch_in(
        content.get("parallel_projection", "view_angle" not in content), f"{path}: parallel_projection"
    )
    point = content.get("focal_point")
    return Shot(
        None if point is None else vector_in(point, f"{path}: focal_point"),
        number("distance"),
        None if parallel else number("view_angle"),
        number("parallel_scale") if parallel else None,
    ).validate(str(path))


def _of_state(path: Path, text: str) -> list[View]:
    try:
        root = parsed_xml(text)
    except ValueError as error:
        raise BadInput(f"{path} is not a ParaView state: {error}.") from error
    views = []
    for proxy in root.iter("Proxy"):
        if proxy.get("group") != "views":
            continue
        view: View = {}
        for member in proxy.iter("Property"):
            try:
                elements = sorted(member.findall("Element"), key=lambda e: int(e.get("index", "0")))
                view[member.get("name", "")] = [float(e.get("value", "")) for e in elements]
            except ValueError:
                continue  # properties of text, or damaged
        views.append(view)
    return views


def _of_script(path: Path, text: str) -> list[View]:
    """Collect ``view.CameraPosition = [...]`` by view; the last assignment counts."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about the script's own style
            tree = ast.parse(text)
    except SyntaxError as error:
        raise BadInput(f"{path} is not a Python script ({error.msg}, line {error.lineno}).") from error
    except (ValueError, RecursionError, MemoryError) as error:
        raise BadInput(f"{path} is not a Python script that can be read ({error}).") from error
    views: dict[str, View] = {}
    for line in ast.walk(tree):
        if not isinstance(line, ast.Assign):
            continue
        for target in line.targets:
            if isinstance(target, ast.Attribute) and target.attr.startswith("Camera"):
                try:
                    value = np.atleast_1d(np.asarray(ast.literal_eval(line.value), np.float64)).tolist()
                    views.setdefault(ast.unparse(target.value), {})[target.attr] = value
                except (ValueError, TypeError, SyntaxError, OverflowError, RecursionError, MemoryError):
                    continue  # computed when the script runs, or nothing that a camera has
    return list(views.values())


def _of_view(view: View) -> Shot:
    position, point = view.get("CameraPosition"), view.get("CameraFocalPoint", [0.0, 0.0, 0.0])
    if position is None or np.shape(position) != (3,) or np.shape(point) != (3,):
        return Shot()
    x, y, z = (float(v) for v in point)
    with np.errstate(all="ignore"):  # what is not finite is rejected by its range
        distance = float(np.linalg.norm(np.subtract(position, point)))
    if any(_first(view, "CameraParallelProjection", 0.0)):
        return Shot((x, y, z), distance, None, *_first(view, "CameraParallelScale", 1.0))
    return Shot((x, y, z), distance, *_first(view, "CameraViewAngle", 30.0))


def _first(view: View, name: str, default: float) -> list[float]:
    """Return the first number of a property, or the default if it has none, as a list of one."""
    numbers = view.get(name, [default])
    return [float(number) for number in numbers[:1] if np.ndim(number) == 0] or [default]


def _vector(value: object, name: str, default: Vector | None = None) -> np.ndarray:
    numbers = default if value is None and default is not None else value
    return _finite(numbers, 3, f"{name} has a camera vector that is not three finite numbers: {numbers}.")


def _number(value: object, name: str) -> float:
    return float(_finite(value, 1, f"{name} has a camera value that is not one finite number: {value}.")[0])


def _finite(value: object, count: int, otherwise: str) -> np.ndarray:
    """Return a number of finite numbers; raises BadInput, which says what is ``otherwise`` wrong. (count,)"""
    try:
        found = np.asarray(value, np.float64).ravel()
    except (TypeError, ValueError):
        raise BadInput(otherwise) from None
    if found.shape != (count,) or not np.isfinite(found).all():
        raise BadInput(otherwise)
    return found
