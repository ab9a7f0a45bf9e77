"""Views of a volume that a crew of ranks draws; counterparts of the functions in :mod:`svv.dvr.draw.views`."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from svv.core.colour.shading import Shading
from svv.core.geometry.cameras import Camera
from svv.dvr.draw.record import grid_of
from svv.dvr.draw.views import Subject, drawn, open_caster, views_of
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.parallel.crew import Crew, CrewMapper
from svv.dvr.read.grids import level_of_image
from svv.errors import BadInput, Progress
from svv.io.views.viewset import ViewSet
from svv.options.making import ViewOptions


def make_crew_views(
    crew: Crew, tf: TransferFunction, options: ViewOptions, shading: Shading, name: str, progress: Progress
) -> tuple[ViewSet, ViewSet | None]:
    """Render the views of a distributed volume as ``make_views``, by the CPU's ray caster; only the leader calls it."""
    if options.mapper in ("gpu", "bricks"):
        raise BadInput("With several ranks, the CPU ray caster draws the views: set the ray caster to auto or cpu.")
    began, piece = time.monotonic(), crew.piece
    whole = level_of_image(piece.whole)
    fitted = tf.fitted(*piece.span, rescale=False)
    fitted = replace(fitted, unit_distance=tf.unit_in(whole))
    subject = Subject(
        crew.put_on_stage(fitted),
        grid_of(whole, str(piece.values.dtype), piece.span),
        whole,
        name,
        fitted,
        classify=crew.classify,
        caster=CrewMapper,
    )
    return views_of(subject, options, shading, began, progress)


def render_crew_views(
    crew: Crew, tf: TransferFunction, cameras: Sequence[Camera], shading: Shading, progress: Progress
) -> NDArray[np.uint8]:
    """Render a distributed volume from cameras; arguments and result as for :func:`svv.dvr.draw.views.render_views`."""
    tf = tf.fitted(*crew.piece.span, rescale=False)
    caster, _ = open_caster(crew.put_on_stage(tf), "cpu", shading, None, CrewMapper)
    return drawn(caster, cameras, progress)
