"""Median CPU and wall-clock time, and bytes, of a training step, in one process or several.

``python docs/measurements/ranks.py [VIEWS]`` measures one process, and
``torchrun --nproc-per-node 2 docs/measurements/ranks.py [VIEWS]`` two, both with ``OMP_NUM_THREADS=1``. Without a
folder of views, the scene is a ball of fog.
"""

from __future__ import annotations

import statistics
import sys
import time
from pathlib import Path
from typing import Any

import numba
import numpy as np
import torch
import torch.distributed as dist

from svv.core.geometry.cameras import sphere_cameras
from svv.io.views.viewset import ViewSet
from svv.train.base.reconstruct import Reconstruction
from svv.train.palette.recolour import Recolouring
from svv.train.pipeline import train_scene
from svv.train.run import ranks
from tests.ranked import fog

STEPS = 120
cpu: dict[str, list[float]] = {"base": [], "palette": []}
wall: dict[str, list[float]] = {"base": [], "palette": []}
sent = {"base": 0, "palette": 0}


def measure(kind: type[Any], stage: str) -> None:
    """Record the CPU time of the steps of a stage, of all threads, and the bytes that the rank gives to be summed."""
    take, add = kind.step, dist.all_reduce

    def counted(tensor: torch.Tensor, *rest: Any) -> Any:
        sent[stage] += tensor.numel() * tensor.element_size()
        return add(tensor, *rest)

    def step(self: Any, number: int, fraction: float) -> Any:
        begin, began, dist.all_reduce = time.process_time(), time.monotonic(), counted
        loss = take(self, number, fraction)
        dist.all_reduce = add
        cpu[stage].append(time.process_time() - begin)
        wall[stage].append(time.monotonic() - began)
        return loss

    kind.step = step


def main() -> None:
    numba.set_num_threads(torch.get_num_threads())
    measure(Reconstruction, "base")
    measure(Recolouring, "palette")
    with ranks.joined():
        if len(sys.argv) > 1:
            views = ranks.once(lambda: ViewSet.read(Path(sys.argv[1])))
        else:
            cameras = sphere_cameras(24, (0.0, 0.0, 0.0), 4.0, np.radians(24), 128)
            views = ViewSet(tuple(cameras), np.stack([fog(c) for c in cameras]), tuple(map(str, range(24))))
        train_scene(views, "fast", change=(f"reconstruct.iterations={STEPS}", f"recolour.iterations={STEPS}"))
        spent, passed = ({k: round(1e3 * statistics.median(v), 1) for k, v in x.items()} for x in (cpu, wall))
        print(
            f"rank {ranks.place().rank}: CPU ms a step {spent}; ms a step {passed}; bytes a step",
            {k: v // STEPS for k, v in sent.items()},
        )


if __name__ == "__main__":
    main()
