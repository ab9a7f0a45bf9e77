"""Opacity that follows strokes: dark and vivid strokes become more opaque than pale ones, or light ones than dark ones.

Paint only changes colours: a region is as dense between the strokes as in them. Here the extinction of a sample follows
how far its paint is from white, or from black. A gain per region keeps the region's mean opacity, so a painting hides
neither more nor less of what lies behind it.

Letters: S samples, P regions.
"""

from __future__ import annotations

from dataclasses import replace
from weakref import WeakKeyDictionary

import torch
from torch import Tensor

from svv.fields.radiance.networks import UnrestrictedField
from svv.fields.radiance.paint_light import LIGHT_VIEW_SIZE, LIGHT_VIEWS
from svv.fields.radiance.rendering import composite, march
from svv.fields.scene.model import Model
from svv.kernels.types import Samples

LOG_FACTOR = 2.0
"""Logarithm of the extinction's factor where paint is one standard deviation less pale than its mean, at amount 1."""
MOST_DEVIATIONS = 1.2
"""Standard deviations beyond which the factor no longer changes: it stays within exp(2.4) = 11 times the gain."""

LEAST_DEVIATION = 0.01
"""Standard deviation of the paint's paleness below which it is noise and not strokes."""

OPACITY_TOLERANCE, ITERATIONS, YIELD_BOUNDS = 2e-3, 20, (0.15, 1.0)
"""Relative tolerance of a region's opacity; number of steps after which a larger error is accepted; and bounds of the
ratio by which the logarithm of a gain changes that of the opacity: 1 in fog, little where the region is opaque."""

_known: WeakKeyDictionary[UnrestrictedField, dict[tuple[object, ...], Tensor]] = WeakKeyDictionary()


def followed(scene: Model, sigma: Tensor, region: Tensor, paint: Tensor | None) -> Tensor:
    """Return the extinction of samples, in painted regions following the strokes; a new tensor if any region does.

    Args:
        scene: A scene with a palette network.
        sigma: Extinction. (S,)
        region: Region of each sample. (S,)
        paint: Colour of the paint; None if no paint is shown. (S, 3)
    """
    strokes = None if paint is None else strokes_of(scene)
    return sigma if strokes is None or paint is None else sigma * _factor(strokes, region, paint)


def fade_of(scene: Model, network: str) -> float:
    """Return the smallest factor of the edits on extinction, including that of strokes if ``network`` is ``styled``."""
    strokes = strokes_of(scene) if network == "styled" else None
    seen = [r.seen_opacity for r in scene.regions]
    if strokes is not None:
        gain, _, _, reach = strokes.double().unbind(1)
        seen = [o * factor for o, factor in zip(seen, (gain - reach).exp().tolist(), strict=True)]
    return min(seen, default=1.0)


def paleness(colour: Tensor, amount: Tensor) -> Tensor:
    """Return by how little colours differ from white paper, or, for negative amounts, how much from black. (S,)

    The smallest of red, green and blue tells strokes of any hue from white; luma would take yellow for it.

    Args:
        colour: Encoded RGB. (S, 3)
        amount: How much opacity follows the strokes, or a number of the same sign. (S,)
    """
    low, high = colour.clamp(0.0, 1.0).aminmax(dim=1)
    return torch.where(amount >= 0.0, low, high)


def strokes_of(scene: Model) -> Tensor | None:
    """Return how each region's extinction depends on its strokes: a gain g, a slope k, a mean y and a reach b.

    The factor on the extinction of a sample whose paint has the paleness v is exp(g + clip(k (y - v), -b, b)).
    For a region whose opacity does not follow strokes all four are 0. Solved once per painting and edits.

    Returns:
        g, k, y and b (regions, 4); None if no region's opacity follows strokes.
    """
    amounts = [0.0 if r.style is None else r.stroke_opacity * r.strength for r in scene.regions]
    paint = scene.paint_shown
    if paint is None or not any(amounts):
        return None
    if paint.painted_in is not None:  # solved anew in each time step, opacities would flicker
        known_there = strokes_of(replace(paint.painted_in(), regions=scene.regions))
        return None if known_there is None else known_there.to(scene.device)
    known = _known.setdefault(paint, {})
    parts = "" if scene.parts is None else scene.parts.digest
    key = (parts, *((amount, r.seen_opacity) for amount, r in zip(amounts, scene.regions, strict=True)))
    if key not in known:
        known[key] = _solved(scene, paint, amounts)
    return known[key]


def _factor(strokes: Tensor, region: Tensor, paint: Tensor) -> Tensor:
    gain, slope, mean, reach = strokes[region].unbind(1)
    change = slope * (mean - paleness(paint, slope))
    return torch.exp(gain + torch.minimum(torch.maximum(change, -reach), reach))


@torch.no_grad()
def _solved(scene: Model, network: UnrestrictedField, amounts: list[float]) -> Tensor:
    """Solve for means and gains over the visible parts of the edited scene, in views from all around."""
    assert scene.palette_network is not None
    opacity = scene.palette_network.colours.new_tensor([r.seen_opacity for r in scene.regions])
    asked = opacity.new_tensor(amounts)
    reach = LOG_FACTOR * MOST_DEVIATIONS * asked.abs()
    fade = float((opacity * (-reach).exp()).min())
    by_strokes = network.brushed is not None and network.brushed.complete
    shown = replace(scene, resolved=1.0 / network.resolutions[-1] if by_strokes else 0.0)
    views = []
    rig = scene.camera_rig
    for camera in () if rig is None else rig.sphere(LIGHT_VIEWS, LIGHT_VIEW_SIZE):
        rays = scene.caster([camera]).view(0)
        samples = march(rays, scene.occupancy, scene.base.density, replace(scene.marching_for_images, fade=fade))
        if len(samples):
            region = scene.region_of(samples.position, scene.palette_network.material(samples.position)[1])
            sigma = scene.base.extinction(samples) * opacity[region]
            paint = shown.paint(samples, "styled", region)
            assert paint is not None
            views.append((samples, sigma, region, paint))

    def summed(strokes: Tensor | None, powers: int = 1) -> Tensor:
        """Return sums over each region's samples of weight, weight times paleness, and so on. (powers, P)"""
        sums = torch.zeros(powers, len(amounts), dtype=torch.float64, device=scene.device)
        for samples, sigma, region, paint in views:
            seen = _weights(samples, sigma if strokes is None else sigma * _factor(strokes, region, paint)).double()
            pale = paleness(paint, asked[region]).double()
            for power in range(powers):
                sums[power].index_add_(0, region, seen * pale**power)
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
        # The effect of the last step sets the next: where all is nearly opaque, a gain has little visible effect.
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
