"""What each of several processes does in ``test_ranks.py``: ``python -m tests.ranked FOLDER ["first dies"]``.

The scene is a fog, of which every ray sees all: rounding is not amplified in it. Where something opaque hides what lies
behind it, gradients are nothing but rounding, and Adam makes whole steps of them, on one rank as on several.
"""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from svv.core.box import Box
from svv.core.cameras import Camera, sphere_cameras
from svv.ending import end_with
from svv.errors import Cancelled, Progress, silent
from svv.fields.networks import FieldSettings, PaletteField
from svv.fields.occupancy import Occupancy
from svv.fields.scene import Scene
from svv.io.viewset import ViewSet
from svv.train import loop, ranks
from svv.train.batches import RayPool
from svv.train.beginning import Beginning
from svv.train.config import Preset, RecolourSettings, ReconstructSettings, StylizeSettings
from svv.train.loop import Loop
from svv.train.pipeline import train_scene
from svv.train.recolour import Recolouring
from svv.train.reconstruct import Reconstruction
from svv.train.unmix import Unmixing

CPU = torch.device("cpu")
STEPS = 30
"""Steps of a stage, enough to refine the lattice; each amplifies what rounding differs by."""
SLOW = {"feature_rate": 0.002, "network_rate": 0.0005}
"""A tenth of the usual rates, of which Adam also makes whole steps where a gradient is nothing but rounding."""
LATTICE = FieldSettings(resolutions=(4, 8), features=2, width=16)
HASH = FieldSettings("hash", (4, 16), features=2, levels=4, log2_entries=10, width=16)
BASE = ReconstructSettings(
    iterations=100, rays=1023, samples=8192, cells=16, prune_every=40, use_volume=False, tomography=False,
    density_rate=0.03, **SLOW,
)  # fmt: skip
PALETTE = RecolourSettings(iterations=100, rays=1023, samples=8192, **SLOW)
SMALL = Preset("small", LATTICE, BASE, PALETTE, StylizeSettings())
COLOURS = ((0.8, 0.2, 0.2), (0.2, 0.3, 0.8), (0.3, 0.8, 0.2), (0.6, 0.6, 0.1))
Results = dict[str, Tensor]


class Halves:
    """Points belong to region 0 or 1, by their place."""

    shared = False

    def of(self, position: Tensor) -> Tensor:
        return (position[:, 0] > 0.6).long()

    def told(self, weights: Tensor, position: Tensor) -> tuple[Tensor, Tensor]:
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


def learned(work: Reconstruction | Recolouring, steps: int, name: str) -> Results:
    """Take steps; returns parameters, moments of the tables, and losses."""
    losses: list[Tensor] = []

    def step(number: int, fraction: float) -> Tensor:
        losses.append(work.step(number, fraction))
        return losses[-1]

    Loop(steps, None, silent, name).run(step)
    found = {f"{name}.{k}": v.clone() for k, v in work.field.state_dict().items()}
    for number, moments in enumerate(work.tables.moments):  # Adam's steps do not depend on the gradients' scale
        found[f"{name}.first.{number}"], found[f"{name}.second.{number}"] = moments
        found[f"{name}.age.{number}"] = work.tables.age[number]
    return found | {f"{name}.losses": torch.stack(losses), f"{name}.rays": torch.tensor(work.budget.rays)}


def base(field: FieldSettings, steps: int, name: str) -> tuple[Results, Scene]:
    box = Box.of_bounds((-0.42,) * 3, (0.42,) * 3)
    work = Reconstruction(fog_views(), Beginning(Occupancy.full(box, 16)), field, BASE)
    found = learned(work, steps, name)
    network, occupancy = work.finish()
    found[f"{name}.occupied"] = torch.from_numpy(occupancy.occupied)
    return found, Scene(field, occupancy, work.marching, network)


def palette(scene: Scene, steps: int, name: str, owners: Halves | None = None, given: bool = False) -> Results:
    torch.manual_seed(1)
    colours = torch.tensor(COLOURS)
    network = PaletteField(scene.settings, scene.occupancy, scene.base.geometry_width, colours)
    network.encoding.randomize(0.01, torch.Generator().manual_seed(1))
    pool = RayPool(fog_views(), scene.occupancy.box, 1, CPU)
    unmixing = Unmixing(colours.numpy(), CPU) if given else None
    work = Recolouring(scene.base, network, scene.occupancy, scene.marching, pool, PALETTE, owners, unmixing)
    return learned(work, steps, name)


def bases() -> tuple[Scene, Scene]:
    """What one process learns alone, on a lattice and on a hash grid, for the palette stages.

    Their samples are joined up to a threshold, so bases that differ by rounding may give them different samples.
    """
    return base(LATTICE, STEPS, "base")[1], base(HASH, 6, "base")[1]


def law(lattice: Scene, hashed: Scene) -> Results:
    """Return what both stages learn, on a lattice and on a hash grid, and with all losses of the palette stage."""
    found = base(LATTICE, STEPS, "base")[0] | base(HASH, 6, "hash base")[0]
    found |= palette(lattice, 12, "palette")
    found |= palette(lattice, 12, "owners", Halves())
    found |= palette(lattice, 12, "given", given=True)
    return found | palette(hashed, 6, "hash palette")


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


def stop() -> None:
    raise Cancelled


def die() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def main() -> None:
    folder = Path(sys.argv[1])
    torch.set_num_threads(1)
    loop.SAVE_EVERY = loop.SHOW_EVERY = 0.0
    alone = bases()
    with ranks.joined():
        if sys.argv[2:] == ["first dies"]:
            train(folder, until_palette(die, 0))
        rank, found, scene = ranks.place().rank, law(*alone), train(folder)
        torch.save({"law": found, "base": scene.base.state_dict()}, folder / f"{rank}.pt")
        scene.save(folder / f"{rank}.svv")
        try:
            train(folder / "stopped", until_palette(stop))
        except Cancelled:
            (folder / "stopped" / str(rank)).touch()
        train(folder / "died", until_palette(die))


if __name__ == "__main__":
    end_with(main, "svv")
