"""Filters that scripts and client code use; they are in no menu."""

from __future__ import annotations

from paraview.util.vtkAlgorithm import smproxy

from svv.pv.panel.groups import takes_volume
from svv.pv.panel.properties import display, number, panel, scalars
from svv.pv.vtk_types import Data, InInfo, OutInfo, Request
from svv.pv.work.base import Filter
from svv.pv.work.parallel import DividedInput, do_next_job
from svv.pv.work.volume_display import set_unit_distance

__all__ = ["StyleRFPieces", "StyleRFUnitDistance"]


@smproxy.filter(group="internal_filters", label="StyleRF Pieces", support_reload=False)
@panel(scalars())
@takes_volume
class StyleRFPieces(DividedInput):
    """Lend a script the ranks among which a volume is divided (svv.pv.work.parallel); it is in no menu."""

    def work(self, inputs: list[Data], outputs: list[Data], out_info: OutInfo) -> None:
        do_next_job(inputs[0])


@smproxy.filter(group="internal_filters", label="StyleRF Unit Distance", support_reload=False)
@panel(display(), number("Distance", 1.0, "Opacity unit distance of the fourth component, world units."))
class StyleRFUnitDistance(Filter):
    """Set a display's opacity unit distance where it is drawn, on a server too (svv.pv.work.volume_display)."""

    ports = (0, 1, "vtkTable")

    def __init__(self) -> None:
        import paraview.modules.vtkRemotingViews  # noqa: F401  (lets a server's Python know the class of displays)

        super().__init__()

    def RequestData(self, request: Request, in_info: InInfo, out_info: OutInfo) -> int:
        """Set it, on every rank."""
        set_unit_distance(self.values["Display"], self.values["Distance"])
        return 1
