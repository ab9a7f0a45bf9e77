"""The number of operations that a training step starts on a GPU, where even the smallest costs microseconds.

They are counted on the CPU, with the GPU kernels in Triton's interpreter: the kernels, and torch's operations that
compute or copy. The networks' optimiser is not counted; on a GPU it needs two operations per group.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode

from svv.core.geometry.box import Box
from svv.core.geometry.cameras import sphere_cameras
from svv.fields.devices.stroke_checks import BRUSHES, curved_strokes, samples_near
from svv.fields.radiance.networks import FieldSettings, PaletteField
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.rendering import Marching
from svv.fields.scene.region import Region
from svv.fields.scene.scene import Scene
from svv.fields.strokes.stored_strokes import Brushed
from svv.io.views.viewset import ViewSet
from svv.kernels import dispatch
from svv.train.base.first_extinction import Beginning
from svv.train.base.reconstruct import Reconstruction
from svv.train.palette import along_rays, regions_from_views
from svv.train.palette.recolour import Recolouring
from svv.train.run.batches import RayPool
from svv.train.run.config import RecolourSettings, ReconstructSettings
from svv.train.run.network_adam import NetworkAdam
from tests.interpreted import GPU, triton_kernels

pytestmark = pytest.mark.skipif(GPU, reason="counted in the interpreter; on a GPU a profiler counts better")

NOTHING = {
    "view", "_unsafe_view", "_reshape_alias", "expand", "t", "permute", "transpose", "slice", "select", "split",
    "split_with_sizes", "unbind", "unsqueeze", "squeeze", "detach", "alias", "as_strided", "narrow", "lift_fresh",
    "empty", "empty_like", "empty_strided", "new_empty", "new_empty_strided", "is_same_size",
    "_record_function_enter_new", "_record_function_exit", "rand",
}  # fmt: skip
"""Operations that start nothing on a GPU; random numbers are drawn on the CPU."""

MOST = {"base": 19, "palette": 23, "palette, regions known": 27, "image": 12}
"""Operations of a step of stage 1, of stage 2 without and with known regions, and of a piece of an image. A GPU records
all of a step but the first, which copies the step's numbers (:mod:`svv.kernels.recorded`)."""

WAITING = {"_local_scalar_dense", "nonzero", "masked_select", "_unique2"}
"""Operations for which the CPU waits on a GPU, because it needs their value or the size of their result. An index by a
mask begins with nonzero."""

WAITS = {"base": 0, "palette": 0, "palette, regions known": 0, "image": 1}
"""How often the CPU waits: in an image for the number of samples. Every 16th step of training also counts them
(:mod:`svv.train.run.sample_room`)."""


class Counter(TorchDispatchMode):
    """Counts operations, those within kernels as one."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []
        self.waits: list[str] = []
        self.silent = False

    def __torch_dispatch__(self, function: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        name = function.__name__.split(".")[0]
        if not self.silent and name not in NOTHING:
            self.found.append(name)
        if not self.silent and name in WAITING:
            self.waits.append(name)
        return function(*args, **(kwargs or {}))

    @contextmanager
    def one(self, name: str | None):
        """What happens here counts as one operation, or, without a name, as none."""
        before, self.silent = self.silent, True
        yield
        self.silent = before
        if name and not before:
            self.found.append(name)


@pytest.fixture
def count(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[], object]], tuple[list[str], list[str]]]:
    """Names of the operations that a function starts, and of those that it waits for."""
    from triton.runtime.interpreter import GridExecutor

    monkeypatch.setattr(dispatch, "kernels_of", lambda kind: triton_kernels)
    counter, launch, step = Counter(), GridExecutor.__call__, NetworkAdam.step

    def counted_launch(self: Any, *args: Any, **kwargs: Any) -> Any:
        with counter.one(self.fn.__name__):
            return launch(self, *args, **kwargs)

    def uncounted_step(self: NetworkAdam) -> Any:
        with counter.one(None):
            return step(self)

    def run(function: Callable[[], object]) -> tuple[list[str], list[str]]:
        counter.found.clear()
        counter.waits.clear()
        with counter:
            function()
        return list(counter.found), list(counter.waits)

    monkeypatch.setattr(GridExecutor, "__call__", counted_launch)
    monkeypatch.setattr(NetworkAdam, "step", uncounted_step)
    return run


class LeftAndRight:
    """Points on the left belong to the first region, the others to the second."""

    shared = False

    def of(self, position: torch.Tensor) -> torch.Tensor:
        return (position[:, 0] > 0.5).long()

    def assign(self, weights: torch.Tensor, position: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        owner = self.of(position)
        return owner, weights.gather(1, owner[:, None])[:, 0]


def views() -> ViewSet:
    """A red disc on every side."""
    images = np.zeros((6, 16, 16, 4), np.uint8)
    row, column = np.mgrid[:16, :16] - 7.5
    images[:, row**2 + column**2 < 25] = (230, 30, 30, 255)
    return ViewSet(tuple(sphere_cameras(6, (0.0, 0.0, 0.0), 3.0, 0.35, 16)), images, tuple("abcdef"))


@pytest.mark.slow
def test_operations_and_waits_of_a_step_and_of_an_image(
    count: Callable[[Callable[[], object]], tuple[list[str], list[str]]],
) -> None:
    field = FieldSettings(resolutions=(2, 4), features=2, width=16)
    box = Box.of_bounds((-0.35,) * 3, (0.35,) * 3)
    first = Reconstruction(views(), Beginning(Occupancy.full(box, 4)), field, ReconstructSettings(rays=16, samples=128))
    first.step(0, 0.0)  # what is made once is made here
    found = {"base": count(lambda: first.step(1, 0.1))}

    base, occupancy = first.finish()
    palette = PaletteField(field, occupancy, base.geometry_width, torch.tensor([[0.9, 0.1, 0.1], [0.1, 0.9, 0.1]]))
    how, pool = RecolourSettings(rays=16, samples=128), RayPool(views(), box, 0, dispatch.CPU)
    second = Recolouring(base, palette, occupancy, Marching(1 / 8), pool, how)
    second.step(0, 0.0)
    found["palette"] = count(lambda: second.step(1, 0.1))
    known = Recolouring(base, palette, occupancy, Marching(1 / 8), pool, how, LeftAndRight())
    known.step(0, 0.0)
    found["palette, regions known"] = count(lambda: known.step(1, 0.1))

    regions = tuple(Region(tuple(colour), 0.5) for colour in palette.colours.tolist())
    scene = Scene(field, occupancy, Marching(1 / 8), base, palette.requires_grad_(False), regions=regions)
    scene.render(views().cameras[1].resized(8, 8))
    found["image"] = count(lambda: scene.render(views().cameras[0].resized(8, 8)))

    names = {part: own for part, (own, _) in found.items()}
    assert {"march", "network", "network_backward", "learn", "adam"} <= set(names["base"])
    assert {part: len(own) for part, own in names.items() if len(own) > MOST[part]} == {}
    assert {part: waits for part, (_, waits) in found.items() if len(waits) > WAITS[part]} == {}
    assert "mm" not in {*names["base"], *names["palette"], *names["image"]}  # every network is one kernel


def test_operations_of_strokes_in_an_image(
    count: Callable[[Callable[[], object]], tuple[list[str], list[str]]],
) -> None:
    strokes = curved_strokes(3, 0)
    brushed = Brushed({0: (strokes, BRUSHES["oil"])}, flats=np.zeros((1, 3), np.float32))
    samples = samples_near(strokes, [2, 0, 3], 0)
    region = torch.zeros(len(samples), dtype=torch.int64)
    kernels = triton_kernels.STROKES
    assert kernels is not None

    def over() -> None:
        brushed.over_there(kernels, None, samples, region, {0: 0}, [0], 0.01)

    over()  # the tables of strokes are made here
    names, waits = count(over)
    assert names == ["zeros", "full", "sheets", "cumsum", "sheets", "paint", "ground", "cover"] and waits == []


MOST_OF_REGIONS = {"batch of rays": 82, "all batches": 120, "solution": 55, "step of a solution": 2}
"""Operations of the search for regions: of each batch of rays; of what is made of all of them; of memberships that are
solved for, and of one of :data:`svv.train.palette.along_rays.STEPS` steps."""

WAITS_OF_REGIONS = {"batch of rays": 2, "all batches": 2, "solution": 2, "step of a solution": 0}
"""How often the CPU waits: for the number of samples, and of those that are joined; for the light of regions."""


def test_operations_and_waits_of_the_search_for_regions(
    count: Callable[[Callable[[], object]], tuple[list[str], list[str]]], monkeypatch: pytest.MonkeyPatch
) -> None:
    field = FieldSettings(resolutions=(2, 4), features=2, width=16)
    beginning = Beginning(Occupancy.full(Box.of_bounds((-0.35,) * 3, (0.35,) * 3), 4))
    own = views()
    base, occupancy = Reconstruction(own, beginning, field, ReconstructSettings(rays=16, samples=128)).finish()
    scene, copied = Scene(field, occupancy, Marching(1 / 8), base), list[str]()

    def waiting(name: str) -> Callable[[torch.Tensor], object]:
        real = getattr(torch.Tensor, name)

        def counted(tensor: torch.Tensor) -> object:
            copied.append(name)
            return real(tensor)

        return counted

    for name in ("cpu", "tolist"):  # a copy to the CPU waits, too
        monkeypatch.setattr(torch.Tensor, name, waiting(name))
    monkeypatch.setattr(regions_from_views, "AT_A_TIME", 16)

    def found(function: Callable[..., object], *given: object) -> np.ndarray:
        copied.clear()
        operations, waits = count(lambda: function(*given))
        return np.array([len(operations), len(waits) + len(copied)])

    def points_of(batches: int) -> regions_from_views._Points:
        monkeypatch.setattr(regions_from_views, "RAYS", 16 * batches)
        return regions_from_views._Points(scene, own, 0)

    points, made = points_of(1), [found(points_of, batches) for batches in (1, 2)]
    region = torch.arange(points._seen.vertices) % 2
    solver, solved = along_rays.Solver(points._seen, points._at), []
    solver.solve(region, 2, 0.02)  # what is made once is made here
    for steps in (1, 2):
        monkeypatch.setattr(along_rays, "STEPS", steps)
        solved.append(found(solver.solve, region, 2, 0.02))
    batch, step = made[1] - made[0], (solved[1] - solved[0]) / along_rays.TURNS
    parts = batch, made[0] - batch, solved[0] - along_rays.TURNS * step, step
    each = dict(zip(MOST_OF_REGIONS, parts, strict=True))
    assert each["step of a solution"][0] > 0
    assert {part: int(n) for part, (n, _) in each.items() if n > MOST_OF_REGIONS[part]} == {}
    assert {part: int(n) for part, (_, n) in each.items() if n > WAITS_OF_REGIONS[part]} == {}
