"""Scenes of several transfer functions, arrays or members of an ensemble, joined into one, shown alone or together.

Each member keeps its networks, and its regions become regions of the whole. Together, extinctions add: the samples of
all members along a ray are composited in the order of their distances. Letters: R rays, S samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from svv.core.colour.light import Lamp
from svv.core.geometry.cameras import CameraRig
from svv.core.geometry.cuts import Cut
from svv.errors import BadInput, Progress, silent
from svv.fields.scene.edits import check_has_extinction, with_part, without_undone_splits
from svv.fields.scene.edits import split_at as split_alone
from svv.fields.scene.history import MOST_CUTS, History
from svv.fields.scene.model import Model, S
from svv.fields.scene.region import Region, of_layer
from svv.io.views.view_meta import VolumeGrid
from svv.options.editing import SPLIT_LEVEL

MOST = 8
"""Maximum number of joined scenes."""


def joined(scenes: Sequence[S]) -> S:
    """Return one scene of several of one place, whose regions are those of all, in their order.

    Each keeps its edits, its parts and the painting that it shows; histories are dropped, and all are lit by the light
    of the first whose light can be moved, with the shadows of the first that casts any (:func:`relit`). Raises BadInput
    if there are fewer than two or more than ``MOST`` scenes, one has no palette network or cannot have the shadows, or
    they are of different places or have other time steps.
    """
    scenes = [member for scene in scenes for member in members(without_undone_splits(scene))]
    if not 2 <= len(scenes) <= MOST:
        raise BadInput(f"Give 2 to {MOST} scenes to join, not {len(scenes)}.")
    first = scenes[0]
    times = {scene.steps.times for scene in scenes if scene.steps is not None and len(scene.steps) > 1}
    if len(times) > 1:
        raise BadInput("The scenes have time steps at different times: follow all of them to the same times.")
    own = {scene.steps.own for scene in scenes if scene.steps is not None}
    if times and len(own) > 1:
        raise BadInput(
            f"The scenes were trained on different time steps, {' and '.join(map(str, sorted(own)))}: train all of "
            "them on the same one, so that they show one time together."
        )
    if times and any(scene.steps is None or len(scene.steps) < 2 for scene in scenes):
        raise BadInput("Only some of the scenes have time steps: follow all of them to the same times, or none.")
    regions: list[Region] = []
    for number, scene in enumerate(scenes):
        if scene.palette_network is None:
            raise BadInput("A scene without regions cannot be joined: train its palette network first.")
        if not _near(first, scene):
            raise BadInput("The scenes are of different places: join scenes of one volume.")
        count = len(regions)
        for region in scene.regions:
            parent = None if region.part_of is None else count + region.part_of
            regions.append(replace(region, layer=number, part_of=parent))
    plain = [replace(scene, history=History(), others=(), cuts=(), casters=()) for scene in scenes]
    lamp = _lamp_of(scenes)
    for scene in scenes if lamp.shadow > 0.0 else ():
        check_has_extinction(scene, "shadow")
    first = replace(plain[0], camera_rig=_rig_around(scenes), lamp=lamp, cuts=_cuts_together(scenes))
    return replace(first, regions=tuple(regions), layers=tuple(replace(s, regions=()) for s in plain[1:]))


def relit(scenes: Sequence[Model]) -> list[int]:
    """Return the numbers of the scenes whose light, or shadows, :func:`joined` replaces by those of another."""
    lamp = _lamp_of(scenes)
    return [
        number
        for number, scene in enumerate(scenes)
        if (_has_lamp(scene) and scene.lamp != lamp) or (scene.lamp.shadow > 0.0 and scene.lamp.casts != lamp.casts)
    ]


def _lamp_of(scenes: Sequence[Model]) -> Lamp:
    """Return the first light that can be moved, with the shadows of the first scene that casts any."""
    lamp = next(scene.lamp for scene in (*filter(_has_lamp, scenes), scenes[0]))
    if lamp.shadow > 0.0:
        return lamp
    return next((replace(lamp, **s.lamp.casts) for s in scenes if s.lamp.shadow > 0.0), lamp)


def _has_lamp(scene: Model) -> bool:
    return any(layer.settings.lighting == "phong" for layer in scene.every_layer)


def named(scene: S, name: str) -> S:
    """Return a scene whose regions have the name of its layer, with numbers if there are several; names stay.

    Layers named ``cloud``, with one region, and ``rain``, with two, have the regions ``cloud``, ``rain 1``, ``rain 2``.
    """
    count = len(scene.regions)
    names = [name if count < 2 else f"{name} {number + 1}" for number in range(count)]
    return replace(scene, regions=tuple(replace(r, name=r.name or n) for r, n in zip(scene.regions, names)))


def _near(first: Model, other: Model) -> bool:
    """Return whether the boxes of two scenes overlap, or the volumes that they were drawn from."""
    boxes = first.occupancy.box.bounds, other.occupancy.box.bounds
    volumes = _volume_of(first), _volume_of(other)
    return _overlap(*boxes) or (volumes[0] is not None and volumes[1] is not None and _overlap(volumes[0], volumes[1]))


def _volume_of(scene: Model) -> NDArray[np.float64] | None:
    """Return the corners of the volume from which a scene's views were drawn (2, 3); None if they do not tell."""
    grid = scene.made.get("source", {}).get("grid")
    return None if grid is None else VolumeGrid.from_json(grid).corners


def _overlap(one: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    return bool((np.minimum(one[1], other[1]) > np.maximum(one[0], other[0])).all())


def _rig_around(scenes: Sequence[Model]) -> CameraRig | None:
    """Return the first scene's rig, moved so that it sees whatever one of the rigs sees; None if it has none."""
    first = scenes[0].camera_rig
    if first is None:
        return None
    centre, whole = np.array(first.centre), first.view_width  # of a sphere that encloses those of the rigs
    for rig in (scene.camera_rig for scene in scenes[1:]):
        if rig is None or not rig.view_width:
            continue
        away = np.subtract(rig.centre, centre)
        far, own = float(np.linalg.norm(away)), rig.view_width
        if 2.0 * far + own <= whole * (1.0 + 1e-6):
            continue
        wide = max(0.5 * (2.0 * far + whole + own), own)
        centre = centre + away * ((wide - whole) / (2.0 * far) if wide > own else 1.0)
        whole = wide
    if whole == first.view_width:
        return first
    times, (x, y, z) = whole / first.view_width, centre.tolist()
    span = None if first.span_x is None else whole
    return replace(first, centre=(x, y, z), radius=first.radius * times, span_x=span)


def members(scene: S) -> tuple[S, ...]:
    """Return the scenes that a scene was joined from, each with its own regions; the scene alone if it was not."""
    if not scene.layers:
        return (scene,)
    found = []
    for number, member in enumerate(scene.every_layer):
        every, count = of_layer(scene.every_region, number), sum(r.layer == number for r in scene.regions)
        cuts = _cuts_of(scene, number)
        own = replace(member, lamp=scene.lamp, cuts=cuts, history=History())
        found.append(replace(own, regions=every[:count], unsplit=every[count:]))
    if scene.lamp.shadow > 0.0:
        found = [replace(own, casters=tuple(found)) for own in found]
    return tuple(found)


def _cuts_of(scene: Model, number: int) -> tuple[Cut, ...]:
    """Return the cuts of a member, with its own numbers of regions."""
    own = [k for k, region in enumerate(scene.regions) if region.layer == number]
    found = []
    for cut in scene.cuts:
        among = tuple(place for place, k in enumerate(own) if k in cut.regions)
        if among or not cut.regions:
            found.append(replace(cut, regions=() if len(among) == len(own) else among))
    return tuple(found)


def _cuts_together(scenes: Sequence[Model]) -> tuple[Cut, ...]:
    """Return the cuts of scenes that are joined, each with the numbers of its scene's regions."""
    found, first = list[Cut](), 0
    for scene in scenes:
        count = len(scene.regions)
        found += [replace(c, regions=tuple(first + k for k in c.regions or range(count))) for c in scene.cuts]
        first += count
    if len(found) > MOST_CUTS:
        raise BadInput(f"The scenes have {len(found)} cuts together, and a scene has at most {MOST_CUTS}.")
    return tuple(found)


def with_members(scene: S, changed: Sequence[S]) -> S:
    """Return a joined scene with its members changed, which keep their regions; its light and its history stay."""
    own = [iter(member.every_region) for member in changed]
    every = tuple(replace(next(own[r.layer]), layer=r.layer, part_of=r.part_of) for r in scene.every_region)
    count, history = len(scene.regions), scene.history.rebased(scene.every_region, every)
    shared = changed[0].steps
    layers = tuple(
        replace(s, regions=(), unsplit=(), cuts=(), casters=(), steps=None if s.steps is shared else s.steps, others=())
        for s in changed[1:]
    )
    return replace(
        changed[0],
        regions=every[:count], unsplit=every[count:], lamp=scene.lamp, cuts=scene.cuts, history=history, others=(),
        layers=layers, casters=(),
    )  # fmt: skip


def split_at(scene: S, point: Sequence[float], level: float = SPLIT_LEVEL, progress: Progress = silent) -> S:
    """Return the scene with the connected part of a region at a point as a region of its own, the last one.

    It looks the same until one of the two is edited (:mod:`svv.fields.scene.splitting`). In a scene of several transfer
    functions, the one that is the most opaque at the point is split.

    Args:
        scene: The scene.
        point: World coordinates of a point in the part; :meth:`svv.fields.scene.scene.Scene.point_at` finds one.
        level: Fraction of the region's mean opacity from which its cells connect, in (0, 1].
        progress: Called several times a second.

    Raises:
        BadInput: Nothing is at the point, the region is in one piece, or the level is out of range.
    """
    if not scene.layers:
        return split_alone(scene, point, level, progress)
    every = members(scene)
    opaque = [_extinction_seen_at(member, point) for member in every]
    number = max(range(len(every)), key=opaque.__getitem__)
    split = split_alone(every[number], point, level, progress)
    numbers = [k for k, region in enumerate(scene.regions) if region.layer == number]
    part, whole = split.regions[-1], every[number].regions
    assert part.part_of is not None
    after = with_part(scene, numbers[part.part_of], part.share / max(whole[part.part_of].share, 1e-12))
    # The new step forgets undone splits, also those of the other functions.
    first, *others = (
        split.parts if k == number else member.parts and member.parts.without_undone() for k, member in enumerate(every)
    )
    layers = tuple(replace(layer, parts=parts) for layer, parts in zip(after.layers, others, strict=True))
    return replace(after, parts=first, layers=layers)


@torch.no_grad()
def _extinction_seen_at(member: Model, point: Sequence[float]) -> float:
    """Return the edited extinction at a point in the world, in 1 / world unit; -1 outside the occupied cells."""
    occupancy = member.occupancy
    place = torch.as_tensor(occupancy.box.to_box(torch.tensor(point, dtype=torch.float64).numpy()))
    cell = (place * occupancy.cells).floor().long()
    inside = bool((cell >= 0).all()) and bool((cell < torch.tensor(occupancy.occupied.shape)).all())
    if not inside or not occupancy.occupied[tuple(cell.tolist())]:
        return -1.0
    at = place[None].float().to(member.device)
    assert member.palette_network is not None
    region = int(member.region_of(at, member.palette_network.material(at)[1]))
    return float(member.base.extinction_at(at)) * member.regions[region].seen_opacity / occupancy.box.size
