"""A scene baked into a volume of bytes that VTK's volume mappers draw (:mod:`svv.render.baking.baked_volume`).

What edits do not change (:class:`Matter`) is kept for the next bake. Letters: S points in occupied cells, (Z, Y, X)
points of the grid.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.core.colour import palette_shading
from svv.core.geometry.cameras import Camera, look_at
from svv.core.volumes.opacity_code import CODES, LEAST_LOG_DEPTH, codes_of, most_of
from svv.errors import BadInput, Progress, part, silent
from svv.fields.radiance.networks import PaletteField, encode_directions
from svv.fields.radiance.phong import Beams
from svv.fields.radiance.rendering import Rays
from svv.fields.scene.joined import members
from svv.fields.scene.model import for_colours, of_colour
from svv.fields.scene.occlusion import occlude
from svv.fields.scene.paint_light import lights_of
from svv.fields.scene.scene import Scene
from svv.fields.scene.shadows import cast_shadows, check_shadows_stay, shadows_from
from svv.fields.scene.stroke_opacity import followed
from svv.options.baking import BakeOptions
from svv.options.making import NetworkName
from svv.render.baking.baked_volume import BakedVolume, halved, span_all_bytes, summed
from svv.render.baking.baking_kernels import extend_colours, soften_edges
from svv.render.baking.cut import DROP, REACH
from svv.render.baking.voxels import CHUNK, Grid, Matter, as_samples, grid_around, grid_of, matter_of, paint_at, twice

SIDES = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))
"""Directions towards the viewers over which baked light is the mean."""

EDGE_DROP = 1.6
"""Logarithm by which extinction drops from a visible point to a hidden one: (1 - e^-1.6) / 1.6 is a half."""

LEAST_SEEN = 1e-3
"""Weight of a direction from which a point is hidden; a point hidden from all sides has the plain mean."""


class Baker:
    """Bakes scenes, and keeps what the next bake of the same scene can use again, whatever its edits."""

    def __init__(self) -> None:
        self._matter: tuple[object, Matter] | None = None
        self._paint: tuple[object, Tensor] | None = None
        self._layers: dict[int, tuple[Baker, object, BakedVolume]] = {}
        """Of each function of a joined scene: its baker, what its volume depends on, and its volume."""

    @torch.no_grad()
    def bake(self, scene: Scene, options: BakeOptions, progress: Progress = silent) -> BakedVolume:
        """Bake a scene with its edits; BadInput if it lacks network, palette or regions, or memory does not suffice.

        BadInput as well if its shadows follow the camera.
        """
        network = network_of(scene, options)
        if options.regions is not None:
            scene = scene.isolated(*options.regions)
        for number, region in enumerate(scene.regions):
            if region.matcap is not None and region.seen_opacity > 0.0:
                raise BadInput(
                    f"Region {number} has a MatCap, whose colours follow the viewer, so no volume can hold them: "
                    f"take it off with svv edit --matcap {number}=none, or render pictures."
                )
        check_shadows_stay(scene, "A baked volume")
        if scene.layers:
            return self._together(scene, options, progress)
        grid = grid_of(scene, options, network)
        finer = twice(scene, grid, network)
        if finer is not None:  # points of a coarse grid miss thin surfaces
            return halved(self._baked(scene, finer, network, options, progress), grid)
        return self._baked(scene, grid, network, options, progress)

    def _baked(self, scene: Scene, grid: Grid, network: str, options: BakeOptions, progress: Progress) -> BakedVolume:
        same = (scene.base, scene.palette_network, grid)
        if self._matter is None or self._matter[0] != same:
            self._matter = self._paint = None
            self._matter = same, matter_of(scene, grid, part(progress, 0.0, 0.6))
        matter, paint = self._matter[1], None
        field = scene.paint_shown if network == "styled" else None
        if field is not None:
            if self._paint is None or self._paint[0] is not field:
                self._paint = field, paint_at(field, matter)
            paint = self._paint[1]
        return baked(scene, matter, paint, network, options, part(progress, 0.6, 1.0))

    def _together(self, scene: Scene, options: BakeOptions, progress: Progress) -> BakedVolume:
        """Bake the functions of a joined scene, and add up what they show."""
        every = members(scene)
        shown = [k for k, member in enumerate(every) if any(r.seen_opacity for r in member.regions)] or [0]
        for done, number in enumerate(shown):
            member, own = every[number], network_in(every[number], network_of(scene, options))
            of_scene = member.base, member.palette_network, member.styled, member.regions, member.parts
            shaded_by = tuple((one.base, one.regions, one.parts, one.cuts) for one in member.casters)
            key = *of_scene, member.lamp, member.cuts, shaded_by, options
            baker, known, volume = self._layers.get(number, (Baker(), None, None))
            if volume is None or known != key:
                share = part(progress, done / len(shown), (done + 1) / len(shown))
                volume = baker.bake(member, replace(options, network=own, regions=None), share)
            self._layers[number] = baker, key, volume
        return summed([self._layers[number][2] for number in shown], grid_for(scene, options))


def grid_for(scene: Scene, options: BakeOptions) -> Grid:
    """Return the grid of a scene's baked volume; raises BadInput as :meth:`Baker.bake`."""
    network = network_of(scene, options)
    grids = [grid_of(member, options, network_in(member, network)) for member in members(scene)]
    return grids[0] if len(grids) == 1 else grid_around(grids, options.memory)


def network_in(member: Scene, network: NetworkName) -> NetworkName:
    """Return the name of a member's network that is drawn for one of its joined scene."""
    return network if network in member.networks else cast(NetworkName, member.networks[-1])


def bake(scene: Scene, options: BakeOptions = BakeOptions(), progress: Progress = silent) -> BakedVolume:
    """Bake a scene with its edits; see :meth:`Baker.bake`.

    >>> baked = svv.bake(scene)
    >>> type(baked).__name__
    'BakedVolume'
    """
    return Baker().bake(scene, options, progress)


def network_of(scene: Scene, options: BakeOptions) -> NetworkName:
    """Return the name of the network that gives the colours; BadInput if the scene lacks it, or it is ``base``."""
    network = options.network or cast(NetworkName, scene.networks[-1])
    if network not in scene.networks:
        raise BadInput(f"The scene has no network '{network}', only {', '.join(scene.networks)}.")
    if network == "base":
        raise BadInput(
            "The base network has a colour for each direction and none for a point: bake a scene with a palette, "
            "with the network pcn or styled."
        )
    return network


def baked(
    scene: Scene, matter: Matter, paint: Tensor | None, network: str, options: BakeOptions, progress: Progress
) -> BakedVolume:
    """Colour the points of a grid as a scene's edits, paint and light have them; (S, 3) ``paint`` if any is shown."""
    grid = matter.grid
    matter = replace(matter, region=of_colour(scene.regions_at(matter.position), matter.region))
    width, height, depth = grid.shape
    rgba = np.zeros((depth, height, width, 4), np.uint8)
    flat = rgba.reshape(-1, 4)
    logs = _seen_extinction(scene, matter, paint)
    log_depths = (logs + float(np.log(grid.unit_distance / scene.occupancy.box.size))).cpu().numpy()
    most = most_of(log_depths)
    codes = codes_of(log_depths, most)
    lights = None
    if options.light == "baked":
        lights = _mean_light(scene, matter, logs, codes > 0, part(progress, 0.0, 0.7))
    done = 0.7 if lights is not None else 0.0
    longest = 3.0 * 255.0**2  # a white point without extinction
    for piece in matter.pieces():
        part(progress, done, 1.0)(piece.start / max(len(matter), 1), "colouring")
        rows = piece.start + np.flatnonzero(codes[piece])
        if len(rows):
            at = torch.from_numpy(rows).to(matter.region.device)
            colour = _colour(scene, matter, None if paint is None else paint[at].float(), at, network, lights)
            shown = (colour.clamp(0.0, 1.0) * 255.0).round()
            flat[matter.place[rows], :3] = shown.byte().cpu().numpy()
            square = shown.square().sum(dim=1).cpu().numpy() + np.square(codes[rows], dtype=np.float32)
            longest = max(longest, float(square.max()))
    flat[matter.place, 3] = codes
    extend_colours(rgba, matter.near)
    if _soften_edges(scene, matter, rgba, most):
        extend_colours(rgba, matter.near)
    span_all_bytes(flat)
    progress(1.0, "colouring")
    ends = np.array([[0.0, 255.0]] * 3 + [[0.0, codes.max(initial=0)]])
    return BakedVolume(rgba, grid, most, (ends, (0.0, longest**0.5)))


def _soften_edges(scene: Scene, matter: Matter, rgba: NDArray[np.uint8], most: float) -> bool:
    """Let a visible region end half-way between its last points and the first ones of a hidden region.

    From a code to 0, interpolated extinction vanishes within a tenth of a voxel. If the hidden point keeps e^-1.6 of
    it, as much lies between both as if one half were full and the other one empty. Returns whether anything changed.
    """
    hidden = [k for k, r in enumerate(scene.regions) if r.seen_opacity == 0.0]
    if not hidden:
        return False
    rows = torch.isin(matter.region, matter.region.new_tensor(hidden)).cpu().numpy()
    scale = float(np.log(matter.grid.unit_distance / scene.occupancy.box.size))
    own = codes_of(matter.log_extinction.cpu().numpy()[rows] + scale, most)
    codes = np.ascontiguousarray(rgba[..., 3])
    softened = np.zeros_like(own)
    drop = round(EDGE_DROP * (CODES - 1) / (most - LEAST_LOG_DEPTH))
    soften_edges(codes, matter.place[rows], own, drop, softened)
    rgba.reshape(-1, 4)[matter.place[rows], 3] = softened
    return bool(softened.any())


def _seen_extinction(scene: Scene, matter: Matter, paint: Tensor | None) -> Tensor:
    """Return the logarithm of the extinction in images, -inf where a region is hidden. (S,)"""
    seen = matter.log_extinction.new_tensor([r.seen_opacity for r in scene.regions]).log()
    logs = matter.log_extinction + seen[matter.region]
    shown = None if paint is None else paint.float()
    factor = followed(scene, torch.ones_like(logs), matter.region, shown)
    logs = logs + factor.log()
    for cut in scene.cuts:
        beyond = cut.in_box(scene.occupancy.box).depth(matter.position) * matter.grid.resolution
        beyond = torch.where(scene.in_cut(cut, matter.region), beyond, -torch.inf)
        drop = DROP * (beyond + math.log(2.0) / DROP).clamp(min=0.0)
        logs = torch.where(beyond > REACH, -torch.inf, logs - drop)
    return logs


def _colour(
    scene: Scene, matter: Matter, paint: Tensor | None, rows: Tensor, network: str, lights: Tensor | None
) -> Tensor:
    """Return the colours of some points, as :meth:`svv.fields.scene.scene.Scene.shade` has them. (len(rows), 3)"""
    assert scene.palette_network is not None
    diffuse, region = matter.diffuse[rows].float(), matter.region[rows]
    recoloured = {scene.roots[k] for k, r in enumerate(scene.regions) if r.edited_colour is not None}
    if recoloured:
        offsets, here = matter.offsets[rows].float(), scene.regions_at(matter.position[rows])
        change = scene.edited_colours(offsets, here) - scene.palette_network.colours - offsets
        for k in recoloured:
            diffuse += matter.shares[rows, k, None] * change[:, k]
    diffuse = scene.with_style(diffuse, region, paint)
    occlude(scene, diffuse, matter.position[rows], region)
    if lights is not None:
        specular, shade = lights[rows].unbind(1)
        diffuse = palette_shading.lit(diffuse, specular, shade, *lights_of(scene, network)[region].unbind(1))
    cast_shadows(scene, diffuse, matter.position[rows], network, shadows_from(scene))
    return diffuse


def _mean_light(scene: Scene, matter: Matter, logs: Tensor, visible: NDArray[np.bool_], progress: Progress) -> Tensor:
    """Return specular c_s and shade m of each point, the mean over the sides from which it is seen. (S, 2)"""
    palette, grid = scene.palette_network, matter.grid
    assert palette is not None
    cells = np.zeros(grid.shape[::-1], np.float32)  # optical depth of one cell (Z, Y, X)
    cells.ravel()[matter.place] = logs.exp().cpu().numpy() / grid.resolution
    total, lights = torch.zeros(len(matter), 1), torch.zeros(len(matter), 2)
    rows = torch.from_numpy(np.flatnonzero(visible))
    for number, side in enumerate(SIDES):
        progress(number / len(SIDES), "lighting")
        weight = LEAST_SEEN + torch.from_numpy(_seen_from(cells, side).ravel()[matter.place][rows.numpy()])
        for first in range(0, len(rows), CHUNK):
            own = rows[first : first + CHUNK]
            share = weight[first : first + CHUNK, None]
            lights[own] += share * _light_from(scene, palette, matter, own, side).cpu()
            total[own] += share
    lights[rows] /= total[rows]
    return lights.to(logs.device)


def _seen_from(cells: NDArray[np.float32], side: tuple[int, int, int]) -> NDArray[np.float32]:
    """Return the transmittance between each point and a viewer far away in the direction ``side``. (Z, Y, X)"""
    axis = 2 - int(np.argmax(np.abs(side)))
    if sum(side) > 0:
        cells = np.flip(cells, axis)
    seen = np.exp(0.5 * cells - np.cumsum(cells, axis))
    return np.flip(seen, axis) if sum(side) > 0 else seen


def _light_from(
    scene: Scene, palette: PaletteField, matter: Matter, rows: Tensor, side: tuple[int, int, int]
) -> Tensor:
    """Return c_s and m of some points for a viewer in the direction ``side``. (len(rows), 2)"""
    rows = rows.to(matter.position.device)
    position = matter.position[rows].contiguous()
    samples = as_samples(position)
    toward = position.new_tensor([side], dtype=torch.float32)
    rays = Rays(torch.zeros_like(toward), -toward)
    ray = torch.zeros_like(samples.ray)
    if palette.phong is None:
        _, geometry = scene.base.geometry(samples)
        specular, shade = palette.lighting(geometry, encode_directions(rays.directions, ray))
    else:
        camera = Camera.orthographic(look_at(side, (0.0, 0.0, 0.0)), 1.0, 1, 1)
        beams = Beams.of(scene.lamp, camera, rays).at(ray)
        shares = matter.shares[rows].float()
        weights = shares / shares.sum(dim=1, keepdim=True).clamp(min=1e-6)
        coefficients = scene.coefficients()
        assert coefficients is not None
        coefficients = for_colours(coefficients, scene.regions_at(position))
        specular, shade = palette.phong(position, weights, beams, coefficients)
    return torch.stack([specular, shade], dim=1)
