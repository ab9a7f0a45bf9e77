"""Opacity that follows strokes: a painted region's dark strokes more opaque and its light ones less, or the reverse.

Paint colours what is there, but what is there stays as dense between the strokes as in them. Here the extinction of a
sample follows the brightness of its paint, and a gain for each region keeps the region's mean opacity, so that a
painting neither hides more of what lies behind it, nor less.

Letters: S samples, P regions.
"""

from __future__ import annotations

from dataclasses import replace
from weakref import WeakKeyDictionary

import torch
from torch import Tensor

from svv.fields.model import Model
from svv.fields.networks import UnrestrictedField
from svv.fields.paint_light import LIGHT_VIEW_SIZE, LIGHT_VIEWS
from svv.fields.rendering import RayCaster, composite, march
from svv.kernels.types import Samples

LOG_FACTOR = 0.8
"""Logarithm of the extinction's factor a standard deviation of the paint's brightness from its mean, at amount 1,"""
MOST_DEVIATIONS = 2.0
"""and after how many deviations the factor no longer changes: it stays within exp(1.6), which is 5, times the gain."""

LEAST_DEVIATION = 0.01
"""A region whose paint deviates less in brightness has no strokes, but noise."""

OPACITY_TOLERANCE, ITERATIONS, YIELD_BOUNDS = 2e-3, 20, (0.15, 1.0)
"""Part of a region's opacity by which it may miss what it is to be, after how many steps it may miss it by more, and
how much of the logarithm of a gain is taken to be seen in that of the opacity: all in fog, little of what is opaque."""

_known: WeakKeyDictionary[UnrestrictedField, dict[tuple[tuple[float, float], ...], Tensor]] = WeakKeyDictionary()


def followed(scene: Model, sigma: Tensor, region: Tensor, paint: Tensor | None) -> Tensor:
    """The extinction of samples with that of painted regions following their strokes: a new tensor where any does.

    Args:
        scene: With a palette colour network.
        sigma: Extinction. (S,)
        region: Of each sample. (S,)
        paint: Colour of the paint; None where none is shown. (S, 3)
    """
    strokes = None if paint is None else strokes_of(scene)
    return sigma if strokes is None or paint is None else sigma * _factor(strokes, region, brightness(paint))


def fade_of(scene: Model, network: str) -> float:
    """Least factor that the edits set on an extinction of the scene, strokes' where the network is ``styled``."""
    strokes = strokes_of(scene) if network == "styled" else None
    seen = [r.seen_opacity for r in scene.regions]
    if strokes is not None:
        gain, _, _, reach = strokes.double().unbind(1)
        seen = [o * factor for o, factor in zip(seen, (gain - reach).exp().tolist(), strict=True)]
    return min(seen, default=1.0)


def brightness(colour: Tensor) -> Tensor:
    """Luma of colours (ITU-R BT.709): of encoded values, as steps in it look alike. (S, 3) -> (S,)"""
    return colour.clamp(0.0, 1.0) @ colour.new_tensor([0.2126, 0.7152, 0.0722])


def strokes_of(scene: Model) -> Tensor | None:
    """What each region's strokes make of the extinction: a gain g, a slope k, a mean y and a reach b.

    The factor on the extinction of a sample whose paint has the brightness v is exp(g + clip(k (y - v), -b, b)).
    Of a region whose opacity does not follow strokes all four are 0. Found once for a painting and its edits.

    Returns:
        g, k, y and b (P, 4); None where no region's opacity follows strokes.
    """
    amounts = [0.0 if r.style is None else r.stroke_opacity * r.strength for r in scene.regions]
    if scene.styled is None or not any(amounts):
        return None
    known = _known.setdefault(scene.styled, {})
    key = tuple((amount, r.seen_opacity) for amount, r in zip(amounts, scene.regions, strict=True))
    if key not in known:
        known[key] = _solved(scene, scene.styled, amounts)
    return known[key]


def _factor(strokes: Tensor, region: Tensor, bright: Tensor) -> Tensor:
    gain, slope, mean, reach = strokes[region].unbind(1)
    return torch.exp(gain + torch.minimum(torch.maximum(slope * (mean - bright), -reach), reach))


@torch.no_grad()
def _solved(scene: Model, network: UnrestrictedField, amounts: list[float]) -> Tensor:
    """Means and gains over what is seen of the scene as edited, all around."""
    assert scene.palette_network is not None
    opacity = scene.palette_network.colours.new_tensor([r.seen_opacity for r in scene.regions])
    asked = opacity.new_tensor(amounts)
    reach = LOG_FACTOR * MOST_DEVIATIONS * asked.abs()
    fade = float((opacity * (-reach).exp()).min())
    views = []
    rig = scene.camera_rig
    for camera in () if rig is None else rig.sphere(LIGHT_VIEWS, LIGHT_VIEW_SIZE):
        rays = RayCaster([camera], scene.occupancy.box, scene.device).view(0)
        samples = march(rays, scene.occupancy, scene.base.density, replace(scene.marching_for_images, fade=fade))
        if len(samples):
            region = scene.palette_network.material(samples.position)[1].argmax(dim=1)
            sigma = scene.base.extinction(samples) * opacity[region]
            views.append((samples, sigma, region, brightness(network(samples.position))))

    def summed(strokes: Tensor | None, powers: int = 1) -> Tensor:
        """Sum over the samples of each region of weight, weight times brightness, and so on. (powers, P)"""
        sums = torch.zeros(powers, len(amounts), dtype=torch.float64, device=scene.device)
        for samples, sigma, region, bright in views:
            seen = _weights(samples, sigma if strokes is None else sigma * _factor(strokes, region, bright)).double()
            for power in range(powers):
                sums[power].index_add_(0, region, seen * bright.double() ** power)
        return sums

    whole, first, second = summed(None, 3)
    mean = first / whole.clamp(min=1e-12)
    deviation = (second / whole.clamp(min=1e-12) - mean.square()).clamp(min=0.0).sqrt()
    striped = (deviation > LEAST_DEVIATION) & (asked != 0.0)
    slope = torch.where(striped, LOG_FACTOR * asked / deviation.clamp(min=LEAST_DEVIATION), 0.0)
    strokes = torch.stack([torch.zeros_like(mean), slope, mean, reach], dim=1).to(opacity) * striped[:, None]
    before, moved, yields = torch.zeros_like(mean), torch.zeros_like(mean), torch.ones_like(mean)
    for _ in range(ITERATIONS):
        missing = torch.where(striped, (whole / summed(strokes)[0].clamp(min=1e-12)).log(), 0.0)
        # What the last step yielded says how far to go: little of a gain is seen where all is nearly opaque.
        told = moved.abs() > OPACITY_TOLERANCE
        yields = torch.where(told, (before - missing) / torch.where(told, moved, 1.0), yields).clamp(*YIELD_BOUNDS)
        # At -b no factor is above 1 and at b none below it, so the gain lies between.
        gain = (strokes[:, 0] + missing / yields).clamp(-strokes[:, 3], strokes[:, 3])
        before, moved = missing, gain - strokes[:, 0]
        if not bool(((missing.abs() > OPACITY_TOLERANCE) & (moved != 0.0)).any()):
            break
        strokes[:, 0] = gain
    return strokes


def _weights(samples: Samples, sigma: Tensor) -> Tensor:
    return composite(samples, sigma, sigma[:, None])[2]
