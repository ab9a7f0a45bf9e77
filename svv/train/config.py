"""Settings of the stages and the presets made of them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar, get_origin

import numpy as np

from svv.core.box import Box
from svv.core.cameras import Camera
from svv.errors import BadInput
from svv.fields.networks import ENCODINGS, FieldSettings
from svv.options.described import Described, described
from svv.options.making import LIGHTINGS, PaintOptions, PaletteOptions, TrainOptions


@dataclass(frozen=True)
class ReconstructSettings:
    """Stage 1, the base radiance field."""

    iterations: int = 2500
    """Steps of the optimiser."""
    rays: int = 4096
    """Rays a step at most; down to a quarter as many are drawn, so as not to exceed ``samples``."""
    samples: int = 32768
    """Visible samples a step: opaque scenes have few on a ray, translucent ones many."""
    refine_at: float = 0.5
    """Part of the schedule after which step and density lattice become twice as fine; over 1 never."""
    density_rate: float = 0.3
    """Learning rate of the density lattice, in units of the extinction's exponent."""
    density_pull: float = 3e-8
    """Weight of half the squared values of the density lattice's finer levels in the loss; falls with the learning
    rates. Where the views hardly say anything, as in a faint shell, the coarse level speaks instead of noise."""
    use_volume: bool = True
    """Whether the density begins with what the volume says, where the views carry that."""
    colour_every: float = 1.0 / 16.0
    """Part of a pixel's weight for which one colour is looked up; the density learns from all samples."""
    known_density_rate: float = 0.05
    """Learning rate of a density that began so."""
    feature_rate: float = 0.02
    """Learning rate of the features."""
    network_rate: float = 0.005
    """Learning rate of the networks."""
    decay: float = 0.05
    """Learning rates at the end, as a part of those at the start."""
    alpha_weight: float = 1.0
    """Weight of the squared error of alpha beside that of colour."""
    initial_exponent: float = 2.0
    """Exponent of the extinction at the start: a fog in which every sample is seen."""
    keep: float = 0.05
    """Share of the invisible samples that learns all the same."""
    prune_every: int = 100
    """Steps between two prunings of the occupancy."""
    prune_least: float = 0.003
    """A cell in which a step's optical depth stays below this is dropped."""
    cells: int = 128
    """Cells of the occupancy along the longest side."""


@dataclass(frozen=True)
class RecolourSettings:
    """Stage 2, the palette colour network."""

    iterations: int = 1000
    """Steps of the optimiser."""
    rays: int = 4096
    """Rays a step at most; down to a quarter as many are drawn, so as not to exceed ``samples``."""
    samples: int = 32768
    """Visible samples a step."""
    joined: float = 1.0 / 64.0
    """Samples are joined until they weigh this much in a pixel, as in images; 0: those that weigh less are left out."""
    feature_rate: float = 0.02
    """Learning rate of the features."""
    network_rate: float = 0.005
    """Learning rate of the networks."""
    palette_rate: float = 0.0005
    """Learning rate of the palette's colours."""
    decay: float = 0.05
    """Learning rates at the end, as a part of those at the start."""
    offset_weight: float = 0.1
    """lambda_delta: weight of the composited squared offsets (StyleRF-VolVis, eq. 5)."""
    offset_start: float = 10.0
    """Factor on it at the start, which falls to 1 half way: a palette colour that another one's offsets stand in for
    early never comes back, and its region is lost."""
    palette_weight: float = 0.001
    """Weight of the palette's squared distance to where it started."""
    shade_weight: float = 0.003
    """Weight of (m - 1)^2, which keeps the material's brightness in I and the light's in m."""
    phong_shade_weight: float = 0.0003
    """The same of an explicit light, which can say less and so must say it more freely."""
    phong_rate: float = 0.03
    """Learning rate of an explicit light's coefficients."""
    mixing_weight: float = 0.01
    """Weight of 1 - sum w_i^2: each point belongs to one range of the transfer function, and an edit of one region
    must not bleed into another. Where the volume says which range that is, ``owner_weight`` counts instead."""
    owner_weight: float = 0.1
    """Weight of -ln w of a sample's own range, mean over the samples of each range and over the ranges; without
    a volume, for a palette made by hand or of more than three colours, of the cross entropy of their shares in a pixel,
    mean over the colours."""


@dataclass(frozen=True)
class StylizeSettings:
    """Stage 3, distillation and stylization."""

    distil_iterations: int = 300
    """Steps of the distillation (the paper: 624 of one view each, 150 of which a copy of the table replaces)."""
    distil_views: int = 312
    """Views whose rays the distillation draws."""
    distil_rays: int = 16384
    """Rays a step of the distillation."""
    feature_rate: float = 0.03
    """Learning rate of the features in the distillation."""
    network_rate: float = 0.005
    """Learning rate of the network in the distillation."""
    style_iterations: int = 84
    """Views that the stylization sees: 42, twice."""
    style_views: int = 42
    """Views around the scene."""
    style_size: int = 400
    """Side of their images in pixels."""
    style_feature_rate: float = 0.02
    """Learning rate of a network's features in the stylization."""
    style_network_rate: float = 0.002
    """Learning rate of the network in the stylization."""
    pixels_a_cell: float | None = 2.0
    """Pixels of those images that the finest cell of a colour network covers at most; None leaves it the levels of the
    scene. Where cells are coarser than a style's detail, paint answers it with an alternation from cell to cell."""
    direct: bool = True
    """Whether paint is a lattice of colours (:mod:`svv.train.painting`) where the scene's fields are lattices; else it
    is a network, distilled from the palette's."""
    colour_transfer: bool = True
    """Whether each style's mean colour replaces its region's in the palette that is distilled."""


@dataclass(frozen=True)
class Preset:
    """Settings of all stages under one name."""

    name: str
    field: FieldSettings
    reconstruct: ReconstructSettings
    recolour: RecolourSettings
    stylize: StylizeSettings = StylizeSettings()
    lighting: str = "network"
    """What a scene that shows light is lit by: ``network``, ``phong`` (:class:`svv.fields.phong.PhongLight`), or
    ``auto``: ``phong`` where held-out views allow it (:func:`svv.train.lighting.light_by_trial`)."""
    fitted: bool = True
    """Whether the lattice is fitted to the views' pixels (:func:`fitted_field`)."""


PRESETS = {
    "draft": Preset(
        "draft",
        FieldSettings(width=32),
        ReconstructSettings(iterations=500),
        RecolourSettings(iterations=250),
        StylizeSettings(distil_iterations=150, style_iterations=20, style_views=20),
    ),
    "fast": Preset(
        "fast",
        FieldSettings(),
        ReconstructSettings(iterations=1000),
        RecolourSettings(iterations=400),
        StylizeSettings(distil_iterations=200, style_iterations=42),
    ),
    "balanced": Preset("balanced", FieldSettings(), ReconstructSettings(), RecolourSettings()),
    "paper": Preset(
        "paper",
        FieldSettings("hash", (16, 4096), features=2, shading=False),
        ReconstructSettings(iterations=30000, use_volume=False, feature_rate=0.01, network_rate=0.01, decay=0.1),
        RecolourSettings(
            2500,
            feature_rate=0.01,
            network_rate=0.01,
            offset_start=1.0,
            shade_weight=0.0,
            mixing_weight=0.0,
            joined=0.0,
        ),
        StylizeSettings(distil_iterations=474, style_iterations=210, direct=False),
        fitted=False,
    ),
}


HOMES = {"lattice": "balanced"}
"""Encoding -> the preset whose table and learning rates were found for it; of others, the paper's."""


def preset(name: str | Preset, encoding: str | None = None) -> Preset:
    """The preset of that name.

    Args:
        name: ``draft``, ``fast``, ``balanced`` or ``paper``; settings of one's own are given back.
        encoding: ``lattice`` or ``hash``, to replace the preset's own: table and learning rates are then those of the
            encoding's home (:data:`HOMES`); schedule, widths and losses stay the preset's.

    Raises:
        BadInput: any other name or encoding.
    """
    if isinstance(name, Preset):
        return name
    if name not in PRESETS:
        raise BadInput(f"There is no preset '{name}'; choose one of {', '.join(PRESETS)}.")
    chosen = PRESETS[name]
    if encoding is None or encoding == chosen.field.encoding:
        return chosen
    if encoding not in ENCODINGS:
        raise BadInput(f"There is no encoding '{encoding}'; choose one of {', '.join(ENCODINGS)}.")
    home = PRESETS[HOMES.get(encoding, "paper")]
    table = {"encoding": encoding, **{name: getattr(home.field, name) for name in ("resolutions", "features")}}
    rates = ("feature_rate", "network_rate", "decay")
    return replace(
        chosen,
        field=replace(chosen.field, **table),
        reconstruct=replace(chosen.reconstruct, **{name: getattr(home.reconstruct, name) for name in rates}),
        recolour=replace(chosen.recolour, **{name: getattr(home.recolour, name) for name in rates}),
        fitted=home.fitted,
    )


def lit_by(chosen: Preset, lighting: str) -> Preset:
    """A preset with another kind of light; ``network`` leaves it the preset's own.

    Raises:
        BadInput: there is no such kind, or it needs another encoding.
    """
    if lighting not in LIGHTINGS:
        raise BadInput(f"There is no lighting '{lighting}'; choose one of {', '.join(LIGHTINGS)}.")
    if lighting == "network":
        return chosen
    if chosen.field.encoding != "lattice":
        raise BadInput("An explicit light needs the lattice: leave out --lighting, or take another preset or encoding.")
    return replace(chosen, lighting=lighting)


STAGES = ("field", "reconstruct", "recolour", "stylize")
"""Parts of a preset whose settings can be changed one by one."""


def changed(chosen: Preset, changes: Sequence[str]) -> Preset:
    """A preset with single settings changed, each written as ``stage.name=value``.

    Raises:
        BadInput: text of another form, a stage or setting that does not exist, or a value of another type.
    """
    for text in changes:
        key, sign, value = (word.strip() for word in text.partition("="))
        stage, _, name = key.partition(".")
        if not sign or stage not in STAGES:
            raise BadInput(
                f"'{text}' changes no setting; write STAGE.NAME=VALUE with one of the stages {', '.join(STAGES)}, for "
                "example reconstruct.iterations=4000."
            )
        settings = getattr(chosen, stage)
        known = {field.name: field for field in described(type(settings))}
        if name not in known:
            raise BadInput(f"There is no setting '{key}'; choose one of {', '.join(known)}.")
        chosen = replace(chosen, **{stage: replace(settings, **{name: _value(known[name], key, value)})})
    return chosen


def _value(setting: Described, key: str, text: str) -> Any:
    """The value of a setting that ``text`` is; raises BadInput where it is of another type."""
    try:
        if setting.optional and text == "none":
            return None
        if setting.kind is bool:
            return {"true": True, "false": False}[text.lower()]
        if setting.kind in (int, float):
            number = setting.kind(text)
            if not 0 <= number < math.inf:
                raise ValueError
            return number
        if get_origin(setting.kind) is tuple:
            return tuple(int(word) for word in text.split())
        return text
    except (KeyError, ValueError):
        kinds = {bool: "true or false", int: "a whole number of at least 0", float: "a number of at least 0"}
        needed = kinds.get(setting.kind, "whole numbers with spaces between")
        raise BadInput(f"{key} needs {needed}, not '{text}'.") from None


def settings_of(options: TrainOptions | PaletteOptions | PaintOptions, own: Preset | None = None) -> Preset:
    """All numbers of the stages that options ask for, of the user's ``own`` settings or of their preset.

    Raises:
        BadInput: an option or a setting that does not exist, or a light that needs another encoding.
    """
    training = options if isinstance(options, TrainOptions) else TrainOptions(preset=options.preset)
    chosen = lit_by(preset(own or options.preset, training.encoding), training.lighting)
    return chosen if isinstance(options, PaletteOptions) else changed(chosen, options.change)


Options = TypeVar("Options", TrainOptions, PaletteOptions, PaintOptions)


def given(kind: type[Options], options: Options | Preset | str, changes: Mapping[str, Any]) -> tuple[Options, Preset]:
    """The options that a function of the Python interface was given, and the numbers of its stages.

    Args:
        kind: Of options.
        options: These, or the name of a preset, or settings of the user's own.
        changes: Fields of the options, by name.

    Raises:
        BadInput: as :func:`settings_of`.
        TypeError: there is no such field.
    """
    own = options if isinstance(options, Preset) else None
    base: Any = options if isinstance(options, kind) else kind() if own else kind(preset=options)  # type: ignore[arg-type]
    asked: Options = replace(base, **changes)
    return asked, settings_of(asked, own)


PIXELS_A_CELL = 2.5
"""Pixels that the finest lattice cell covers at least: finer cells are seen by too few rays to learn."""


def paint_resolutions(field: FieldSettings, cell: float | None, most: int) -> tuple[int, ...]:
    """Levels of a lattice for paint: all that the scene's settings name, and finer ones as far as its views see them.

    Args:
        field: The scene's.
        cell: Side of the finest cells at most, in box units; None adds no level.
        most: Cells along the longest side that no level added exceeds: those of the scene's occupancy.
    """
    levels = field.resolutions + field.finer
    if field.encoding == "lattice" and cell is not None:
        while 1.0 / levels[-1] > cell and 2 * levels[-1] <= most:
            levels += (2 * levels[-1],)
    return levels


def fitted_field(
    field: FieldSettings, cameras: Sequence[Camera], box: Box, finest: int = 256
) -> tuple[FieldSettings, str]:
    """The lattice levels that the views can resolve, and the reason in a sentence.

    The finest level has cells of at least :data:`PIXELS_A_CELL` pixels where the box is seen; coarser levels halve
    down to 16 cells.
    """
    centre = box.bounds.mean(axis=0)
    distance = np.median([np.linalg.norm(c.camera_to_world[:3, 3] - centre) for c in cameras])
    pixel = float(distance / np.median([c.focal for c in cameras]) / box.size)
    best = 1.0 / (PIXELS_A_CELL * pixel)
    levels = [16]
    while levels[-1] * 2 <= min(best, finest):
        levels.append(levels[-1] * 2)
    reason = (
        f"a pixel covers 1/{1 / pixel:.0f} of the box, so the finest of {len(levels)} levels has {levels[-1]} cells: "
        f"{levels[-1] * 2} would be under {PIXELS_A_CELL:g} pixels a cell"
        if levels[-1] < finest
        else f"the finest of {len(levels)} levels has {finest} cells, the most this preset allows"
    )
    return FieldSettings(**{**field.to_json(), "resolutions": tuple(levels)}), reason  # type: ignore[arg-type]
