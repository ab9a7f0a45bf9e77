"""The filter StyleRF Figure: a scene with its legend, scale bar and axes as one image, and as a file for a paper."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from paraview.util.vtkAlgorithm import smproxy
from vtkmodules.vtkCommonDataModel import vtkDataObject

from svv.errors import BadInput, Cancelled
from svv.options.figures import FigureOptions
from svv.pv.panel.groups import keep_input_visible, menu, seen_with, takes_scene
from svv.pv.panel.option_panel import properties_of
from svv.pv.panel.properties import button, file, number, numbers, panel, status, switch
from svv.pv.vtk_types import Data, InInfo, OutInfo, Request
from svv.pv.work.base import Filter, set_image_information
from svv.pv.work.vtk_data import finished_scene_of, key_of_scene, put_image

__all__ = ["StyleRFFigure"]


@smproxy.filter(label="StyleRF Figure", support_reload=False)
@menu
@keep_input_visible
@panel(
    *properties_of(FigureOptions()),
    switch("VolumeRendering", False, "Also show the volume rendering before it; the palette network if the volume is "
                                     "not there.", advanced=True),
    file("VolumeFile", "vti mhd mha nrrd nhdr nii gz raw npy tif tiff h5 nc vtk vtu pvti", "Volumes", "The file of the "
         "scene's volume, for the panel above. The macro StyleRF figure, imported from plugin/macros, names that of "
         "the pipeline.", advanced=True),
    switch("Background", False, "Give the figure a background; otherwise it is white."),
    numbers("BackgroundColour", (1.0, 1.0, 1.0), "Colour of the background.", "color_selector"),
    seen_with(),
    numbers("Camera", (0.0,) * 9 + (30.0,), "Position, focal point and view-up vector (x, y, z each), and angle of "
            "view in degrees; all zeros: from the front. The macro StyleRF figure, imported from plugin/macros, uses "
            "the active view's.", None, True),
    number("ParallelScale", 0.0, "Half of the height in world units, with parallel rays; 0 for perspective.", 0.0, None,
           True),
    file("FigureFile", "pdf svg png tiff", "Figures", "File to which Save Figure writes the figure.", save=True),
    button("SaveFigure", "Write the figure to the file above; in PDF and SVG, text stays text."),
    status(),
)  # fmt: skip
@takes_scene
class StyleRFFigure(Filter):
    """Make a figure of a scene for a paper, with a legend, a scale bar and axes, in the width of a journal's column.
    StyleRF Edit names regions.
    """

    ports = (1, 1, "vtkImageData")

    def RequestInformation(self, request: Request, in_info: InInfo, out_info: OutInfo) -> int:
        """Announce the figure's size, which is known when it is drawn."""
        connection = self.GetInputConnection(0, 0)
        connection.GetProducer().Update(connection.GetIndex())
        height, width = 1, 1
        try:
            if self.first_rank:
                height, width = self._drawn(vtkDataObject.GetData(in_info[0], 0))[0].shape[:2]
        except (BadInput, Cancelled, ImportError):  # RequestData reports it
            pass
        set_image_information(self, out_info, width, height)
        return 1

    def work(self, inputs: list[Data], outputs: list[Data], out_info: OutInfo) -> str:
        from svv.pv.work.engine import as_seen_with

        pixels, said = self._drawn(inputs[0])
        put_image(outputs[0], {"RGBA": as_seen_with(pixels, self.values["SeenWith"])})
        return f"{pixels.shape[1]} x {pixels.shape[0]} pixels. {said}".rstrip()

    def SaveFigure(self) -> None:
        """Write the figure to a file."""
        from svv.pv.filters.figures import write

        self.save("scene", "FigureFile", lambda file: write(self.last("scene"), self.values, file, self.progress))

    def _drawn(self, data: Data) -> tuple[NDArray[np.uint8], str]:
        """Return the figure as straight RGBA (height, width, 4) and what to know of it, drawn once for each panel."""
        from svv.pv.filters.figures import pixels_of

        scene = finished_scene_of(data)
        self.get_or_make("scene", object(), lambda: scene)
        looks = {name: value for name, value in self.values.items() if name not in ("SeenWith", "FigureFile")}
        return self.get_or_make(
            "figure", (key_of_scene(data), repr(looks)), lambda: pixels_of(scene, self.values, self.progress)
        )
