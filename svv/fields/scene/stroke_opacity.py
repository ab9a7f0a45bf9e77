"""Opacity that follows strokes: between dark and vivid strokes a region becomes clearer, or between light ones.

The extinction of a sample follows how far its paint is from white, or from black. Strokes are as opaque as the region
itself, and the ground between them is clearer, like glazes on glass: nothing becomes denser, so a thin shell keeps its
profile, and the ground never so clear that holes show. Letters: S samples, P regions.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from weakref import WeakKeyDictionary

import torch
from torch import Tensor

from svv.fields.radiance.networks import UnrestrictedField
from svv.fields.radiance.rendering import composite, march
from svv.fields.scene.model import Model
from svv.fields.scene.paint_light import LIGHT_VIEW_SIZE, LIGHT_VIEWS

LOG_FACTOR, MOST_DEVIATIONS = 0.9, 1.2
"""How much smaller the extinction's logarithm is, at amount 1, where paint is one standard deviation paler than its
mean; and deviations from which it falls no further: the barest ground has exp(-1.08) = 0.34 times its extinction. What
is darker than the mean keeps all of it."""

LEAST_DEVIATION = 0.01
"""Standard deviation of the paint's paleness below which it is noise and not strokes."""

_known: WeakKeyDictionary[UnrestrictedField, dict[tuple[object, ...], Tensor]] = WeakKeyDictionary()


def followed(scene: Model, sigma: Tensor, region: Tensor, paint: Tensor | None) -> Tensor:
    """Return the extinction of samples (S,), in painted regions following the strokes; a new tensor if any region does.

    ``region`` of each sample (S,); ``paint``: its colour (S, 3), or None if no paint is shown.
    """
    strokes = None if paint is None else strokes_of(scene)
    return sigma if strokes is None or paint is None else sigma * _factor(strokes, region, paint)


def fade_of(scene: Model, network: str) -> float:
    """Return the smallest factor of the edits on extinction, including that of strokes if ``network`` is ``styled``.

    Hidden regions do not count: their cells are known (:mod:`svv.fields.scene.open_cells`).
    """
    strokes = strokes_of(scene) if network == "styled" else None
    seen = [r.seen_opacity for r in scene.regions]
    if strokes is not None:
        gain, _, _, reach = strokes.double().unbind(1)
        seen = [o * factor for o, factor in zip(seen, (gain - reach).exp().tolist(), strict=True)]
    return min((o for o, r in zip(seen, scene.regions, strict=True) if r.seen_opacity > 0.0), default=1.0)


def paleness(colour: Tensor, amount: Tensor) -> Tensor:
    """Return by how little encoded RGB (S, 3) differs from white paper, or, for amounts < 0, how much from black. (S,)

    The smallest of red, green and blue tells strokes of any hue from white; luma would take yellow for it.
    """
    low, high = colour.clamp(0.0, 1.0).aminmax(dim=1)
    return torch.where(amount >= 0.0, low, high)


def strokes_of(scene: Model) -> Tensor | None:
    """Return how each region's extinction depends on its strokes: a gain g, a slope k, a middle y and a reach b.

    The factor on the extinction of a sample whose paint has the paleness v is exp(g + clip(k (y - v), -b, b)), and g is
    -b: at most 1. Measured once. (regions, 4), 0 for a region whose opacity does not follow strokes; None if none does.
    """
    amounts = [0.0 if r.style is None else r.stroke_opacity * r.strength for r in scene.regions]
    paint = scene.paint_shown
    if paint is None or not any(amounts):
        return None
    if paint.painted_in is not None:  # measured anew in each time step, opacities would flicker
        known_there = strokes_of(replace(paint.painted_in(), regions=scene.regions))
        return None if known_there is None else known_there.to(scene.device)
    known = _known.setdefault(paint, {})
    parts = "" if scene.parts is None else scene.parts.digest
    key = (parts, *((amount, r.seen_opacity) for amount, r in zip(amounts, scene.regions, strict=True)))
    if key not in known:
        known[key] = _measured(scene, paint, amounts)
    return known[key]


def _factor(strokes: Tensor, region: Tensor, paint: Tensor) -> Tensor:
    gain, slope, mean, reach = strokes[region].unbind(1)
    change = slope * (mean - paleness(paint, slope))
    return torch.exp(gain + torch.minimum(torch.maximum(change, -reach), reach))


@torch.no_grad()
def _measured(scene: Model, network: UnrestrictedField, amounts: list[float]) -> Tensor:
    """Measure means and deviations over the visible parts of the edited scene, in views from all around."""
    asked = scene.base.encoding.table.new_tensor(amounts)
    sums = torch.zeros(3, len(amounts), dtype=torch.float64, device=scene.device)
    for region, paint, seen in painted_samples(scene, network):
        pale = paleness(paint, asked[region]).double()
        for power in range(3):
            sums[power].index_add_(0, region, seen.double() * pale**power)
    first, second = sums[1:] / sums[0].clamp(min=1e-12)
    deviation = (second - first.square()).clamp(min=0.0).sqrt()
    striped = (deviation > LEAST_DEVIATION) & (asked != 0.0)
    slope = LOG_FACTOR * asked / deviation.clamp(min=LEAST_DEVIATION)
    reach = 0.5 * LOG_FACTOR * MOST_DEVIATIONS * asked.abs()
    middle = first + 0.5 * MOST_DEVIATIONS * deviation * asked.sign()
    return torch.stack([-reach, slope, middle, reach], dim=1).to(asked) * striped[:, None]


@torch.no_grad()
def painted_samples(scene: Model, network: UnrestrictedField) -> Iterator[tuple[Tensor, Tensor, Tensor]]:
    """Yield the regions (S,), paint (S, 3) and weights in the image (S,) of samples of the uncut scene's views."""
    assert scene.palette_network is not None
    opacity = scene.palette_network.colours.new_tensor([r.seen_opacity for r in scene.regions])
    by_strokes = network.brushed is not None and network.brushed.complete
    shown, rig = replace(scene, resolved=1.0 / network.resolutions[-1] if by_strokes else 0.0), scene.camera_rig
    for camera in () if rig is None else rig.sphere(LIGHT_VIEWS, LIGHT_VIEW_SIZE):
        rays = scene.caster([camera]).view(0)
        samples = march(rays, scene.occupancy, scene.base.density, scene.marching_for_images)
        if len(samples):
            region = scene.region_of(samples.position, scene.palette_network.material(samples.position)[1])
            sigma = scene.base.extinction(samples) * opacity[region]
            paint = shown.paint(samples, "styled", region)
            assert paint is not None
            yield region, paint, composite(samples, sigma, sigma[:, None])[2]
