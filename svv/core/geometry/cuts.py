"""Shapes that cut a scene open: what is inside one of them, or outside of it, is not shown.

A shape is convex, an intersection of half-spaces with, perhaps, a ball or an endless cylinder, so that a ray has at
most one piece of it. Letters: R rays, M pieces that are cut out of a ray, S points.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from svv.core.geometry.box import Box
from svv.errors import BadInput

if TYPE_CHECKING:
    from torch import Tensor

HOW = (
    "give sides of planes such as x>50% or x>50%&y<12.5, plane:X,Y,Z:NX,NY,NZ, box:X,Y,Z:X,Y,Z, sphere:X,Y,Z:R or "
    "cylinder:X,Y,Z:DX,DY,DZ:R, for some regions only as 0,2=x>50%, and outside before a shape to cut off the rest"
)
"""What the text of a cut may be."""

OUTSIDE = "outside"
"""Word in front of a shape outside of which everything is cut off."""

_SIDE = re.compile(r"([xyz])([<>])([-+.\deE]+)(%?)")


@dataclass(frozen=True)
class Cut:
    """A shape whose inside is cut off.

    Raises BadInput if there is no shape, a number is not finite, a direction is zero, or a radius is not positive.

    >>> svv.Cut(planes=((1.0, 0.0, 0.0, 5.0),)).describe()  # x > 5
    'cut x > 5'
    """

    planes: tuple[tuple[float, float, float, float], ...] = ()
    """Half-spaces n . x > d in which the shape lies, as (nx, ny, nz, d) in world units; n has length 1."""
    centre: tuple[float, float, float] | None = None
    """Centre of a ball, or a point on the axis of a cylinder, in world units."""
    axis: tuple[float, float, float] | None = None
    """Direction of the cylinder's axis, of length 1; None for a ball."""
    radius: float | None = None
    """Radius of the ball or cylinder in world units, > 0."""
    outside: bool = False
    """Whether what is outside of the shape is cut off instead."""
    regions: tuple[int, ...] = ()
    """Regions that are cut; all if empty."""

    def __post_init__(self) -> None:
        numbers = [*np.ravel(self.planes), *(self.centre or ()), *(self.axis or ()), self.radius or 0.0]
        if not np.isfinite(np.asarray(numbers, np.float64)).all():
            raise BadInput("A cut's numbers must be finite.")
        if (self.centre is None) != (self.radius is None) or (self.axis is not None and self.centre is None):
            raise BadInput("A ball or a cylinder that cuts needs a centre and a radius.")
        if not self.planes and self.centre is None:
            raise BadInput("A cut needs a shape: " + HOW + ".")
        if self.radius is not None and not self.radius > 0.0:
            raise BadInput(f"The radius of a cut must be above 0, not {self.radius:g}.")
        planes = []
        for *normal, distance in self.planes:
            length = float(np.linalg.norm(normal))
            if not length > 0.0:
                raise BadInput("A plane that cuts needs a direction that is not 0.")
            planes.append(tuple(float(v) / length for v in (*normal, distance)))
        object.__setattr__(self, "planes", tuple(planes))
        if self.centre is not None:
            object.__setattr__(self, "centre", tuple(float(v) for v in self.centre))
            object.__setattr__(self, "radius", float(self.radius or 0.0))
        if self.axis is not None:
            if not (length := float(np.linalg.norm(self.axis))) > 0.0:
                raise BadInput("A cylinder that cuts needs an axis that is not 0.")
            object.__setattr__(self, "axis", tuple(float(v) / length for v in self.axis))
        object.__setattr__(self, "regions", tuple(sorted({int(k) for k in self.regions})))

    @classmethod
    def parse(cls, text: str, bounds: ArrayLike) -> Cut:
        """Return the cut that a text describes; raises BadInput if it describes none.

        The text has sides of planes along the axes, such as ``x>50%`` or ``x>50%&y<12.5``, which are cut off where all
        of them hold (percent: from the lower to the upper end of the bounds); ``plane:X,Y,Z:NX,NY,NZ``, a point and the
        direction of the side that is cut off; ``box:X,Y,Z:X,Y,Z``, two corners; ``sphere:X,Y,Z:R``;
        ``cylinder:X,Y,Z:DX,DY,DZ:R``. With the word ``outside`` before it, what is outside of the shape is cut off.
        Regions and a ``=`` may stand in front of all: ``0,2=outside sphere:0,0,0:5``. ``bounds``: lowest and highest
        corner of what is cut, in world units. (2, 3)

        >>> Cut.parse("x>50%&y<1", [[0, 0, 0], [4, 4, 4]]).planes
        ((1.0, 0.0, 0.0, 2.0), (0.0, -1.0, 0.0, -1.0))
        """
        of, _, shape = text.replace(" ", "").lower().rpartition("=")
        outside, shape = shape.startswith(OUTSIDE), shape.removeprefix(OUTSIDE)
        try:
            regions = tuple(int(k) for k in of.split(",")) if of else ()
            if min(regions, default=0) < 0:
                raise ValueError
            shapes = [_shape(one, np.asarray(bounds, np.float64)) for one in shape.split("&")]
            round_ones = [one for one in shapes if one.centre is not None]
            if len(round_ones) > 1:
                raise BadInput(f"A cut may have one ball or cylinder, but '{text}' has {len(round_ones)}.")
            found, planes = [*round_ones, *shapes][0], tuple(plane for one in shapes for plane in one.planes)
        except BadInput:
            raise
        except (ValueError, IndexError):
            raise BadInput(f"'{text}' is no cut: {HOW}.") from None
        return replace(found, planes=planes, outside=outside, regions=regions)

    def in_box(self, box: Box) -> Cut:
        """Return the cut in box coordinates."""
        low = np.asarray(box.low)
        planes = tuple((x, y, z, (d - float(np.dot((x, y, z), low))) / box.size) for x, y, z, d in self.planes)
        if self.centre is None or self.radius is None:
            return replace(self, planes=planes)
        u, v, w = box.to_box(self.centre).tolist()
        return replace(self, planes=planes, centre=(u, v, w), radius=self.radius / box.size)

    def span(self, origins: Tensor, directions: Tensor) -> tuple[Tensor, Tensor]:
        """Return where rays (R, 3), with unit directions, enter and leave the shape; enter > leave for a miss. (R,)"""
        import torch

        near = torch.full_like(origins[:, 0], -torch.inf)
        far = torch.full_like(near, torch.inf)
        for *n, d in self.planes:
            normal = origins.new_tensor(n)
            slope, rest = directions @ normal, d - origins @ normal
            at = rest / torch.where(slope == 0.0, 1.0, slope)
            near = torch.maximum(near, torch.where(slope > 0.0, at, -torch.inf))
            far = torch.minimum(far, torch.where(slope < 0.0, at, torch.inf))
            far = torch.where((slope == 0.0) & (rest >= 0.0), -torch.inf, far)
        if self.centre is not None:
            away, along = origins - origins.new_tensor(self.centre), directions
            if self.axis is not None:
                axis = origins.new_tensor(self.axis)
                away, along = (v - (v @ axis)[:, None] * axis for v in (away, along))
            a, b = (along * along).sum(1), (away * along).sum(1)
            c = (away * away).sum(1) - (self.radius or 0.0) ** 2
            inside = b * b - a * c
            root = inside.clamp(min=0.0).sqrt() / torch.where(a > 1e-12, a, 1.0)
            middle = -b / torch.where(a > 1e-12, a, 1.0)
            hit = torch.where(a > 1e-12, inside > 0.0, c < 0.0)
            near = torch.where(hit & (a > 1e-12), torch.maximum(near, middle - root), near)
            far = torch.where(hit & (a > 1e-12), torch.minimum(far, middle + root), far)
            far = torch.where(hit, far, -torch.inf)
        return near, far

    def depth(self, points: Tensor) -> Tensor:
        """Return how deep points (S, 3) lie in what is cut off, whatever their region; negative outside. (S,)

        Near a face, it is the distance from it; near an edge, the distance from the nearer of its faces.
        """
        import torch

        depth = torch.full_like(points[:, 0], torch.inf)
        for *n, d in self.planes:
            depth = torch.minimum(depth, points @ points.new_tensor(n) - d)
        if self.centre is not None:
            away = points - points.new_tensor(self.centre)
            if self.axis is not None:
                axis = points.new_tensor(self.axis)
                away = away - (away @ axis)[:, None] * axis
            depth = torch.minimum(depth, (self.radius or 0.0) - away.norm(dim=1))
        return -depth if self.outside else depth

    def to_text(self) -> str:
        """Return the text from which :meth:`parse` makes the cut, in world units.

        >>> Cut(planes=((1.0, 0.0, 0.0, 5.0),)).to_text()
        'x>5.0'
        """

        def listed(*numbers: float) -> str:
            return ",".join(map(repr, numbers))

        shapes = []
        for *normal, distance in self.planes:
            if 1.0 in map(abs, normal):
                axis = int(np.argmax(np.abs(normal)))
                shapes.append(f"{'xyz'[axis]}{'>' if normal[axis] > 0 else '<'}{normal[axis] * distance!r}")
            else:
                shapes.append(f"plane:{listed(*(v * distance for v in normal))}:{listed(*normal)}")
        if self.centre is not None and self.radius is not None:
            kind = "sphere" if self.axis is None else "cylinder"
            axes = "" if self.axis is None else f"{listed(*self.axis)}:"
            shapes.append(f"{kind}:{listed(*self.centre)}:{axes}{self.radius!r}")
        of = ",".join(map(str, self.regions)) + "=" * bool(self.regions)
        return f"{of}{OUTSIDE + ' ' if self.outside else ''}{'&'.join(shapes)}"

    def describe(self) -> str:
        """Return a short description."""
        parts = [_describe_plane(*plane) for plane in self.planes]
        if self.centre is not None:
            place = ", ".join(f"{v:.4g}" for v in self.centre)
            kind = "ball" if self.axis is None else "cylinder"
            parts.append(f"{kind} of radius {self.radius:.4g} at {place}")
        of = f" of region{'s' * (len(self.regions) > 1)} {', '.join(map(str, self.regions))}" if self.regions else ""
        return f"cut {'all but ' if self.outside else ''}{' and '.join(parts)}{of}"


def _describe_plane(x: float, y: float, z: float, d: float) -> str:
    for name, value in zip("xyz", (x, y, z), strict=True):
        if abs(value) == 1.0:
            return f"{name} {'>' if value > 0 else '<'} {value * d:.4g}"
    return f"{x:.3g} x + {y:.3g} y + {z:.3g} z > {d:.4g}"


def _side(text: str, bounds: NDArray[np.float64]) -> Cut:
    """Return the shape in which a comparison holds; raises ValueError if it is not one."""
    found = _SIDE.fullmatch(text)
    if found is None:
        raise ValueError
    axis, sign, number, percent = found.groups()
    k, side = "xyz".index(axis), 1.0 if sign == ">" else -1.0
    value = float(number)
    if percent:
        value = float(bounds[0, k] + 0.01 * value * (bounds[1, k] - bounds[0, k]))
    normal = [0.0, 0.0, 0.0]
    normal[k] = side
    return Cut(((normal[0], normal[1], normal[2], side * value),))


def _shape(text: str, bounds: NDArray[np.float64]) -> Cut:
    """Return a shape from a comparison, or from its name and numbers; raises ValueError if they do not fit."""
    kind, *rest = text.split(":")
    if not rest:
        return _side(kind, bounds)
    parts = [tuple(float(v) for v in part.split(",")) for part in rest]
    lengths = tuple(len(part) for part in parts)
    if kind == "plane" and lengths == (3, 3):
        at, normal = parts
        x, y, z = normal
        return Cut(((x, y, z, float(np.dot(at, normal))),))
    if kind == "box" and lengths == (3, 3):
        low, high = np.min(parts, axis=0), np.max(parts, axis=0)
        eye = np.eye(3)
        planes = [(*sign * eye[k], sign * end[k]) for sign, end in ((1.0, low), (-1.0, high)) for k in range(3)]
        return Cut(tuple((float(a), float(b), float(c), float(d)) for a, b, c, d in planes))
    if kind == "sphere" and lengths == (3, 1):
        (x, y, z), (radius,) = parts
        return Cut(centre=(x, y, z), radius=radius)
    if kind == "cylinder" and lengths == (3, 3, 1):
        (x, y, z), (dx, dy, dz), (radius,) = parts
        return Cut(centre=(x, y, z), axis=(dx, dy, dz), radius=radius)
    raise ValueError


def clip_rays(cuts: Sequence[Cut], origins: Tensor, directions: Tensor) -> tuple[Tensor, Tensor]:
    """Return where the pieces of rays begin and end that no cut takes away, whatever the regions. (R, M + 1) each

    They are in ascending order, from 0 on; those with end <= begin are none. Rays, with unit ``directions`` (R, 3), are
    in the coordinates of the cuts.
    """
    import torch

    begins, ends = [], []
    for cut in cuts:
        near, far = cut.span(origins, directions)
        hit = near < far
        if cut.outside:
            begins += [torch.full_like(near, -torch.inf), torch.where(hit, far, torch.inf)]
            ends += [torch.where(hit, near, torch.inf), torch.full_like(near, torch.inf)]
        else:
            begins.append(torch.where(hit, near, torch.inf))
            ends.append(torch.where(hit, far, torch.inf))
    begin, end = torch.stack(begins, 1), torch.stack(ends, 1)
    begin, order = begin.sort(dim=1)
    end = end.gather(1, order).cummax(dim=1).values
    first = torch.zeros_like(begin[:, :1])
    return torch.cat([first, end.clamp(min=0.0)], 1), torch.cat([begin, torch.full_like(first, torch.inf)], 1)


def divide_rays(cuts: Sequence[Cut], origins: Tensor, directions: Tensor) -> tuple[Tensor, Tensor]:
    """Return the pieces of rays that :func:`clip_rays` leaves, divided where a cut of some regions begins or ends.

    Each piece thus lies inside or outside of every cut. (R, M) each, as those of :func:`clip_rays`
    """
    import torch

    whole, some = ([cut for cut in cuts if bool(cut.regions) == of_some] for of_some in (False, True))
    begin = torch.zeros_like(origins[:, :1])
    end = torch.full_like(begin, torch.inf)
    if whole:
        begin, end = clip_rays(whole, origins, directions)
    if not some:
        return begin, end
    spans = [cut.span(origins, directions) for cut in some]
    faces = [torch.where(near < far, at, torch.inf).clamp(min=0.0) for near, far in spans for at in (near, far)]
    at = torch.stack(faces, 1)
    if not whole:
        at = at.sort(dim=1).values
        return torch.cat([begin, at], 1), torch.cat([at, end], 1)
    edges = torch.cat([begin, end, at], 1).sort(dim=1).values
    low, high = edges[:, :-1], edges[:, 1:]
    middle = torch.where(high.isinf(), low + 1.0, 0.5 * (low + high))[:, :, None]
    left = ((middle >= begin[:, None]) & (middle < end[:, None])).any(2)
    return low, torch.where(left, high, low)
