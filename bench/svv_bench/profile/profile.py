"""``svv bench profile``: how long each part of training and of an image takes, and how far it is from its floor."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import torch

from svv.core.geometry.cameras import CameraRig
from svv.errors import BadInput, Progress, part, silent
from svv.fields.radiance.networks import PaletteField
from svv.fields.radiance.rendering import Marching
from svv.fields.scene.region import Region
from svv.fields.scene.scene import Scene
from svv.fields.scene.view_cache import disable_view_cache
from svv.io.views.viewset import ViewSet
from svv.kernels.dispatch import CPU, kernels_of
from svv.kernels.numba.bfloat16 import cpu_has_bfloat16
from svv.train.base.first_extinction import begin, first_occupancy
from svv.train.base.reconstruct import Reconstruction
from svv.train.base.resolutions import fitted_field
from svv.train.base.sampling import with_fewest_samples
from svv.train.palette.lighting import shows_light
from svv.train.palette.ranges import regions_of
from svv.train.palette.recolour import Recolouring, palette_of
from svv.train.run.batches import RayPool
from svv.train.run.config import Preset, preset
from svv_bench.profile.ceilings import Ceilings, measure_ceilings
from svv_bench.profile.table import Profile, profile_of
from svv_bench.profile.watch import Watch
from svv_bench.profile.work import watched

COUNTED_STEPS = 2
"""Number of steps whose work is counted, after those that are timed."""


def profile_views(
    views: ViewSet, preset_name: str | Preset, steps: int, timed: int, seed: int, progress: Progress
) -> dict[str, Any]:
    """Train on views for a while, draw an image, and report how long each part took.

    Stage 1 runs its whole schedule in ``steps`` steps, including pruning and refinement, and is profiled before the
    refinement and at the end; stage 2 takes half as many steps and is profiled at its end. The networks learn little
    in so few steps, but the steps are as large as in a real training.

    Args:
        views: Training views.
        preset_name: Preset, or its name.
        steps: Number of steps of stage 1.
        timed: Number of steps and images that are timed per profile.
        seed: Seed of networks and rays.
        progress: Called several times per second; the work stops if it raises.

    Returns:
        ``profiles`` (:class:`Profile`), ``ceilings`` (:class:`Ceilings`), ``threads``, ``half`` (whether colour
        networks are multiplied in half precision), ``preset``, ``views``, ``size`` [width, height].

    Raises:
        BadInput: There are too few steps, or training rejects the views or settings.
    """
    if steps < (least := 2 * (timed + COUNTED_STEPS)):
        raise BadInput(f"{steps} steps are too few to time {timed} of each half; give at least {least}.")
    chosen = preset(preset_name)
    progress(0.0, "ceilings of this machine")
    work = _Steps(Watch(watched(kernels_of("cpu"))), timed, measure_ceilings())
    scene = _stage_1(views, chosen, steps, seed, work, part(progress, 0.05, 0.55))
    scene = _stage_2(views, chosen, steps // 2, seed, work, scene, part(progress, 0.55, 0.9))
    camera = views.cameras[0]
    progress(0.9, "an image")
    with disable_view_cache():
        work.take("an image, palette network", camera.width * camera.height, lambda: scene.render(camera))
    progress(1.0, "an image")
    return {
        "profiles": work.profiles, "ceilings": work.ceilings, "threads": torch.get_num_threads(),
        "half": cpu_has_bfloat16(), "preset": chosen.name, "views": len(views.cameras),
        "size": [camera.width, camera.height],
    }  # fmt: skip


class _Steps:
    """The profiles taken so far, and what is needed to take more."""

    def __init__(self, watch: Watch, timed: int, ceilings: Ceilings) -> None:
        self.watch, self.timed, self.ceilings = watch, timed, ceilings
        self.profiles: list[Profile] = []

    @property
    def looked_at(self) -> int:
        """Number of steps of a profile."""
        return self.timed + COUNTED_STEPS

    def take(self, name: str, rays: int, step: Callable[[], object]) -> None:
        """Time and count a step by repeating it."""
        with self.watch.on():
            times = self.watch.time(step, self.timed)
            work = self.watch.count(step, COUNTED_STEPS)
        self.profiles.append(profile_of(name, rays, times, work, self.ceilings))


def _stage_1(views: ViewSet, chosen: Preset, steps: int, seed: int, work: _Steps, progress: Progress) -> Scene:
    settings = replace(chosen.reconstruct, iterations=steps, prune_every=max(1, steps // 10))
    progress(0.0, "where to look")
    occupancy, _ = first_occupancy(views, settings, chosen.field, silent)
    field = chosen.field
    if chosen.fitted:
        field, _ = fitted_field(field, views.cameras, occupancy.box, settings)
    beginning, _ = begin(views, occupancy, field, settings, seed, silent)
    training = Reconstruction(views, beginning, field, settings, seed)
    number = itertools.count()

    def step() -> None:
        done = next(number)
        training.step(done, done / steps)
        progress(done / steps, "stage 1")

    ends = (("stage 1, first half", steps // 2), ("stage 1, second half", steps))
    for (name, end), start in zip(ends, (0, steps // 2), strict=True):
        for _ in range(start, end - work.looked_at):
            step()
        work.take(name, training.drawn, step)
    base, occupancy = training.finish()
    rig = CameraRig.of(views.cameras)
    return Scene(field, occupancy, Marching(training.marching.step), base, camera_rig=rig)


def _stage_2(
    views: ViewSet, chosen: Preset, steps: int, seed: int, work: _Steps, scene: Scene, progress: Progress
) -> Scene:
    known = None
    if views.classified is not None and chosen.reconstruct.use_volume:
        known = regions_of(views.classified, views, scene, seed)
    palette = palette_of(views, scene.occupancy, seed) if known is None else known.palette
    if chosen.fitted:
        lighting = "network" if shows_light(scene, views, seed)[0] else "none"
        scene = replace(scene, settings=replace(scene.settings, lighting=lighting))
    colours = torch.as_tensor(palette.colours, dtype=torch.float32)
    network = PaletteField(scene.settings, scene.occupancy, scene.base.geometry_width, colours)
    network.encoding.randomize(0.01, torch.Generator().manual_seed(seed))
    network.light_like(scene.base)
    pool = RayPool(views, scene.occupancy.box, seed, CPU)
    owners = None if known is None else known.owners
    training = Recolouring(scene.base, network, scene.occupancy, scene.marching, pool, chosen.recolour, owners)
    number = itertools.count()

    def step() -> None:
        done = next(number)
        training.step(done, done / steps)
        progress(done / steps, "stage 2")

    for _ in range(steps - work.looked_at):
        step()
    work.take("stage 2", training.drawn, step)
    network.requires_grad_(False)
    found = zip(network.colours.tolist(), training.shares(), strict=True)
    regions = tuple(Region(tuple(colour), float(share)) for colour, share in found)
    return with_fewest_samples(replace(scene, palette_network=network, regions=regions), views.cameras)[0]
