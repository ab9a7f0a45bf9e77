"""Filters that tell ParaView's client the bounds of their scene, which its table and images do not have."""

from __future__ import annotations

from svv.errors import BadInput
from svv.pv.work.base import Filter
from svv.pv.work.vtk_data import bounds_of_scene


class Bounded(Filter):
    """A filter of a scene, which surfaces with handles cut open (:mod:`svv.pv.client.placed_shapes`)."""

    def GetSceneBounds(self) -> str:
        """Return the lowest and the highest corner of the input's scene, six numbers; empty as long as it has none."""
        try:
            bounds = bounds_of_scene(self.GetInputDataObject(0, 0))
        except BadInput:  # the work reports it
            bounds = None
        return "" if bounds is None else " ".join(repr(float(value)) for value in bounds.ravel())
