"""Stage 3 as in the paper, first half: the unrestricted network (UCN) learns the palette network's colours."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from svv.core.colour import palette_shading
from svv.fields.radiance.encodings import LatticeAdam
from svv.fields.radiance.networks import UnrestrictedField
from svv.fields.radiance.rendering import Rays, march
from svv.fields.scene.model import for_colours, of_colour
from svv.fields.scene.scene import Scene
from svv.kernels.types import Samples
from svv.train.base.resolutions import paint_pixel, paint_resolutions
from svv.train.run.config import MatchSettings
from svv.train.run.loop import falling, network_adam

DISTILLATION_SIZE = 256
"""Side in pixels of the views whose rays are drawn: they only determine where samples fall."""

PROBE = 4096
"""Number of rays from which the number of samples per ray is estimated."""

DISTILLATION_SAMPLES = 40_000
"""Approximate maximum number of samples per step: they determine its cost, and translucent scenes have many per ray."""


class Distillation:
    """Trains a UCN on the diffuse colours of a scene's PCN, along rays from all around."""

    def __init__(
        self,
        scene: Scene,
        transferred: Tensor,
        settings: MatchSettings,
        seed: int,
        before: UnrestrictedField | None = None,
    ) -> None:
        """Prepare to learn the regions' colours after the transfer of styles' mean colours, RGB (regions, 3).

        ``before`` is a UCN or laid paint, whose colours regions keep that the scene marks as styled.
        """
        assert scene.palette_network is not None
        torch.manual_seed(seed)
        self.scene, self.teacher, self.palette = scene, scene.palette_network, transferred
        self.settings, self.seed = settings, seed
        cell = None if settings.pixels_a_cell is None else settings.pixels_a_cell * paint_pixel(scene, settings)
        levels = paint_resolutions(scene.settings, cell, scene.occupancy.cells)
        known = None if before is None or before.direct else before  # laid paint has no network to start from
        levels = levels if known is None else known.resolutions
        self.field = UnrestrictedField(scene.settings, scene.occupancy, levels).to(scene.device)
        # The paper spends 150 iterations on ||E_p(x) - E_u(x)||^2. Both tables have the same layout, so a copy solves
        # it; the student's additional finer levels, which follow the teacher's, start with zeros.
        self.before = before
        with torch.no_grad():
            if known is None:
                self.field.encoding.table[: len(self.teacher.encoding.table)] = self.teacher.encoding.table
            else:
                self.field.load_state_dict(known.state_dict())
        styled = [before is not None and r.style is not None for r in scene.regions]
        self.known = torch.tensor(styled, device=scene.device)
        """Regions whose colours ``before`` holds. (regions,)"""
        cameras = scene.rig.sphere(settings.distil_views, DISTILLATION_SIZE)
        self.caster = scene.caster(cameras)
        pixels = np.random.default_rng(seed).integers(0, settings.distil_views * DISTILLATION_SIZE**2, PROBE)
        probe = march(self.caster.rays(torch.from_numpy(pixels)), scene.occupancy, scene.base.density, scene.marching)
        self.rays = min(settings.distil_rays, max(PROBE // 4, DISTILLATION_SAMPLES * PROBE // max(len(probe), 1)))
        assert self.field.colour_mlp is not None
        networks = list(self.field.colour_mlp.parameters())
        self.networks = network_adam(networks, settings.network_rate)
        self.tables = LatticeAdam([self.field.encoding])

    def step(self, number: int, fraction: float) -> Tensor:
        """Take one step on ||c_d - c_u||^2 (StyleRF-VolVis, eq. 7); returns the loss. The rate only falls."""
        generator = np.random.default_rng((self.seed, number))
        views, pixels = self.settings.distil_views, DISTILLATION_SIZE**2
        rays = self.caster.rays(torch.from_numpy(generator.integers(0, views * pixels, self.rays)))
        samples = march(rays, self.scene.occupancy, self.scene.base.density, self.scene.marching, seed=number + 1)
        if not len(samples):
            return torch.zeros(())
        with torch.no_grad():
            truth = self.truth(samples, rays)
        loss = (self.field(samples.position) - truth.clamp(0.0, 1.0)).square().mean()
        self.networks.zero_grad(set_to_none=True)
        loss.backward()
        rate = falling(fraction, 0.1)
        for group in self.networks.param_groups:
            group["lr"] = self.settings.network_rate * rate
        self.networks.step()
        self.tables.step([self.settings.feature_rate * rate])
        return loss.detach()

    def truth(self, samples: Samples, rays: Rays) -> Tensor:
        """Return the target colours of samples: the transferred palette's, or those of ``before``. (S, 3)"""
        intensity, weights, offsets = self.teacher.material(samples.position)
        here = self.scene.regions_at(samples.position)
        colours = palette_shading.diffuse(intensity, weights, for_colours(self.palette, here) + offsets)
        if self.before is not None:
            there = self.known[of_colour(here, weights.argmax(dim=1))]
            colours[there] = self.before(samples.position[there])
        return colours
