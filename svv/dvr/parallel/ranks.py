"""The processes of a parallel run (MPI's ranks), as VTK's controller connects them; ParaView has one in every program.

The first rank leads: it sends orders, and the others wait for them asleep. MPI itself would wait at full load.
"""

from __future__ import annotations

import pickle
import time
import traceback
from collections.abc import Callable
from importlib.util import find_spec
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkDataArray
from vtkmodules.vtkCommonExecutionModel import vtkExtentTranslator
from vtkmodules.vtkParallelCore import vtkMultiProcessController

from svv.errors import BadInput

if find_spec("vtkmodules.vtkParallelMPI") is not None:  # VTK with MPI
    import vtkmodules.vtkParallelMPI  # noqa: F401  (lets Python know the class of the controller)

Result = TypeVar("Result")
Number = TypeVar("Number", bound=np.number)

ORDER, BLOCK = 20801, 20802
"""Tags of the messages."""

NAP = 0.005
"""Seconds between two looks for an order."""


class Ranks:
    """The processes of a parallel run. All must call the methods in the same order, except for orders."""

    def __init__(self, controller: vtkMultiProcessController) -> None:
        self.controller = controller
        self.number: int = controller.GetLocalProcessId()
        """Number of this rank; the leader's is 0."""
        self.count: int = controller.GetNumberOfProcesses()
        self.sent = 0
        """Bytes of the arrays that this rank has sent."""

    def part_of(self, extent: list[int]) -> list[int]:
        """Return this rank's part of an extent (x, x, y, y, z, z), as ParaView divides it; it may be empty."""
        part = [0] * 6
        mode = vtkExtentTranslator.BLOCK_MODE
        vtkExtentTranslator().PieceToExtentThreadSafe(self.number, self.count, 0, extent, part, mode, 0)
        return part

    def gathered(self, values: NDArray[Number], goal: int) -> NDArray[Number] | None:
        """Return the arrays of all ranks (count, ...) on one rank, and None on the others; all have the same shape."""
        mine = _to_vtk(values)
        everyones = mine.NewInstance()
        self.controller.Gather(mine, everyones, goal)
        if self.number != goal:
            self.sent += values.nbytes
            return None
        return vtk_to_numpy(everyones).reshape(self.count, *values.shape)

    def everyones(self, values: NDArray[Number]) -> NDArray[Number]:
        """Return the arrays of all ranks, which have the same shape. (count, ...)"""
        mine = _to_vtk(values)
        everyones = mine.NewInstance()
        self.controller.AllGather(mine, everyones)
        self.sent += values.nbytes * (self.count - 1)
        return vtk_to_numpy(everyones).reshape(self.count, *values.shape)

    def texts(self, text: str) -> list[str]:
        """Return the texts of all ranks."""
        content = np.frombuffer(text.encode(), np.uint8)
        longest = int(self.everyones(np.array([content.size], np.float64)).max())
        if not longest:
            return [""] * self.count
        padded = np.pad(content, (0, longest - content.size))
        return [row.tobytes().rstrip(b"\0").decode() for row in self.everyones(padded)]

    def together(self, work: Callable[[], Result]) -> Result:
        """Return the result of a rank's part of the work; if any fails, all raise BadInput, so that none waits."""
        trouble, result = "", None
        try:
            result = work()
        except BadInput as error:
            trouble = str(error)
        except MemoryError:
            trouble = f"Rank {self.number} does not have enough memory for its part: use more ranks, or fewer per node."
        except Exception as error:
            traceback.print_exc()
            trouble = f"Rank {self.number} failed ({type(error).__name__}: {error}); its messages are above."
        first = next(filter(None, self.texts(trouble)), "")
        if first:
            raise BadInput(first)
        return result  # type: ignore[return-value]

    def send_to_leader(self, values: NDArray[np.float32]) -> None:
        """Send an array to the leader, which calls :meth:`receive` with this rank's number."""
        self.controller.Send(_to_vtk(values), 0, BLOCK)
        self.sent += values.nbytes

    def receive(self, number: int) -> NDArray[np.float32]:
        """Return the array that a rank sends to the leader. (values,)"""
        array = _to_vtk(np.zeros(1, np.float32))
        self.controller.Receive(array, number, BLOCK)
        values: NDArray[np.float32] = vtk_to_numpy(array)
        return values

    def order(self, name: str, *arguments: object) -> None:
        """Send an order to all other ranks; only the leader does."""
        content = _to_vtk(np.frombuffer(pickle.dumps((name, arguments)), np.uint8))
        for number in range(1, self.count):
            self.controller.Send(content, number, ORDER)

    def next_order(self) -> tuple[str, tuple[object, ...]]:
        """Wait for the leader's next order; return its name and its arguments."""
        look = getattr(self.controller, "Iprobe", None)  # missing if Python met the controller before its class
        there, sender = [0], [0]
        while look is not None and not there[0]:
            look(0, ORDER, there, sender)
            if not there[0]:
                time.sleep(NAP)
        content = _to_vtk(np.zeros(1, np.uint8))
        self.controller.Receive(content, 0, ORDER)
        name, arguments = pickle.loads(vtk_to_numpy(content).tobytes())
        return name, arguments


def ranks_here() -> Ranks | None:
    """Return the ranks of this run; None if there is only one process."""
    controller = vtkMultiProcessController.GetGlobalController()
    return Ranks(controller) if controller is not None and controller.GetNumberOfProcesses() > 1 else None


def _to_vtk(values: NDArray[np.number]) -> vtkDataArray:
    return numpy_to_vtk(np.ascontiguousarray(values).ravel(), deep=True)
