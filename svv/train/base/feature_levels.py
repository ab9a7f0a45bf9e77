"""Choice of the number of feature levels for a scene's colours: finer levels that views would not show are dropped."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from torch import nn

from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.networks import BaseField, encode_directions
from svv.fields.radiance.rendering import composite, march
from svv.fields.radiance.widths import DIRECTION_WIDTH
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet

RAYS = 8192
"""Number of random pixels from which accuracy is measured."""

LEAST_GAIN = 0.05
"""Gain in dB above which the finer levels are kept: well below the difference between two seeds."""


def with_fewest_levels(scene: Scene, views: ViewSet, seed: int, borders: bool = False) -> tuple[Scene, str]:
    """Return the scene without the finer levels of features that add next to nothing, and the reason.

    Random pixels of the views decide. The network relies even on features without new information, so a dropped level
    is predicted from the coarser ones, by an affine map that is merged into its first layer. With ``borders`` between
    regions that are known point by point, all levels stay: the palette network needs them. Paint always uses all.
    """
    encoding = scene.base.encoding
    if not isinstance(encoding, SparseLattice):
        return scene, f"all {encoding.levels} levels of the hash grid, as in the preset"
    if encoding.levels == 1:
        return scene, "one level of features, the minimum"
    if borders:
        return scene, f"all {encoding.levels} levels of features stay, for the borders between the regions"
    # One at a time: each has tables of its own, hundreds of megabytes of them where cells are small.
    found = [accuracy(without_finer(scene, k, views, seed), views, seed) for k in range(1, encoding.levels)]
    found.append(accuracy(scene, views, seed))
    kept = next(k for k in range(1, encoding.levels + 1) if found[-1] - found[k - 1] <= LEAST_GAIN)
    said, verb, first = "left out", "would add", kept
    if kept == encoding.levels:
        said, verb, first = f"all {kept} levels of features stay", "adds", kept - 1
    numbers = range(first + 1, encoding.levels + 1)
    names = " and ".join(f"{n} ({encoding.resolutions[n - 1]} cells)" for n in numbers)
    rows = encoding.rows_of_level(encoding.levels - 1).stop - encoding.rows_of_level(first).start
    # One byte per feature, in the base network's table and in the palette network's.
    return scene if kept == encoding.levels else without_finer(scene, kept, views, seed), (
        f"level{'s' * (len(numbers) > 1)} {names} {verb} {found[-1] - found[first - 1]:.2f} dB "
        f"for {2e-6 * rows * encoding.features:.2g} MB: {said}"
    )


@torch.no_grad()
def accuracy(scene: Scene, views: ViewSet, seed: int) -> float:
    """Return the PSNR in dB of the base network's colours on random pixels of the views."""
    seen = _Seen(scene, views, seed)
    colour = scene.base(seen.geometry, seen.directions)
    error = (composite(seen.samples, seen.sigma, colour)[0] - seen.truth).square().mean()
    return float(-10.0 * torch.log10(error.clamp(min=1e-12)))


@torch.no_grad()
def without_finer(scene: Scene, levels: int, views: ViewSet, seed: int) -> Scene:
    """Return the scene with the first ``levels`` feature levels; the others are predicted from these."""
    old, seen = scene.base, _Seen(scene, views, seed)
    assert isinstance(old.encoding, SparseLattice) and old.density is not None
    width = levels * old.encoding.features
    # f_finer = A f_coarser + b; the direction's first harmonic is a constant and takes b.
    harmonic = seen.directions[:, :1]
    known = torch.cat([seen.geometry[:, :width], harmonic], dim=1).double()
    weighted = (known * composite(seen.samples, seen.sigma, harmonic)[2].double()[:, None]).T
    ridge = torch.eye(width + 1, dtype=torch.float64, device=scene.device) * 1e-12
    affine = torch.linalg.solve(weighted @ known + ridge, weighted @ seen.geometry[:, width:].double()).float()
    resolutions = scene.settings.resolutions
    settings = replace(scene.settings, resolutions=resolutions[:levels], finer=resolutions[levels:])
    base = BaseField(settings, scene.occupancy, old.density.resolutions).to(scene.device)
    base.density = old.density
    base.encoding.table.copy_(old.encoding.table[: len(base.encoding.table)])
    base.colour_mlp[2:].load_state_dict(old.colour_mlp[2:].state_dict())
    first, its = base.colour_mlp[0], old.colour_mlp[0]
    assert isinstance(first, nn.Linear) and isinstance(its, nn.Linear)
    coarser, finer, direction = its.weight.split([width, old.geometry_width - width, DIRECTION_WIDTH], dim=1)
    taken = finer @ affine.T  # (hidden, width + 1)
    added = torch.nn.functional.pad(taken, (0, DIRECTION_WIDTH - 1))
    first.weight.copy_(torch.cat([coarser, direction], dim=1) + added)
    return replace(scene, settings=settings, base=base.requires_grad_(False))


class _Seen:
    """Samples and inputs of the base network at random pixels of the views, and the true colours."""

    def __init__(self, scene: Scene, views: ViewSet, seed: int) -> None:
        cameras = views.cameras
        count = len(cameras) * cameras[0].width * cameras[0].height
        pixels = np.random.default_rng(seed).integers(0, count, RAYS)
        rgba = torch.from_numpy(views.images.reshape(-1, 4)[pixels].astype(np.float32) / np.float32(255.0))
        self.truth = (rgba[:, :3] * rgba[:, 3:]).to(scene.device)
        rays = scene.caster(cameras).rays(torch.from_numpy(pixels))
        self.samples = march(rays, scene.occupancy, scene.base.density, scene.marching)
        self.sigma, self.geometry = scene.base.geometry(self.samples)
        self.directions = encode_directions(rays.lit_along, self.samples.ray)
