"""Room for the samples of training steps on a GPU, so that nothing waits for their number."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from svv.kernels.types import Room

COUNT_EVERY = 16
"""Steps from one whose samples are counted to the next; in between, arrays have room for what was counted, and more."""

SPARE = 1.5
"""Room for samples, relative to those that were counted."""

WHOLE = 4096
"""Room is a multiple of this, so that the next steps find memory of the same size."""

NEAR = 1.2
"""Factor by which room may differ from what is wanted, and stays as it is: steps of other room are recorded anew."""


class SampleRoom:
    """How many samples the next steps have room for; rays without room are left out and counted, and it grows."""

    def __init__(self, device: torch.device) -> None:
        """Begin with a step whose samples are counted."""
        self.lost = 0
        """Rays that were left out."""
        self._dropped: Tensor = torch.zeros(1, dtype=torch.int64, device=device)
        self._spare, self._samples_a_ray, self._room = SPARE, math.nan, 0

    def of(self, number: int, rays: int) -> Room | None:
        """Return the room for step ``number`` of so many rays; None if its samples are to be counted."""
        if number % COUNT_EVERY == 0 or math.isnan(self._samples_a_ray):
            return None
        wanted = self._spare * self._samples_a_ray * rays
        if not wanted / NEAR <= self._room <= wanted * NEAR:
            self._room = WHOLE * math.ceil(wanted / WHOLE)
        return Room(self._room, self._dropped)

    def counted(self, samples: int, rays: int) -> None:
        """Adapt to the samples that a step's rays gave, and to the rays that the steps before it left out."""
        lost = int(self._dropped)
        if lost:
            self.lost += lost
            self._spare *= SPARE
            self._dropped.zero_()
        self._samples_a_ray = max(samples, 1) / max(rays, 1)

    def notes(self) -> list[str]:
        """Return a sentence for the user if rays were left out."""
        lost = self.lost + int(self._dropped)
        told = f"{lost} training rays were left out, because there was too little room for their samples on the GPU."
        return [told] if lost else []

    def forget(self) -> None:
        """Count the samples of the next step, because rays are sampled otherwise from now on."""
        self._samples_a_ray = math.nan
