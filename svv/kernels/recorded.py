"""Training steps recorded on a GPU as CUDA graphs: their kernels are started again without Python.

A graph repeats the same kernels at the same addresses. The numbers in which steps differ therefore lie on the GPU
(:class:`StepNumbers`), and a step is recorded again when the number of rays, the room for their samples, the occupied
cells or the lattices change. :func:`svv.fields.devices.gpu.may_record` tells whether a GPU can do so.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence

import torch
from torch import Tensor

from svv.kernels.constants import moved_at_once

SLOTS = 16
"""Numbers of a step besides the shifts of its rays, at most."""

Step = Callable[[], Tensor]
"""Takes a step and returns its error, a scalar."""


class StepNumbers:
    """The numbers in which a step differs from the one before."""

    def __init__(self, device: torch.device) -> None:
        """Give no numbers yet."""
        self._device = device
        self._there = torch.zeros(0, device=device)
        self.pixels: int | Tensor = 0
        """Seed of the pixels, a number, or an int32 tensor (1,) on the GPU."""
        self.march: int | Tensor = 0
        """Seed of the march, likewise."""
        self.others: Sequence[float] | Tensor = ()
        """Learning rates and weights: numbers, or a float32 tensor on the GPU. (N,)"""
        self.shift = self._there
        """Random numbers of the rays in [0, 1), on the device. (R,)"""

    def set(self, number: int, pixels: int, others: Sequence[float], rays: slice, there: bool) -> None:
        """Set the numbers; on the GPU if kernels read them ``there``, always at the same addresses.

        ``number`` of the step is the seed of all but the ``pixels``; ``rays`` are those that this rank takes.
        """
        shift = torch.rand(rays.stop, generator=torch.Generator().manual_seed(number))[rays]
        if not there:
            (self.shift,) = moved_at_once((shift.numpy(),), self._device)
            self.pixels, self.march, self.others = pixels, number + 1, others
            return
        size = SLOTS + len(shift)
        if size > len(self._there):
            self._there = torch.zeros(size, device=self._device)
        here = torch.empty(size, pin_memory=self._device.type == "cuda")
        here[:2].view(torch.int32).numpy()[:] = pixels, number + 1
        here.numpy()[2 : 2 + len(others)] = others
        here.numpy()[SLOTS:] = shift.numpy()
        self._there[:size].copy_(here, non_blocking=True)
        seeds = self._there[:2].view(torch.int32)
        self.pixels, self.march = seeds[:1], seeds[1:]
        self.others, self.shift = self._there[2 : 2 + len(others)], self._there[SLOTS:size]

    def other(self, which: int) -> float | Tensor:
        """Return one of the other numbers: itself, or a tensor (1,)."""
        return self.others[which : which + 1] if isinstance(self.others, Tensor) else self.others[which]


class RecordedSteps:
    """Repeats a step from its recording where there is one of the same key."""

    def __init__(self, possible: bool) -> None:
        """Record steps if that is ``possible``: on a GPU, by a single process."""
        self.possible = possible
        """Whether steps are recorded."""
        self.recordings = 0
        """How many recordings were made."""
        self.notes: list[str] = []
        """A sentence for the user if recording failed, after which steps are taken as they are."""
        self._key: Hashable = None
        self._warm: Hashable = None
        self._error: Tensor | None = None
        self._graph: torch.cuda.CUDAGraph | None = None
        self._pool = torch.cuda.graph_pool_handle() if possible else None

    def take(self, key: Hashable, step: Step) -> Tensor:
        """Take a step: the first one of a key as it is, and then from a recording.

        The first one compiles and loads the kernels that it needs: nothing may be loaded while a step is recorded.
        ``key``: what a recording depends on, besides what :meth:`forget` is told of. What differs from step to step, it
        reads from :class:`StepNumbers`.
        """
        if not self.possible or key != self._warm:
            self.forget()  # numbers of more rays lie elsewhere
            self._warm = key
            return step()
        if key != self._key:
            try:
                self._record(step)
            except RuntimeError as error:  # of a driver or version of torch that cannot, or for want of memory
                self.possible = False
                self.notes.append(f"training steps are not recorded as CUDA graphs, and take longer: {error}")
                return step()
            self._key = key
        assert self._graph is not None and self._error is not None
        self._graph.replay()
        return self._error.clone()  # the next step writes over it

    def forget(self) -> None:
        """Forget the recording, because occupied cells or lattices have changed."""
        self._graph = self._error = self._key = self._warm = None

    def _record(self, step: Step) -> None:
        """Record a step, which does nothing yet."""
        self._graph = self._error = self._key = None  # first, so that its memory can be used again
        graph, own, here = torch.cuda.CUDAGraph(), torch.cuda.Stream(), torch.cuda.current_stream()
        own.wait_stream(here)
        with torch.cuda.stream(own):
            graph.capture_begin(pool=self._pool, capture_error_mode="thread_local")
            try:
                self._error = step()
            finally:
                graph.capture_end()
        here.wait_stream(own)
        self._graph = graph
        self.recordings += 1
