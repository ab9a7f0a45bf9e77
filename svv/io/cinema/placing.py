"""Cameras of a database's rows: what is known about them, what the images add, and whether the two agree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from svv.core.geometry.cameras import Camera
from svv.core.geometry.directions import geodesic_directions
from svv.core.geometry.phi_theta import ascent_rotations, paraview_rotations
from svv.core.json_values import parsed
from svv.core.view_checks.camera_mistakes import Mistake
from svv.core.view_checks.silhouettes import Silhouettes, best_fov, disagreement_of
from svv.errors import BadInput
from svv.io.cinema.shot import Shot, camera_of, fov_x, view_angle
from svv.io.cinema.table import Table
from svv.io.views.agreement import Agreement, check_agreement
from svv.io.views.on_screen import fixed_in, without

Array = NDArray[np.float64]

SAME = 5e-4
"""Radians within which two views have one direction; ParaView writes angles with two digits."""

VISIBLE = 2
"""Level of alpha above which a pixel belongs to the silhouette."""

USUAL_ANGLE = {False: 30.0, True: 60.0}
"""View angles of ParaView and of Ascent, in degrees, if the images do not tell."""

UNSURE = 1.0
"""Uncertainty of an estimate in degrees from which on the usual angle is taken instead."""

CONTRADICTION = 1.0
"""Degrees by which a view angle may differ from what the silhouettes say."""

MUCH_WORSE, FINEST = 2.0, 0.2
"""Factor by which silhouettes differ more with an angle that they contradict, and the least pixels that it multiplies:
true angles differ from the best by up to a fifth of this."""

SURE = 3.0
"""Standard deviations that make a difference certain."""

WIDE_GAP = 60.0
"""Degrees between a direction and the nearest view from which on the gap is mentioned."""

PARALLEL = np.radians(1.5)
"""Angle of view in radians below which cameras count as orthographic."""


def rotations_of(table: Table) -> Array | None:
    """Return the rotations that phi and theta name, (n, 3, 3); None without these. BadInput: one is no number."""
    phi, theta = table.column("phi"), table.column("theta")
    if phi is None or theta is None:
        return None
    try:
        angles = np.array([phi, theta], np.float64)
    except ValueError as error:
        raise BadInput(f"{table.folder} has an angle that is not a number ({error}).") from error
    if not np.isfinite(angles).all():
        raise BadInput(f"{table.folder} has an angle that is not finite.")
    return ascent_rotations(*angles) if table.ascent else paraview_rotations(*angles)


def cameras_by_rows(table: Table, metas: Sequence[dict[str, object]], size: tuple[int, int]) -> list[Camera] | None:
    """Return the cameras that images or rows describe, if any.

    Raises BadInput if only some do, or a camera is invalid.
    """
    named = {name: values for name, values in table.columns.items() if name.lower().startswith("cam")}
    found: list[Camera | None] = []
    for k, (file, meta) in enumerate(zip(table.files, metas, strict=True)):
        row: dict[str, object] = {name: _parsed(values[k]) for name, values in named.items()}
        whole = row.pop(next((n for n in row if n.lower() == "camera"), ""), None)
        values = {**(whole if isinstance(whole, dict) else {}), **row, **meta}
        found.append(camera_of(values, *size, f"{table.folder / file}"))
    cameras = [camera for camera in found if camera is not None]
    if not cameras:
        return None
    if len(cameras) < len(found):
        missing = table.files[found.index(None)]
        raise BadInput(f"{table.folder} gives cameras for some images, but not for {missing}.")
    return cameras


def placed_about(
    table: Table, rotations: Array, shot: Shot, images: NDArray[np.uint8]
) -> tuple[list[Camera], list[str], Agreement]:
    """Return cameras that look at one point, what was estimated, and what :func:`check_agreement` says of them.

    Up to ParaView 5.8, phi ran the other way. It does here, too, if the images contradict the usual way and agree with
    the other one. Raises BadInput if they contradict both.
    """
    names, first = [str(name) for name in table.files], None
    for backwards in (False, True) if not table.ascent else (False,):
        try:
            turned = _reinterpret_angles(table, -1.0, 1.0, 0.0) if backwards else rotations
            cameras, notes = cameras_about(turned, shot, images, table.ascent)
            also = [] if backwards else _other_meanings(table, cameras, shot)
            agreement = check_agreement(cameras, images, names, table.folder, also)
        except BadInput as error:
            first = first or error
            continue
        if backwards:
            notes.append("The images agree with their cameras if phi runs the other way, as up to ParaView 5.8.")
        return cameras, notes, agreement
    assert first is not None
    raise first


def _other_meanings(table: Table, cameras: Sequence[Camera], shot: Shot) -> list[Mistake]:
    """Return the cameras that phi and theta would name in other programs."""
    point, distance = np.array(shot.focal_point or (0.0, 0.0, 0.0)), shot.distance or 1.0
    found = []
    for said, signs in () if table.ascent else (
        ("theta runs the other way", (1.0, -1.0, 0.0)),
        ("theta counts from the pole", (1.0, -1.0, 90.0)),
        ("theta counts from the other pole", (1.0, 1.0, -90.0)),
        ("phi runs the other way and theta counts from the pole", (-1.0, -1.0, 90.0)),
        ("phi runs the other way and theta counts from the other pole", (-1.0, 1.0, -90.0)),
    ):  # fmt: skip
        matrices = np.stack([camera.camera_to_world for camera in cameras])
        matrices[:, :3, :3] = _reinterpret_angles(table, *signs)
        matrices[:, :3, 3] = point + distance * matrices[:, :3, 2]
        found.append(Mistake(said, "write the angles as ParaView counts them", matrices))
    return found


def _reinterpret_angles(table: Table, phi: float, theta: float, offset: float) -> Array:
    """Return rotations of other angles: phi and theta times signs, theta with an offset in degrees. (n, 3, 3)"""
    own = np.array([table.column("phi"), table.column("theta")], np.float64)
    return paraview_rotations(phi * own[0], theta * own[1] + offset)


def cameras_about(
    rotations: Array, shot: Shot, images: NDArray[np.uint8], ascent: bool
) -> tuple[list[Camera], list[str]]:
    """Return cameras that look at one point, and sentences on what was estimated.

    Known are their rotations (n, 3, 3), the RGBA images (n, height, width, 4), what else the shot says, and whether
    Ascent wrote them, whose view angle is usually another. Raises BadInput if the images contradict the view angle.
    """
    notes: list[str] = []
    height, width = images.shape[1:3]
    if shot.distance is None or shot.focal_point is None:
        at = "the origin" if shot.focal_point is None else f"({', '.join(f'{v:g}' for v in shot.focal_point)})"
        notes.append(
            f"Nothing says where the cameras stand in the world: the scene is centred on {at}, at a distance of "
            f"{shot.distance or 1.0:g}."
        )
    point, distance = np.array(shot.focal_point or (0.0, 0.0, 0.0)), shot.distance or 1.0
    cameras = []
    for rotation in rotations:
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = rotation, point + distance * rotation[:, 2]
        if shot.parallel_scale is not None:
            span = 2.0 * shot.parallel_scale * width / height
            cameras.append(Camera.orthographic(matrix, span, width, height))
        else:
            fov = fov_x(shot.view_angle or USUAL_ANGLE[ascent], width, height)
            cameras.append(Camera(matrix, fov, width, height))
    if shot.parallel_scale is not None:
        return cameras, notes
    fixed = fixed_in(cameras, images)
    shown = images if fixed is None else without(images, fixed)
    silhouettes = Silhouettes.of([image[..., 3] > VISIBLE for image in shown])
    usual, fit = cameras[0].fov_x, best_fov(cameras, silhouettes)
    if fit is None:
        return cameras, [*notes, *([_assumed(ascent)] if shot.view_angle is None else [])]
    angle, spread = view_angle(fit.fov_x, width, height), np.degrees(fit.uncertainty)
    differ, least = disagreement_of(cameras, silhouettes, (usual, fit.fov_x))
    # Angles alone would not do: how certain an estimate is depends on the object.
    contradicted = differ > MUCH_WORSE * max(least, FINEST)
    if shot.view_angle is not None:
        if contradicted and abs(np.degrees(fit.fov_x - usual)) > max(CONTRADICTION, SURE * spread):
            raise BadInput(
                f"The images contradict a view angle of {shot.view_angle:.4g} degrees, with which their silhouettes "
                f"differ by {differ:.1f} pixels: they say {angle:.4g}; correct the cameras, or leave the angle out."
            )
        return cameras, notes
    if spread > UNSURE and not contradicted:
        return cameras, [*notes, _assumed(ascent)]
    if fit.fov_x < PARALLEL:
        notes.append("The silhouettes show no perspective: the cameras count as orthographic.")
        span = 2.0 * distance * np.tan(0.5 * fit.fov_x)
        return [Camera.orthographic(c.camera_to_world, span, width, height) for c in cameras], notes
    notes.append(
        f"View angle estimated from the silhouettes: {angle:.2f} degrees (standard deviation {spread:.2f}), with "
        f"which they differ by {fit.residual:.2f} pixels."
    )
    return [replace(camera, fov_x=fit.fov_x) for camera in cameras], notes


def _assumed(ascent: bool) -> str:
    return (
        f"The silhouettes hardly depend on the view angle, so {USUAL_ANGLE[ascent]:g} degrees are assumed, the usual "
        f"angle of {'Ascent' if ascent else 'ParaView'}; if you know it, give --view-angle."
    )


def first_of_each(places: Array) -> list[int]:
    """Return the first of the rows that are equal within :data:`SAME`, in order. (n, k)"""
    # A sweep over time has each direction thousands of times: their pairs would not fit into memory.
    different = np.sort(np.unique(places, axis=0, return_index=True)[1])
    first = np.ones(len(different), bool)
    for one, other in sorted(cKDTree(places[different]).query_pairs(SAME)):
        if first[one]:
            first[other] = False
    return different[first].tolist()


def spread_out(directions: Array, count: int) -> list[int]:
    """Choose directions that are spread evenly: each is the farthest from those before. (n, 3)"""
    chosen, nearest = [0], np.linalg.norm(directions - directions[0], axis=1)
    while len(chosen) < min(count, len(directions)):
        farthest = int(nearest.argmax())
        chosen.append(farthest)
        nearest = np.minimum(nearest, np.linalg.norm(directions - directions[farthest], axis=1))
    return sorted(chosen)


def gap_in(directions: Array) -> str | None:
    """Return a sentence about the widest gap between views, and what it means, if it is wide. (n, 3)"""
    everywhere = geodesic_directions(642)
    angle = np.degrees(2.0 * np.arcsin(np.clip(0.5 * cKDTree(directions).query(everywhere)[0], 0.0, 1.0)))
    widest = float(angle.max())
    if widest < WIDE_GAP:
        return None
    towards = ", ".join(f"{v:.1f}" for v in everywhere[int(angle.argmax())])
    empty = float((angle > 0.5 * WIDE_GAP).mean())
    part = "Half of the sphere or more has no view" if widest > 85.0 else "A part of the sphere has no view"
    return (
        f"{part}: the nearest to the direction ({towards}) is {widest:.0f} degrees away, and {100 * empty:.0f} % of "
        f"all directions have none within {0.5 * WIDE_GAP:.0f}; seen from there, the scene will be blurred or wrong."
    )


def _parsed(text: str) -> Any:
    """Return JSON as its value, and vectors as NumPy prints them as lists of numbers; other text as it is."""
    try:
        return parsed(text)
    except ValueError:
        pass
    words = text.strip("[]() ").replace(",", " ").split()
    try:
        return [float(word) for word in words] if len(words) > 1 else text
    except ValueError:
        return text
