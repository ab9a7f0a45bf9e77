"""Training steps on a GPU whose samples nobody has counted: room for them, and what happens if there is too little.

The kernels run on a GPU if there is one, otherwise in Triton's interpreter.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from svv.core.geometry.box import Box
from svv.fields.devices.kernel_checks import EXTENT, MARCHES, march_rays, random_lattice, rays_through
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.networks import FieldSettings, PaletteField
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.rendering import Marching, Rays, march
from svv.kernels import dispatch
from svv.kernels.dispatch import CPU
from svv.kernels.types import Room, Samples
from svv.train.base.first_extinction import Beginning
from svv.train.base.reconstruct import Reconstruction
from svv.train.palette.pointed import InCells
from svv.train.palette.ranges import Owners
from svv.train.palette.recolour import Recolouring
from svv.train.palette.regions_from_views import Labels
from svv.train.run import sample_room
from svv.train.run.batches import RayBudget, RayPool
from svv.train.run.config import RecolourSettings, ReconstructSettings
from svv.train.run.sample_room import COUNT_EVERY, SPARE, SampleRoom
from tests.interpreted import GPU, triton_kernels
from tests.nightly import nightly
from tests.test_launches import LeftAndRight, views

DEVICE = torch.device("cuda" if GPU else "cpu")
RAYS = 40


def marched(samples: int | None, dropped: torch.Tensor, monkeypatch: pytest.MonkeyPatch) -> Samples:
    """Random rays through a random lattice, with room for so many samples."""
    monkeypatch.setattr(dispatch, "kernels_of", lambda kind: triton_kernels)
    lattice, occupied = random_lattice(5, 1)
    how, jitter = MARCHES["training"]
    origins, directions = (a.to(DEVICE) for a in rays_through(RAYS, 5))
    marching = Marching(how.step, how.least_weight, how.keep, how.stop, how.fade, how.merge)
    room = None if samples is None else Room(samples, dropped)
    occupancy = Occupancy(Box((0.0, 0.0, 0.0), 1.0, EXTENT), 4, occupied)
    return march(Rays(origins, directions), occupancy, lattice.to(DEVICE), marching, jitter, 0, room).to(CPU)


@pytest.mark.slow
@pytest.mark.parametrize("part", nightly([0.0, 0.4, 1.0, 2.0], 0.4))
def test_rays_without_room_are_counted_and_the_others_are_as_they_were(
    part: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    dropped = torch.zeros(1, dtype=torch.int64, device=DEVICE)
    everything = marched(None, dropped, monkeypatch)
    most = max(1, int(part * len(everything)))
    some = marched(most, dropped, monkeypatch)
    assert len(some) == most
    fits = everything.start + everything.count <= most
    assert int(dropped) == int((~fits).sum())
    assert torch.equal(some.count, torch.where(fits, everything.count, -1))
    assert some.total is not None
    total = int(some.total)
    assert total == int(everything.count[fits].sum()) and torch.equal(some.start[fits], everything.start[fits])
    for name in ("position", "sigma", "skipped", "ray"):
        assert torch.equal(getattr(some, name)[:total], getattr(everything, name)[:total])
    marched(most, dropped, monkeypatch)
    assert int(dropped) == 2 * int((~fits).sum())  # they add up until somebody reads them


def test_a_march_that_is_counted_has_a_total(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dispatch, "kernels_of", lambda kind: triton_kernels)
    found = march_rays(triton_kernels, DEVICE, *MARCHES["training"], 5, RAYS)
    assert found.total is not None and int(found.total) == len(found)


def test_room_follows_what_was_counted_and_grows_where_it_was_too_small() -> None:
    room = SampleRoom(CPU)
    assert room.of(1, 100) is None  # nothing is known yet
    room.counted(80_000, 100)
    first, double = room.of(1, 100), room.of(2, 200)
    assert first is not None and double is not None
    assert SPARE * 80_000 <= first.samples < SPARE * 80_000 + sample_room.WHOLE
    assert SPARE * 160_000 <= double.samples < SPARE * 160_000 + sample_room.WHOLE
    assert room.of(COUNT_EVERY, 100) is None and room.of(COUNT_EVERY + 1, 100) is not None
    assert not room.notes()
    first.dropped.add_(3)
    assert room.notes()[0].startswith("3 training rays were left out")
    room.counted(80_000, 100)
    assert room.notes()[0].startswith("3 training rays were left out")
    larger = room.of(1, 100)
    assert larger is not None and larger.samples > first.samples
    assert room.lost == 3 and int(larger.dropped) == 0
    room.forget()
    assert room.of(1, 100) is None


def test_numbers_of_samples_that_scatter_change_neither_room_nor_rays() -> None:
    """Otherwise, steps would be recorded anew whenever samples are counted."""
    room, budget, generator = SampleRoom(CPU), RayBudget(4096, 200_000), np.random.default_rng(0)
    seen = set()
    for number in range(0, 40 * COUNT_EVERY, COUNT_EVERY):
        samples = int(budget.rays * 80 * generator.uniform(0.98, 1.02))
        room.counted(samples, budget.rays)
        budget.adjust(number, samples, budget.rays)
        steps = room.of(number + 1, budget.rays)
        assert steps is not None and 1.2 < steps.samples / (80 * budget.rays) < 1.9
        seen.add((budget.rays, steps.samples))
    assert len(seen) <= 2, seen
    assert abs(budget.rays * 80 / 200_000 - 1.0) < 0.09


NO_POINTS = torch.tensor([[torch.nan] * 3, [torch.inf] * 3, [-1e30, 1e30, 0.5], [0.99, 0.99, 0.99]])


def test_what_is_no_point_has_a_region_like_any_other() -> None:
    """Steps with room to spare ask for the regions of all rows, and on a GPU a wrong index would end the training."""
    occupied = np.zeros((4, 4, 4), np.uint8)
    occupied[0, 0, 0] = 1
    lattice = SparseLattice(occupied, 4, (4,), 1)
    labels = Labels(lattice, np.arange(len(lattice.table)) % 2, CPU)
    pointed = InCells(np.zeros((4, 4, 4), np.int64), 4, CPU)
    volume: Any = SimpleNamespace(owner=np.ones((5, 5, 5), np.uint8), cells=4)
    for regions in (labels, pointed, Owners(volume, np.arange(2), CPU)):
        assert bool(((regions.of(NO_POINTS) >= 0) & (regions.of(NO_POINTS) < 2)).all())


def stages(monkeypatch: pytest.MonkeyPatch) -> tuple[Reconstruction, Recolouring]:
    """Both stages of a training of the disc, of which the second knows where its regions are."""
    monkeypatch.setattr(dispatch, "kernels_of", lambda kind: triton_kernels)
    field = FieldSettings(resolutions=(2, 4), features=2, width=16)
    box = Box.of_bounds((-0.35,) * 3, (0.35,) * 3)
    how = ReconstructSettings(rays=16, samples=128, doublings=0)
    first = Reconstruction(views(), Beginning(Occupancy.full(box, 4)), field, how, 3, DEVICE)
    base = Reconstruction(views(), Beginning(Occupancy.full(box, 4)), field, how, 3, DEVICE).finish()
    colours = torch.tensor([[0.9, 0.1, 0.1], [0.1, 0.9, 0.1]])
    palette = PaletteField(field, base[1], base[0].geometry_width, colours).to(DEVICE)
    pool = RayPool(views(), box, 0, DEVICE)
    settings = RecolourSettings(rays=16, samples=128, doublings=0)
    return first, Recolouring(base[0].to(DEVICE), palette, base[1], Marching(1 / 8), pool, settings, LeftAndRight())


@pytest.mark.parametrize("stage", nightly([0, 1], 0), ids=["stage 1", "stage 2"])
def test_steps_with_room_to_spare_are_those_that_were_counted(stage: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same sums in the same order, in the interpreter; a GPU adds atomically in any order."""
    ends = []
    for counted in (True, False):
        torch.manual_seed(0)
        work = stages(monkeypatch)[stage]
        if counted:
            monkeypatch.setattr(work.room, "of", lambda number, rays: None)
        losses = [float(work.step(number, 0.1)) for number in range(2)]
        ends.append([*losses, *(p.detach().cpu().flatten() for p in work.field.parameters())])
    for theirs, mine in zip(*ends, strict=True):
        torch.testing.assert_close(torch.as_tensor(mine), torch.as_tensor(theirs), atol=1e-6, rtol=1e-5)


def test_a_step_with_too_little_room_learns_from_the_rays_that_fit_and_the_next_has_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    work = stages(monkeypatch)[0]
    monkeypatch.setattr(sample_room, "WHOLE", 1)
    work.step(0, 0.0)
    work.room._spare = 0.5
    before = work.room.of(1, 16)
    error = float(work.step(1, 0.1))
    assert 0.0 < error < 1.0 and all(bool(p.isfinite().all()) for p in work.field.parameters())
    assert work.room.lost == 0  # nobody has read it yet
    work.step(COUNT_EVERY, 0.1)
    after = work.room.of(COUNT_EVERY + 1, 16)
    assert work.room.lost > 0 and before is not None and after is not None
    assert after.samples > before.samples
