"""Expressive volume visualization: radiance fields of direct volume renderings, edited and stylized by region.

The Python interface: scenes, the functions that train and paint them, and their inputs (docs/tutorials/python.md).
Each name is imported on first use.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from svv._version import __version__ as __version__
from svv.environment import share_cores, use_huge_pages
from svv.own_symbols import TRITON, prefer_own_symbols

if TYPE_CHECKING:
    from svv.core.colour.correction import Correction as Correction
    from svv.core.geometry.camera_path import camera_path as camera_path
    from svv.core.geometry.cameras import Camera as Camera
    from svv.core.geometry.cuts import Cut as Cut
    from svv.dvr.draw.views import make_views as make_views
    from svv.dvr.functions.transfer_functions import TransferFunction as TransferFunction
    from svv.errors import BadInput as BadInput
    from svv.errors import Cancelled as Cancelled
    from svv.fields.scene.region import Region as Region
    from svv.fields.scene.scene import Rendering as Rendering
    from svv.fields.scene.scene import Scene as Scene
    from svv.fields.splats.splats import Splats as Splats
    from svv.io.pictures.output import write_png as write_png
    from svv.io.pictures.style_picture import read_style as read_style
    from svv.io.shot_file import read_shot as read_shot
    from svv.io.shot_file import write_shot as write_shot
    from svv.io.views.camera_file import read_camera as read_camera
    from svv.io.views.camera_file import read_cameras as read_cameras
    from svv.io.views.viewset import ViewSet as ViewSet
    from svv.job.looks.look import Look as Look
    from svv.job.painting import paint as paint
    from svv.job.scene_training import train_scene as train_scene
    from svv.job.volume_panels import volume_panel as volume_panel
    from svv.job.words.say import say as say
    from svv.options.figures import FigureOptions as FigureOptions
    from svv.options.making import PaintOptions as PaintOptions
    from svv.options.making import PaletteOptions as PaletteOptions
    from svv.options.making import TrainOptions as TrainOptions
    from svv.options.making import ViewOptions as ViewOptions
    from svv.options.shots import Shot as Shot
    from svv.options.splats import SplatOptions as SplatOptions
    from svv.render.baking.baked import bake as bake
    from svv.render.figures.figure import Panel as Panel
    from svv.render.figures.figure import figure as figure
    from svv.render.frames import orbit as orbit
    from svv.render.frames import write_movie as write_movie
    from svv.render.shots.film import render_shot as render_shot
    from svv.render.show import image_data as image_data
    from svv.render.show import show as show
    from svv.render.show import widget as widget
    from svv.render.splats.files import read_splats as read_splats
    from svv.render.splats.files import write_splats as write_splats
    from svv.render.web.page import write_html as write_html
    from svv.train.correct import correct_palette as correct_palette
    from svv.train.paint.ink import Ink as Ink
    from svv.train.paint.ink import StyleInput as StyleInput
    from svv.train.pipeline import evaluate_scene as evaluate_scene
    from svv.train.pipeline import stylize_scene as stylize_scene
    from svv.train.run.learning import Learning as Learning
    from svv.train.splats.fit import fit_splats as fit_splats

PUBLIC = {
    name: module
    for module, names in {
        "svv.core.colour.correction": ("Correction",),
        "svv.core.geometry.camera_path": ("camera_path",),
        "svv.core.geometry.cameras": ("Camera",),
        "svv.core.geometry.cuts": ("Cut",),
        "svv.dvr.draw.views": ("make_views",),
        "svv.dvr.functions.transfer_functions": ("TransferFunction",),
        "svv.errors": ("BadInput", "Cancelled"),
        "svv.fields.scene.region": ("Region",),
        "svv.fields.scene.scene": ("Rendering", "Scene"),
        "svv.fields.splats.splats": ("Splats",),
        "svv.io.pictures.output": ("write_png",),
        "svv.io.pictures.style_picture": ("read_style",),
        "svv.io.shot_file": ("read_shot", "write_shot"),
        "svv.io.views.camera_file": ("read_camera", "read_cameras"),
        "svv.io.views.viewset": ("ViewSet",),
        "svv.job.looks.look": ("Look",),
        "svv.job.painting": ("paint",),
        "svv.job.scene_training": ("train_scene",),
        "svv.job.volume_panels": ("volume_panel",),
        "svv.job.words.say": ("say",),
        "svv.options.figures": ("FigureOptions",),
        "svv.options.making": ("PaintOptions", "PaletteOptions", "TrainOptions", "ViewOptions"),
        "svv.options.shots": ("Shot",),
        "svv.options.splats": ("SplatOptions",),
        "svv.render.baking.baked": ("bake",),
        "svv.render.figures.figure": ("Panel", "figure"),
        "svv.render.frames": ("orbit", "write_movie"),
        "svv.render.show": ("image_data", "show", "widget"),
        "svv.render.shots.film": ("render_shot",),
        "svv.render.splats.files": ("read_splats", "write_splats"),
        "svv.render.web.page": ("write_html",),
        "svv.train.correct": ("correct_palette",),
        "svv.train.paint.ink": ("Ink", "StyleInput"),
        "svv.train.pipeline": ("evaluate_scene", "stylize_scene"),
        "svv.train.run.learning": ("Learning",),
        "svv.train.splats.fit": ("fit_splats",),
    }.items()
    for name in names
}
"""Public name -> the module that defines it, imported on first access (PEP 562)."""

prefer_own_symbols(TRITON)
share_cores(os.environ)
use_huge_pages(os.environ)


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name not in PUBLIC:
        raise AttributeError(f"module 'svv' has no attribute '{name}'")
    value = globals()[name] = getattr(import_module(PUBLIC[name]), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *PUBLIC})
