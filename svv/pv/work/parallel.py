"""Filters on several ranks: the first one works, and the others draw their pieces of the volume when it needs views.

A volume stays divided (:mod:`svv.dvr.parallel.crew`). Scenes and images are on the first rank.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

from vtkmodules.vtkCommonDataModel import vtkDataObject

from svv.dvr.parallel.ranks import ranks_here
from svv.errors import BadInput
from svv.pv.paraview_types import Proxy
from svv.pv.vtk_types import InInfo, OutInfo, Request
from svv.pv.work.base import Filter

if TYPE_CHECKING:
    from svv.dvr.parallel.crew import Crew

Result = TypeVar("Result")

PIECES = "StyleRFPieces"
"""Name of the filter that lends a script its ranks."""

_crews: dict[str, Crew] = {}
"""Address of the leader's part of a volume -> the crew that has the whole."""

_jobs: list[Callable[[vtkDataObject], None]] = []
"""The work that the filter ``PIECES`` is to do next."""


def crew_of(data: vtkDataObject | None) -> Crew | None:
    """Return the ranks that have a volume, if the data is the first rank's part of it; otherwise None."""
    return None if data is None else _crews.get(data.__this__)


class DividedInput(Filter):
    """A filter that reads a volume in its first input, which may be divided among the ranks."""

    def RequestUpdateExtent(self, request: Request, in_info: InInfo, out_info: OutInfo) -> int:
        """Request this rank's part of a volume; of anything else, request the whole on the first rank."""
        ranks, whole = ranks_here(), self._extent_of_volume(in_info)
        info, executive = in_info[0].GetInformationObject(0), self.GetExecutive()
        if ranks is None or whole is None:
            if info is not None and not info.Has(executive.WHOLE_EXTENT()):
                info.Remove(executive.UPDATE_EXTENT())  # that of our image, which images in blocks would be asked for
            return super().RequestUpdateExtent(request, in_info, out_info)
        info.Set(executive.UPDATE_EXTENT(), ranks.part_of(whole), 6)
        info.Set(executive.UPDATE_PIECE_NUMBER(), ranks.number)
        info.Set(executive.UPDATE_NUMBER_OF_PIECES(), ranks.count)
        return 1

    def RequestData(self, request: Request, in_info: InInfo, out_info: OutInfo) -> int:
        """Do the work on the first rank; the others do what it orders until it is done."""
        ranks = ranks_here()
        if ranks is None or self._extent_of_volume(in_info) is None:
            return super().RequestData(request, in_info, out_info)
        from svv.dvr.parallel.crew import Crew

        data = vtkDataObject.GetData(in_info[0], 0)
        crew = Crew(ranks, data, self.values["Scalars"] or None, self.values.get("ScalarsOnCells", False))
        if ranks.number:
            crew.serve()
            return 1
        with crew:
            _crews[data.__this__] = crew
            try:
                return super().RequestData(request, in_info, out_info)
            finally:
                del _crews[data.__this__]

    def _extent_of_volume(self, in_info: InInfo) -> list[int] | None:
        """Return the extent of the whole input if it is a volume; None for images and all that has no extent."""
        info, key = in_info[0].GetInformationObject(0), self.GetExecutive().WHOLE_EXTENT()
        data = self.GetInputDataObject(0, 0)
        if data is not None and not data.IsA("vtkImageData"):
            return None
        if info is None or not info.Has(key):
            return None
        extent = [int(info.Get(key, i)) for i in range(6)]
        return extent if all(extent[2 * i + 1] > extent[2 * i] for i in range(3)) else None


def do_next_job(data: vtkDataObject) -> None:
    """Do the work for which :func:`on_all_ranks` has updated the filter ``PIECES``."""
    if _jobs:
        _jobs.pop()(data)


def on_all_ranks(source: Proxy, array: tuple[str, str], time: float, work: Callable[[vtkDataObject], Result]) -> Result:
    """Do work on the first rank while the others wait for orders, as in a filter.

    The source is updated at a time; ``array`` is POINTS or CELLS, and a name. The work is given the first rank's part
    of the volume, whose :func:`crew_of` is all ranks. Raises BadInput without the plugin, or if all ranks run the
    script.
    """
    from paraview.modules.vtkRemotingCore import vtkProcessModule
    from paraview.modules.vtkRemotingServerManager import vtkSMPropertyHelper, vtkSMProxyManager

    if vtkProcessModule.GetProcessModule().GetSymmetricMPIMode():
        raise BadInput("Start pvbatch without --symmetric: the first rank runs the script, and directs the others.")
    manager = vtkSMProxyManager.GetProxyManager().GetActiveSessionProxyManager()
    if manager.GetPrototypeProxy("internal_filters", PIECES) is None:
        raise BadInput("With several ranks, the plugin StyleRF is needed: start the script with `svv pvbatch`.")
    done: list[Result] = []
    failed: list[BaseException] = []

    def job(data: vtkDataObject) -> None:
        try:
            done.append(work(data))
        except BaseException as error:  # would not get past VTK
            failed.append(error)

    filter = manager.NewProxy("internal_filters", PIECES)
    vtkSMPropertyHelper(filter, "Input").Set(source.SMProxy, source.Port)
    vtkSMPropertyHelper(filter, "Scalars").Set(3, str(int(array[0] == "CELLS")))
    vtkSMPropertyHelper(filter, "Scalars").Set(4, array[1])
    filter.UpdateVTKObjects()
    _jobs.append(job)
    try:
        filter.UpdatePipeline(time)
    finally:
        _jobs.clear()
    if failed:
        raise failed[0]
    if not done:
        raise BadInput("ParaView could not update the volume on all ranks; its messages are above.")
    return done[0]
