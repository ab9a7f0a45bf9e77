"""Regions painted by pieces of pictures are kept apart, as those painted by strokes are while they are toned."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.core.colour.colour import rgb_to_lab
from svv.errors import Progress
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.networks import UnrestrictedField
from svv.fields.scene.scene import Scene
from svv.fields.scene.seen_colours import seen_in
from svv.train.paint.ink import Style
from svv.train.paint.legibility import Legibility
from svv.train.paint.painting import owners_of
from svv.train.paint.styled_views import visible_from
from svv.train.paint.view_pixels import ViewPixels

VIEWS, SIDE, MOST = 5, 128, 400
"""Number of views in which regions are looked at, their side in pixels, and the most pixels of each region in one."""

NEARLY = 0.03
"""Fraction of a picture's pixels that are darker than nearly the darkest, and so on."""

MIXED = 1.15
"""How many times less images show of a difference of pieces, whose borders and details mix in their pixels."""


@torch.no_grad()
def keep_pieces_apart(
    scene: Scene, field: UnrestrictedField, pictures: Mapping[int, Style], styled: Collection[int], flats: Tensor,
    progress: Progress,
) -> bool:  # fmt: skip
    """Move the lightness and chroma of regions' paint where they could be confused; returns whether they may still be.

    ``pictures`` are those of the regions painted by pieces, ``styled`` these and all others that have paint, which does
    not change, and ``flats`` the mean colours of all regions, RGB. (R, 3)
    """
    opacity = np.array([region.seen_opacity for region in scene.regions])
    views = visible_from(scene, scene.rig.sphere(VIEWS, SIDE), progress)
    painted = sorted(pictures)
    if not views or len(scene.regions) < 2:
        return False
    pixels = ViewPixels(views, opacity, painted, MOST)
    labs, means = {}, {}
    for k in painted:
        where = torch.from_numpy(pixels.where[pixels.region == k]).to(scene.device)
        if not len(where):
            continue
        labs[k] = rgb_to_lab(pixels.mixed(k, field(where).clamp(0.0, 1.0).cpu().numpy()))
        shown = np.unique(pixels.pixel[pixels.region == k])
        means[k] = labs[k][shown].mean(0)
    colours = np.array([region.edited_colour or region.colour for region in scene.regions], np.float64)
    legibility = Legibility(pixels, colours, flats.cpu().numpy().astype(np.float64))
    if legibility.close(labs):
        legibility.dim(seen_in(scene, "pcn"))
    legibility.asked = {pair: MIXED * least for pair, least in legibility.asked.items()}
    gamuts = {k: _gamut(np.asarray(pictures[k], np.float32)) for k in means}
    moves = legibility.moves(labs, means, gamuts, {})
    lattice = field.encoding
    assert isinstance(lattice, SparseLattice)
    if moves:
        owner = owners_of(scene, field.resolutions[-1], sorted(styled))
        table = lattice.table.detach().cpu().numpy().copy()
        for k, move in moves.items():
            mine = owner == k
            table[mine] = move.of_rgb(table[mine].clip(0.0, 1.0))
            labs[k] = move.of(labs[k])
        lattice.table.copy_(torch.from_numpy(table))
    return legibility.doubtful(labs)


def _gamut(picture: NDArray[np.float32]) -> tuple[float, float, float]:
    """Return nearly the least and largest lightness and nearly the largest chroma of a picture, CIELAB."""
    lab = rgb_to_lab(picture.reshape(-1, 3)[:: max(picture.size // 60_000, 1)])
    low, high = np.quantile(lab[:, 0], (NEARLY, 1.0 - NEARLY)).tolist()
    return low, high, float(np.quantile(np.hypot(lab[:, 1], lab[:, 2]), 1.0 - NEARLY))
