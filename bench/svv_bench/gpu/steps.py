"""Single steps of the two stages of training, and of an image, to be traced."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import torch

from svv.errors import silent
from svv.fields.radiance.networks import PaletteField
from svv.fields.radiance.rendering import Marching
from svv.train.base.first_extinction import begin, first_occupancy
from svv.train.base.reconstruct import Reconstruction
from svv.train.base.resolutions import fitted_field
from svv.train.palette.recolour import Recolouring, palette_of
from svv.train.run.batches import RayPool
from svv_bench.gpu.context import SEED, Context


def first_stage(how: Context) -> Reconstruction:
    """Return stage 1 of the preset ``fast`` before its first step."""
    views, chosen = how.read("train"), how.preset()
    occupancy, _ = first_occupancy(views, chosen.reconstruct, chosen.field, silent, how.torch_device)
    field, _ = fitted_field(chosen.field, views.cameras, occupancy.box)
    beginning, _ = begin(views, occupancy, field, chosen.reconstruct, SEED, silent, device=how.torch_device)
    return Reconstruction(views, beginning, field, chosen.reconstruct, SEED, how.torch_device)


def stage_steps(how: Context) -> Iterator[tuple[str, Callable[[], object], int]]:
    """Yield the name of each kind of step, a function that takes one, and how many are timed."""
    work, views, chosen, number = first_stage(how), how.read("train"), how.preset(), iter(range(1 << 30))
    for _ in range(how.scaled(200)):
        work.step(next(number), 0.2)
    yield "stage-1", lambda: work.step(next(number), 0.2), 40
    yield "stage-1-refined", lambda: work.step(next(number), 0.6), 40
    work.prune(grow=False)
    base, occupancy = work.finish()
    palette = palette_of(views, occupancy, SEED, device=work.device)
    colours = torch.as_tensor(palette.colours, dtype=torch.float32)
    network = PaletteField(work.field_settings, occupancy, base.geometry_width, colours)
    network.encoding.randomize(0.01, torch.Generator().manual_seed(SEED))
    network.to(work.device).light_like(base)
    pool = RayPool(views, occupancy.box, SEED, work.device)
    second = Recolouring(base, network, occupancy, Marching(work.marching.step), pool, chosen.recolour)
    yield "stage-2", lambda: second.step(next(number), 0.5), 40
    scene, camera = how.scene(), views.cameras[0]
    yield "image", lambda: scene.render(camera, "pcn", (1.0, 1.0, 1.0)), 10
