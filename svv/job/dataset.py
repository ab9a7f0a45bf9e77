"""Scenes in PyVista: ``pyvista.read("scene.svv")`` and the accessor ``.svv`` of what it returns.

PyVista (0.48 and newer) finds both by the entry points in ``pyproject.toml``. A scene becomes an image of cells with
its regions and opacities, which shows where things are; the scene itself travels along as field data.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyvista
from PIL import Image

from svv.errors import BadInput, Progress, silent
from svv.fields.scene.scene import Scene
from svv.fields.scene.splitting import regions_in_cells
from svv.render.show import show, widget

if TYPE_CHECKING:
    from svv.render.web.notebook import SceneWidget

SCENE = "StyleRF Scene"
"""Name of the field data that holds a scene's file, as in ParaView's tables."""

Colour = str | Sequence[float]


def read_dataset(path: str | Path, **_: object) -> pyvista.ImageData:
    """Read a scene file as PyVista's reader of ``.svv``; raises BadInput if it is missing, damaged, or not a scene."""
    return dataset_of(Scene.load(path))


def dataset_of(scene: Scene) -> pyvista.ImageData:
    """Return a scene as an image of cells in world coordinates, with the scene as field data.

    Cell data are ``Opacity``, of a ray through the cell, with the regions' edits, in [0, 1] (the active scalars), and
    ``Region`` int16, -1 where nothing was found.
    """
    cells, region, opacity = regions_in_cells(scene)
    box = scene.occupancy.box
    grid = pyvista.ImageData(
        dimensions=[n + 1 for n in region.shape], spacing=(box.size / cells,) * 3, origin=tuple(box.low)
    )
    grid.cell_data["Region"] = region.ravel(order="F")
    grid.cell_data["Opacity"] = opacity.ravel(order="F")
    grid.set_active_scalars("Opacity", preference="cell")
    grid.field_data[SCENE] = np.frombuffer(scene.to_bytes(), np.uint8)
    return grid


@pyvista.register_dataset_accessor("svv", pyvista.ImageData)
class SceneAccessor:
    """Scene of a dataset: edits that return a new dataset, paintings, and pictures by svv's renderer."""

    def __init__(self, dataset: pyvista.ImageData) -> None:
        self._dataset = dataset
        self._scene: Scene | None = None

    @property
    def scene(self) -> Scene:
        """The scene, for everything else that svv offers; raises BadInput if the dataset was not read from a scene."""
        if self._scene is None:
            if SCENE not in self._dataset.field_data:
                raise BadInput("This dataset holds no scene: read one with pyvista.read('scene.svv').")
            content = np.asarray(self._dataset.field_data[SCENE], np.uint8).tobytes()
            self._scene = Scene.from_bytes(content, "The scene in the dataset")
        return self._scene

    def edited(self, change: Callable[[Scene], Scene]) -> pyvista.ImageData:
        """Return the dataset after any change of its scene, such as ``lambda scene: scene.hidden(0)``."""
        return dataset_of(change(self.scene))

    def recolour(self, region: int, colour: Colour) -> pyvista.ImageData:
        """Return the dataset with another colour of a region, whose number is that in the cell data ``Region``.

        A colour is as PyVista takes it: '#1a8c5a', 'orange', or RGB in [0, 1]. Raises BadInput if there is no such
        region or colour, or the region is painted.
        """
        try:
            rgb = pyvista.Color(colour).float_rgb
        except (ValueError, TypeError) as error:
            raise BadInput(f"'{colour}' is not a colour; write it as '#rrggbb', for example '#ff8800'.") from error
        return self.edited(lambda scene: scene.edited(region, colour=rgb))

    def restyle(self, *styles: str | Path, progress: Progress = silent, **options: Any) -> pyvista.ImageData:
        """Return the dataset with its regions painted in turn in these styles: files, ``gallery:NAME``, ``ink:NAME``.

        ``options`` are other arguments of :func:`svv.stylize_scene`, such as the fields ``preset="fast"`` or
        ``keep=(1,)`` of :class:`svv.PaintOptions`; the reasons of BadInput are its own, too.
        """
        from svv.train.paint.ink import StyleInput, style_named
        from svv.train.pipeline import stylize_scene

        given = [StyleInput(style, name) for name, style in map(style_named, styles)]
        return self.edited(lambda scene: stylize_scene(scene, given, progress=progress, **options)[0])

    def plot(self, **options: Any) -> Image.Image | None:
        """Show the scene in a window, or below a notebook's cell; see :func:`svv.show` for options and result."""
        return show(self.scene, **options)

    def widget(self, **options: Any) -> SceneWidget:
        """Return a notebook's widget in which the scene is turned and edited; see :func:`svv.widget` for options."""
        return widget(self.scene, **options)
