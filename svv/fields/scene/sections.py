"""Sections: how the faces of cuts show a region, as a flat wash or hatched as in a drawing, and the line around them.

No view saw most of what a cut lays open, so the colours learned there are guesses. A section shows the region alone:
the samples right behind a face take its unlit colour. Their opacity stays, so translucent regions stay translucent.
Letters: S samples, R rays.
"""

from __future__ import annotations

from collections.abc import Sequence
from weakref import WeakKeyDictionary

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.core.geometry.cuts import Cut
from svv.core.images.edges import ramp
from svv.core.images.outlines import LEAST_COVERAGE
from svv.fields.radiance.networks import UnrestrictedField
from svv.fields.radiance.rendering import composite
from svv.fields.scene.model import Model
from svv.fields.scene.region import Region
from svv.fields.scene.stroke_opacity import painted_samples
from svv.kernels.constants import numbers_on
from svv.kernels.types import Samples
from svv.options.editing import LEARNED

DEEP = 1.5
"""How deep behind a face a section reaches: in cells of the occupancy, or in samples where these are farther apart."""

BINS = 5
"""Cubes of colours along each of red, green and blue, in which the commonest paint is looked for."""

HATCHES = 64.0
"""Hatched lines per box unit along their direction."""

HATCH_WIDTH, HATCH_SOFTNESS = 0.3, 0.12
"""Width of a hatched line and of its soft edges, as fractions of the distance between lines."""

HATCH_DIRECTIONS = ((1.0, 2.0, 3.0), (3.0, -1.0, 2.0), (2.0, 3.0, -1.0), (-1.0, 3.0, 2.0))
"""Directions across the lines of hatched regions, in turn: they differ on faces of any direction."""

HATCH_INK = 0.3
"""Factor on the region's colour that gives the ink of its hatched lines."""

BESIDE = 3.0
"""Distance, in widths of the line, from which a face is no longer measured by what lies there."""

LEAST_SHARE = 0.02
"""Part of a pixel's opacity below which a section has no line; up to ``FULL_SHARE`` it is fainter."""

FULL_SHARE = 0.4

DIPS = (0.2, 0.4)
"""Share in a spot of a face, as a part of that around it, up to which it is a hole, and from which on it is none."""

_known: WeakKeyDictionary[UnrestrictedField, dict[object, Tensor]] = WeakKeyDictionary()


def is_sectioned(scene: Model) -> bool:
    """Return whether faces of cuts show other colours than what was learned there."""
    return bool(scene.cuts) and any(r.section != LEARNED and r.seen_opacity > 0.0 for r in scene.regions)


def has_section_lines(scene: Model) -> bool:
    """Return whether lines are drawn around the faces of cuts."""
    return bool(scene.cuts) and any(r.section_line > 0.0 and r.seen_opacity > 0.0 for r in scene.regions)


def faces(scene: Model, samples: Samples, region: Tensor) -> tuple[Tensor, Tensor]:
    """Return how far samples show the face of a cut that opens their regions (S,), and its number. (S,) each

    It is 1 right behind the face and falls to 0.
    """
    reach = max(DEEP / scene.occupancy.cells, DEEP * samples.step)
    near, number = torch.zeros_like(samples.sigma), torch.zeros_like(region)
    for k, cut in enumerate(scene.cuts):
        own = (2.0 + 2.0 * cut.in_box(scene.occupancy.box).depth(samples.position) / reach).clamp(0.0, 1.0)
        own = torch.where(scene.in_cut(cut, region), own, 0.0) if cut.regions else own
        number, near = torch.where(own > near, k, number), torch.maximum(near, own)
    return near, number


def _on_face(cut: Cut, position: Tensor) -> Tensor:
    """Return the places on the faces of a cut, in box coordinates, that are nearest to points (S, 3) beside them."""
    depth, aside = cut.depth(position), 1e-3 * torch.eye(3, device=position.device)
    slope = torch.stack([cut.depth(position + step) - depth for step in aside], dim=1)
    return position - depth[:, None] * torch.nn.functional.normalize(slope, dim=1)


@torch.no_grad()
def show_sections(
    scene: Model, colour: Tensor, samples: Samples, region: Tensor, network: str,
    face: tuple[Tensor, Tensor] | None = None,
) -> None:  # fmt: skip
    """Give the lit colours (S, 3) of samples behind the faces of cuts those of their regions' sections, in place.

    ``face``: from :func:`faces`, if it is known.
    """
    if not (is_sectioned(scene) and len(colour)):
        return
    region = region.long()
    flat = torch.tensor([r.section != LEARNED for r in scene.regions], device=colour.device)[region]
    share, of_cut = face or faces(scene, samples, region)
    share = torch.where(flat, share, 0.0)
    at = (share > 0.0).nonzero()[:, 0]
    washes = flat_colours(scene, network)[region[at]]
    hatched = torch.tensor([r.section == "hatched" for r in scene.regions], device=colour.device)[region[at]]
    if bool(hatched.any()):
        place = samples.position[at]
        for k, cut in enumerate(scene.cuts):
            own = (of_cut[at] == k).nonzero()[:, 0]
            place[own] = _on_face(cut.in_box(scene.occupancy.box), place[own])
        ink = torch.where(hatched, hatching(place, region[at]), 0.0)[:, None]
        washes = torch.lerp(washes, HATCH_INK * washes, ink)
    colour[at] = torch.lerp(colour[at], washes, share[at, None])


def hatching(position: Tensor, region: Tensor) -> Tensor:
    """Return how much ink hatched lines put at box coordinates (S, 3) in regions (S,), in [0, 1]. (S,)

    The lines are planes in space, so they stay where they are while a camera moves.
    """
    across = torch.nn.functional.normalize(position.new_tensor(HATCH_DIRECTIONS), dim=1)
    along = HATCHES * (position * across[region % len(across)]).sum(1)
    away = (along - along.round()).abs()
    return ((0.5 * (HATCH_WIDTH + HATCH_SOFTNESS) - away) / HATCH_SOFTNESS).clamp(0.0, 1.0)


def flat_colours(scene: Model, network: str) -> Tensor:
    """Return the unlit colour of each region: edited, or the commonest of its paint. (regions, 3)"""
    plain = numbers_on([r.edited_colour or r.colour for r in scene.regions], scene.device)
    paint = scene.paint_shown
    if network != "styled" or paint is None:
        return plain
    known = _known.setdefault(paint, {})
    key = None if scene.parts is None else scene.parts.digest, tuple(r.seen_opacity for r in scene.regions)
    if key not in known:
        known[key] = _main_paint(scene, paint)
    main = known[key]
    share = torch.where(main.isnan().any(dim=1), 0.0, scene.paint_shares)
    return torch.lerp(plain, main.nan_to_num(0.0), share[:, None])


def _main_paint(scene: Model, network: UnrestrictedField) -> Tensor:
    """Return the commonest colour of each region's paint where views see it, NaN for none. (regions, 3)

    It is the mean of the fullest cube of colours: the mean of all would be grey where strokes have several hues.
    """
    count = len(scene.regions)
    sums = torch.zeros(count * BINS**3, 4, dtype=torch.float64, device=scene.device)
    for region, paint, seen in painted_samples(scene, network):
        r, g, b = (paint.clamp(0.0, 1.0) * BINS).long().clamp(max=BINS - 1).unbind(1)
        weighted = torch.cat([paint, torch.ones_like(paint[:, :1])], dim=1).double() * seen.double()[:, None]
        sums.index_add_(0, ((region.long() * BINS + r) * BINS + g) * BINS + b, weighted)
    fullest = sums.view(count, -1, 4)[torch.arange(count), sums.view(count, -1, 4)[..., 3].argmax(dim=1)]
    return (fullest[:, :3] / torch.where(fullest[:, 3:] > 1e-9, fullest[:, 3:], torch.nan)).float()


@torch.no_grad()
def face_shares(
    scene: Model, samples: Samples, sigma: Tensor, region: Tensor, face: tuple[Tensor, Tensor] | None = None
) -> Tensor:  # fmt: skip
    """Return which part of each ray's light comes from faces of cuts, from the edited extinctions (S,). (R,)

    ``face``: from :func:`faces`, if it is known.
    """
    near, _ = face or faces(scene, samples, region.long())
    return composite(samples, sigma, near[:, None])[0][:, 0]


def with_lines(
    rgba: NDArray[np.float32], share: NDArray[np.float32], region: NDArray[np.int16], regions: Sequence[Region],
    view: float,
) -> NDArray[np.float32]:  # fmt: skip
    """Return an image with the lines around its sections.

    ``rgba``: straight alpha (H, W, 4); ``share`` (H, W) from :func:`face_shares`; ``region`` (H, W); ``view``: pixels
    of the shorter side of an image in which lines are as wide as asked.
    """
    scale, out = min(region.shape) / view, rgba.copy()
    for number, one in enumerate(regions):
        own = np.where(region == number, share, np.float32(0.0))
        if one.section_line == 0.0 or float(own.max(initial=0.0)) < LEAST_SHARE:
            continue
        width = max(one.section_line * scale, 0.5)
        around = _around(own > 0.0, int(np.ceil(2.0 * BESIDE * width + 8.0)))
        cover, drawn = _line_cover(own[around], width), out[around]
        ink = cover > LEAST_COVERAGE
        part, below = cover[ink], drawn[ink, 3]
        above = part + (1.0 - part) * below
        colour = np.asarray(one.outline_colour, np.float32)
        drawn[ink, :3] = (part[:, None] * colour + ((1.0 - part) * below)[:, None] * drawn[ink, :3]) / above[:, None]
        drawn[ink, 3] = above
    return out


def _around(marked: NDArray[np.bool_], margin: int) -> tuple[slice, slice]:
    """Return the rows and columns of what is marked in an image, with a margin."""
    rows, columns = (np.flatnonzero(marked.any(axis=k)) for k in (1, 0))
    (top, bottom), (left, right) = ((max(int(v[0]) - margin, 0), int(v[-1]) + margin + 1) for v in (rows, columns))
    return slice(top, bottom), slice(left, right)


def _line_cover(own: NDArray[np.float32], width: float) -> NDArray[np.float32]:
    """Return how much of each pixel a line of a width covers that surrounds a face, of shares ``own``. (H, W) each"""
    from scipy.ndimage import gaussian_filter, gaussian_gradient_magnitude, maximum_filter
    from scipy.special import ndtri

    blur, own = max(0.35 * width, 0.7), _without_spots(own, width)
    soft = gaussian_filter(own, blur)
    most = gaussian_filter(maximum_filter(soft, int(2 * np.ceil(BESIDE * width) + 1)), 0.5 * width)
    # Across a border the share is the integral of a Gaussian, which is as wide as the slope in its middle tells.
    steepest = maximum_filter(gaussian_gradient_magnitude(own, blur), int(2 * np.ceil(2.0 * blur) + 1))
    cover = np.zeros_like(own)
    there = most > LEAST_SHARE
    soft, most = soft[there], most[there]
    spread = most / np.maximum(np.sqrt(2.0 * np.pi) * steepest[there], 1e-6)
    away = spread * np.abs(ndtri(np.clip(soft / most, 1e-6, 1.0 - 1e-6)))
    strength = np.clip((most - LEAST_SHARE) / (FULL_SHARE - LEAST_SHARE), 0.0, 1.0)
    cover[there] = strength * np.clip(0.5 * width + 0.5 - away, 0.0, min(width, 1.0))
    return cover


def _without_spots(own: NDArray[np.float32], width: float) -> NDArray[np.float32]:
    """Return the shares (H, W) of a face without shallow spots: matter of uneven density has no borders there."""
    from scipy.ndimage import maximum_filter, minimum_filter

    around = int(2 * np.ceil(BESIDE * width) + 1)
    full = minimum_filter(maximum_filter(own, around), around)
    return own + ramp(own / np.maximum(full, np.float32(1e-6)), *DIPS) * (full - own)
