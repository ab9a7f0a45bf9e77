"""What each of several processes does in ``test_ranks.py``: ``python -m tests.ranked FOLDER ["first dies"]``.

One process trains a fog alone and keeps its work before some of the steps; then it and the ranks take each of these
steps from what was kept. So a step is compared with the same step. Adam divides a gradient by its own size: where that
is only rounding, it makes whole steps of rounding, and after thirty steps two correct orders of sums have parted.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from svv.core.geometry.box import Box
from svv.core.geometry.cameras import Camera, sphere_cameras
from svv.ending import end_with
from svv.errors import Cancelled, Progress, silent
from svv.fields.radiance.encodings import LatticeAdam
from svv.fields.radiance.networks import FieldSettings, PaletteField
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet
from svv.kernels.numba import bfloat16
from svv.train.base.first_extinction import Beginning, largest_extinction, log_extinction
from svv.train.base.reconstruct import Reconstruction
from svv.train.palette.recolour import Recolouring
from svv.train.palette.unmix import Unmixing
from svv.train.pipeline import train_scene
from svv.train.run import loop, ranks
from svv.train.run.batches import RayPool
from svv.train.run.config import Preset, RecolourSettings, ReconstructSettings, StylizeSettings

CPU = torch.device("cpu")
STEPS = {"base": (0, 15, 16, 29), "palette": (0, 11)}
"""Steps of a stage that are compared: the first; where the lattice is refined; where the number of rays changes, as it
does at the first; and the last, on a field that has learned."""
SLOW = {"feature_rate": 0.002, "network_rate": 0.0005}
"""A tenth of the usual rates, with which the fog stays one, of which every ray sees all."""
LATTICE = FieldSettings(resolutions=(4, 8), features=2, width=16)
HASH = FieldSettings("hash", (4, 16), features=2, levels=4, log2_entries=10, width=16)
BASE = ReconstructSettings(
    iterations=100, rays=1023, samples=8192, cells=16, prune_every=40, use_volume=False, tomography=False,
    density_rate=0.03, **SLOW,
)  # fmt: skip
FEW = replace(BASE, rays=127)
"""For the hash grid, which has a sample at every step of a ray: the fewer make a sum, the less of it is rounding."""
PALETTE = RecolourSettings(iterations=100, rays=1023, samples=8192, **SLOW)
SMALL = Preset("small", LATTICE, BASE, PALETTE, StylizeSettings())
COLOURS = ((0.8, 0.2, 0.2), (0.2, 0.3, 0.8), (0.3, 0.8, 0.2), (0.6, 0.6, 0.1))
Results = dict[str, Tensor]
ADAM = ("gradient", "first", "second", "age", "rate", "value")


class Halves:
    """Points belong to region 0 or 1, by their place."""

    shared = False

    def of(self, position: Tensor) -> Tensor:
        return (position[:, 0] > 0.6).long()

    def assign(self, weights: Tensor, position: Tensor) -> tuple[Tensor, Tensor]:
        owner = self.of(position)
        return owner, weights.gather(1, owner[:, None])[:, 0]


def fog(camera: Camera) -> np.ndarray:
    """Exact view of a ball of fog, whose colour depends on the place, straight alpha. (H, W, 4) uint8"""
    origins, directions = camera.rays()
    middle = origins - (origins * directions).sum(-1, keepdims=True) * directions
    chord = 2.0 * np.sqrt(np.maximum(0.16 - (middle**2).sum(-1), 0.0))
    image = np.concatenate([0.5 + 0.8 * middle, 1.0 - np.exp(-2.0 * chord[..., None])], axis=-1)
    return (image.clip(0.0, 1.0) * 255.0).round().astype(np.uint8)


def fog_views() -> ViewSet:
    cameras = sphere_cameras(12, (0.0, 0.0, 0.0), 4.0, np.radians(24), 32)
    return ViewSet(tuple(cameras), np.stack([fog(c) for c in cameras]), tuple(map(str, range(12))))


class Recorded(LatticeAdam):
    """Notes gradients and rates of the tables before a step, which clears them."""

    noted: tuple[list[Tensor], Sequence[float | Tensor]]

    def step(self, rates: Sequence[float | Tensor], pulls: Sequence[float | Tensor] | None = None) -> None:
        self.noted = [its.buffers_for_gradient()[0].clone() for its in self.encodings], rates
        super().step(rates, pulls)


def step_again(path: Path) -> Results:
    """Take a step from what was kept before it; returns what it found, and of each parameter what Adam made of it.

    The latter under NAME.WHAT: its gradient, Adam's moments and age, the learning rate, and the parameter's new value.
    """
    work, number, fraction = torch.load(path, weights_only=False)
    found: Results = {}
    if isinstance(work, Reconstruction):
        exponent = partial(log_extinction, work.field)
        found["largest"] = largest_extinction(exponent, work.occupancy, CPU, shared=True).detach()
    work.tables.__class__ = Recorded
    found["error"] = work.step(number, fraction)
    found["rays"] = torch.tensor(work.budget.rays)
    names = {id(parameter): name for name, parameter in work.field.named_parameters()}
    for k, encoding in enumerate(work.tables.encodings):
        gradients, rates = work.tables.noted
        adam = gradients[k], *work.tables.moments[k], work.tables.age[k][:, None], torch.tensor(rates[k])
        found |= named(names[id(encoding.table)], adam, encoding.table)
    for k, group, parameter in work.networks._numbered():
        own = work.networks.state[k]
        adam = parameter.grad, own["exp_avg"], own["exp_avg_sq"], own["step"], torch.tensor(group["lr"])
        found |= named(names[id(parameter)], adam, parameter)
    return found


def named(name: str, adam: Sequence[Tensor], parameter: Tensor) -> Results:
    what = zip(ADAM, (*adam, parameter.detach()), strict=True)
    return {f"{name}.{key}": value for key, value in what}


def keep(work: Reconstruction | Recolouring, steps: Sequence[int], name: str, folder: Path) -> None:
    """Train until the last of some steps, and keep the work before each of them, for :func:`step_again`."""
    count = steps[-1] + 1
    for number in range(count):
        if number in steps:
            torch.save((work, number, number / count), folder / f"{name} {number}.step")
        work.step(number, number / count)


def base(field: FieldSettings, steps: Sequence[int], name: str, folder: Path) -> Scene:
    box = Box.of_bounds((-0.42,) * 3, (0.42,) * 3)
    settings = BASE if field is LATTICE else FEW
    work = Reconstruction(fog_views(), Beginning(Occupancy.full(box, 16)), field, settings)
    keep(work, steps, name, folder)
    network, occupancy = work.finish()
    return Scene(field, occupancy, work.marching, network)


def palette(scene: Scene, name: str, folder: Path, owners: Halves | None = None, given: bool = False) -> None:
    torch.manual_seed(1)
    colours = torch.tensor(COLOURS)
    network = PaletteField(scene.settings, scene.occupancy, scene.base.geometry_width, colours)
    network.encoding.randomize(0.01, torch.Generator().manual_seed(1))
    pool = RayPool(fog_views(), scene.occupancy.box, 1, CPU)
    unmixing = Unmixing(colours.numpy(), CPU) if given else None
    settings = PALETTE if scene.settings is LATTICE else replace(PALETTE, rays=FEW.rays)
    work = Recolouring(scene.base, network, scene.occupancy, scene.marching, pool, settings, owners, unmixing)
    work.start -= 0.2  # the palette's own loss, which is no sum over rays, is more than rounding
    keep(work, STEPS["palette"], name, folder)


def alone(folder: Path) -> None:
    """Keep steps of both stages, on a lattice and on a hash grid, and with all losses of the palette stage."""
    lattice = base(LATTICE, STEPS["base"], "base", folder)
    hashed = base(HASH, (0, 5), "hash base", folder)
    palette(lattice, "palette", folder)
    palette(lattice, "owners", folder, Halves())
    palette(lattice, "given", folder, given=True)
    palette(hashed, "hash palette", folder)


def steps_again(folder: Path) -> dict[str, Results]:
    """Take each step that was kept in a folder."""
    return {path.stem: step_again(path) for path in sorted(folder.glob("*.step"))}


def train(folder: Path, progress: Progress = silent) -> Scene:
    """Train, from the checkpoint in a folder if there is one."""
    return train_scene(fog_views(), SMALL, progress, folder / "checkpoint")[0]


def until_palette(act: object, rank: int = 1) -> Progress:
    """Progress that, on one rank, does something in the middle of the palette stage."""

    def progress(fraction: float, label: str) -> None:
        if ranks.place().rank == rank and label.startswith("palette") and fraction > 0.8:
            assert callable(act)
            act()

    return progress


def single_precision() -> None:
    """Multiply in float32 on every CPU: with half of the samples, a rank may otherwise choose another precision."""
    bfloat16.cpu_has_bfloat16 = cache(lambda: False)


def stop() -> None:
    raise Cancelled


def die() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def main() -> None:
    folder = Path(sys.argv[1])
    torch.set_num_threads(1)
    loop.SAVE_EVERY = loop.SHOW_EVERY = 0.0
    single_precision()
    with ranks.joined():
        if sys.argv[2:] == ["first dies"]:
            train(folder, until_palette(die, 0))
        rank, steps, scene = ranks.place().rank, steps_again(folder), train(folder)
        torch.save({**steps, "trained": scene.base.state_dict()}, folder / f"{rank}.pt")
        scene.save(folder / f"{rank}.svv")
        try:
            train(folder / "stopped", until_palette(stop))
        except Cancelled:
            (folder / "stopped" / str(rank)).touch()
        train(folder / "died", until_palette(die))


if __name__ == "__main__":
    end_with(main, "svv")
