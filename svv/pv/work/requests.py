"""What the panels ask for, as requests (:class:`svv.job.request.Request`).

They are the same for a filter that works itself and for one whose work is done beside ParaView's window.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from vtkmodules.vtkCommonDataModel import vtkDataObject

from svv.errors import Progress
from svv.options.making import DeviceOptions, PaintOptions, PaletteOptions, TrainOptions, ViewOptions
from svv.pv.panel.option_panel import options_in
from svv.pv.panel_values import Values
from svv.pv.results.keys import digest_of_scene, key_of
from svv.pv.work.engine import draw_views, training_moment, volume_of
from svv.pv.work.style_masks import sources_of
from svv.pv.work.styling import styles_of
from svv.pv.work.vtk_data import time_of, views_of

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene
    from svv.io.views.viewset import ViewSet
    from svv.job.request import Paint, Request, Styles


NO_VIEWS = (
    "Training the regions again takes the views that the scene was trained on: connect StyleRF Views as the second "
    "input, or choose the transforms_train.json of the views under Views File."
)


def learning(data: vtkDataObject | None, values: Values) -> Request:
    """Return the request to learn a scene of a volume or its views, painted if the panel has pictures; or BadInput."""
    from svv.fields.devices.gpu import device_named
    from svv.io.files.atomic import check_writable
    from svv.job.request import Request
    from svv.train.run.config import settings_of

    options, now = options_in(TrainOptions, values), training_moment(data, values, None)
    settings_of(options)  # report errors before views are drawn
    device_named(options.device)
    file = Path(values["SceneFile"]) if values.get("SceneFile") else None
    if file is not None:
        check_writable(file)
    views = views_of(data)
    asked = replace(options_in(ViewOptions, values), test=0)
    noted = {"key": key_of(now), "look": now.look, "data": now.data, "time": time_of(data)}
    if views is not None:
        return Request(views, asked, options, file=file, noted=noted)
    image = volume_of(data, values)

    def draw(asked: ViewOptions, progress: Progress) -> ViewSet:
        return draw_views(image, values, asked, progress)[0]

    paint = _paint(values) if values.get("StyleFiles") else None
    return Request(draw, asked, options, paint=paint, device=options.device, file=file, noted=noted)


def painting(scene: Scene, values: Values, go_on: bool = False) -> Request:
    """Return the request to paint a scene with a palette network as the panel asks, or to go on with its painting."""
    from svv.job.request import Request

    return Request(scene, paint=_paint(values, go_on), device=options_in(DeviceOptions, values).device)


def correcting(scene: Scene, views: Callable[[Progress], ViewSet], values: Values) -> Request:
    """Return the request to correct a scene's palette as the panel asks; ``views`` reads those it learned from."""
    from svv.job.request import Correct, Request
    from svv.pv.work.editing import correction_in

    correct = Correct(correction_in(values), views, options_in(PaletteOptions, values))
    device = options_in(DeviceOptions, values).device
    return Request(scene, correct=correct, device=device, noted={"of": digest_of_scene(scene)})


def _paint(values: Values, go_on: bool = False) -> Paint:
    from svv.job.request import Paint

    variant = None if go_on else values.get("Variant") or None

    def styles(scene: Scene, progress: Progress) -> Styles:
        return styles_of(scene, values, progress)

    options = options_in(PaintOptions, values, go_on=go_on, variant=variant)
    preview = values.get("PreviewFile")
    return Paint(styles, options, tuple(sources_of(values)), Path(preview) if preview else None)
