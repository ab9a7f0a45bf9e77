"""Settings of the training stages, and the presets that combine them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar, get_origin

from svv.errors import BadInput
from svv.fields.radiance.networks import ENCODINGS, FieldSettings
from svv.fields.radiance.occupancy import PRUNED
from svv.options.described import Described, described
from svv.options.making import LIGHTINGS, PaintOptions, PaletteOptions, TrainOptions


@dataclass(frozen=True)
class FitSettings:
    """Settings of a stage that fits a field to the pixels of the views."""

    iterations: int
    """Number of optimiser steps."""
    rays: int = 4096
    """Maximum rays per step; as few as a quarter are drawn, to stay within ``samples``."""
    samples: int = 32768
    """Target number of visible samples per step: opaque scenes have few along a ray, translucent ones many."""
    doublings: int = 2
    """Number of times that rays and samples double until ``hold``; those above are the numbers in the end."""
    feature_rate: float = 0.02
    """Learning rate of the features."""
    network_rate: float = 0.005
    """Learning rate of the networks."""
    muon: bool = True
    """Whether hidden layers take orthogonalized steps (Muon, Jordan et al. 2024) instead of Adam's."""
    decay: float = 0.0
    """Learning rates at the end, as a part of those at the start, to which they fall exponentially. 0: they fall
    linearly to nothing after ``hold``."""
    hold: float = 0.8
    """Fraction of the schedule during which learning rates that fall to nothing stay as they are."""
    by_contrast: float = 0.75
    """Fraction of the rays whose pixels are drawn by how much they differ from their neighbours, not evenly; they count
    less the more often they are drawn (:class:`svv.train.run.pixels.Pixels`)."""


@dataclass(frozen=True)
class ReconstructSettings(FitSettings):
    """Stage 1, the base radiance field."""

    iterations: int = 1200
    """Number of optimiser steps."""
    known_part: float = 0.8
    """Part of these steps that is taken if colours start from the volume, for then there is less to learn."""
    rays: int = 6144
    """Maximum rays per step; as few as a quarter are drawn, to stay within ``samples``."""
    samples: int = 49152
    """Target number of visible samples per step: opaque scenes have few along a ray, translucent ones many."""
    pixels_a_cell: float = 2.5
    """Minimum number of pixels that the finest cell of the features covers, if the lattice is fitted to the views: in a
    short training, too few rays see finer cells to train them. Half as many where a volume's normals turn within it."""
    most_cells: int = 256
    """Maximum number of such cells along the longest side."""
    most_vertices: int = 1 << 24
    """Maximum number of vertices of such cells where something is visible; where there are more, the finest level is
    left out."""
    refine_known: bool = False
    """Whether a density that starts from the volume or from a tomography becomes twice as fine, too."""
    density_rate: float = 0.3
    """Learning rate of the density lattice, in units of the log-extinction."""
    use_volume: bool = True
    """Whether the density is initialized from the classified volume, if the views include it."""
    tomography: bool = True
    """Whether the density of a lattice is otherwise initialized from the views' alpha by tomography."""
    known_density_rate: float = 0.03
    """Learning rate of a density that was initialized from the volume."""
    keep: float = 0.05
    """Fraction of the invisible samples that are trained nevertheless."""
    prune_every: int = 100
    """Number of steps between prunings of the occupancy."""
    prune_least: float = PRUNED
    """Optical depth per step below which a cell is pruned, where views alone tell the extinction."""
    cells: int = 128
    """Number of occupancy cells along the longest side."""


@dataclass(frozen=True)
class RecolourSettings(FitSettings):
    """Stage 2, the palette colour network."""

    iterations: int = 600
    """Number of optimiser steps."""
    doublings: int = 3
    """Number of times that rays and samples double until ``hold``; those above are the numbers in the end."""
    joined: float = 1.0 / 64.0
    """Weight in a pixel up to which samples are merged; 0 omits negligible samples instead."""
    palette_rate: float = 0.0005
    """Learning rate of the palette's colours."""
    offset_weight: float = 0.1
    """lambda_delta: weight of the composited squared offsets (StyleRF-VolVis, eq. 5)."""
    offset_start: float = 10.0
    """Initial factor on ``offset_weight``, which falls to 1 halfway: a palette colour that another one's offsets
    replace early never recovers, and its region is lost."""
    shade_weight: float = 0.003
    """Weight of (m - 1)^2, which keeps the material's brightness in the intensity I and the light's in the shade m."""
    mixing_weight: float = 0.01
    """Weight of 1 - sum w_i^2: each point belongs to one range of the transfer function, and an edit of one region
    must not bleed into another. If the volume determines the range, stage 2 asks for that instead."""


@dataclass(frozen=True)
class StylizeSettings:
    """Stage 3, the painting, as paint that is laid: strokes, pieces of pictures and ink."""

    style_views: int = 20
    """Number of views around the scene that determine where paint is visible."""
    style_size: int = 400
    """Width and height in pixels of a view for which pictures are scaled, and in which their contrast is solved."""


@dataclass(frozen=True)
class MatchSettings(StylizeSettings):
    """Stage 3 as in the paper: a network is distilled from the palette network and matched to the styles' features."""

    style_views: int = 42
    """Number of stylization views around the scene."""
    style_size: int = 400
    """Width and height of the stylization views in pixels."""
    style_iterations: int = 210
    """Number of stylization steps, one view each."""
    style_feature_rate: float = 0.02
    """Learning rate of the network's features in the stylization."""
    style_network_rate: float = 0.002
    """Learning rate of the network in the stylization."""
    distil_iterations: int = 474
    """Number of distillation steps (the paper: 624 of one view each; copying the table replaces 150 of them)."""
    distil_views: int = 312
    """Number of views from which the distillation draws rays."""
    distil_rays: int = 16384
    """Rays per distillation step."""
    feature_rate: float = 0.03
    """Learning rate of the features in the distillation."""
    network_rate: float = 0.005
    """Learning rate of the network in the distillation."""
    pixels_a_cell: float | None = 2.0
    """Largest number of stylization-view pixels that the finest cell of a lattice covers; None keeps the scene's
    levels. Where cells are coarser than a style's detail, paint alternates from cell to cell instead."""
    colour_transfer: bool = True
    """Whether each style's mean colour replaces its region's colour in the palette before the distillation."""


@dataclass(frozen=True)
class Preset:
    """Settings of all stages under one name."""

    name: str
    """Name of the preset."""
    field: FieldSettings
    """Shape of the networks."""
    reconstruct: ReconstructSettings
    """Settings of stage 1."""
    recolour: RecolourSettings
    """Settings of stage 2."""
    stylize: StylizeSettings = StylizeSettings()
    """Settings of stage 3: how paint is laid, or, if they are :class:`MatchSettings`, how features are matched."""
    lighting: str | None = None
    """Light of a scene that shows shading: ``network``, ``phong`` (:class:`svv.fields.radiance.phong.PhongLight`), or
    ``auto``: ``phong`` if held-out views allow it (:func:`svv.train.palette.lighting.light_by_trial`). None:
    ``network``, or ``auto`` if there are few views (:func:`svv.train.palette.lighting.light_for`)."""
    values: bool = False
    """Whether the scene is a function of the volume's values (:mod:`svv.train.base.from_values`)."""
    fitted: bool = True
    """Whether the lattice is fitted to the views' pixels (:func:`svv.train.base.resolutions.fitted_field`)."""
    all_samples: bool = False
    """Whether images take every sample, merged as in stage 2, instead of as few as show the same to the eye
    (:func:`svv.train.base.sampling.with_fewest_samples`)."""


PAPER_STAGES = (
    ReconstructSettings(iterations=30000, use_volume=False, tomography=False, feature_rate=0.01, network_rate=0.01,
                        decay=0.1, by_contrast=0.0, rays=4096, samples=32768, doublings=0, muon=False),
    RecolourSettings(2500, feature_rate=0.01, network_rate=0.01, decay=0.05, by_contrast=0.0, offset_start=1.0,
                     shade_weight=0.0, mixing_weight=0.0, joined=0.0, doublings=0, muon=False),
)  # fmt: skip
"""Stages 1 and 2 as in the paper."""

PRESETS = {
    "draft": Preset(
        "draft",
        FieldSettings(width=32),
        ReconstructSettings(iterations=300),
        RecolourSettings(iterations=220),
        StylizeSettings(style_views=12),
    ),
    "fast": Preset(
        "fast",
        FieldSettings(),
        ReconstructSettings(iterations=400, network_rate=0.01),
        RecolourSettings(iterations=280),
    ),
    "balanced": Preset("balanced", FieldSettings(), ReconstructSettings(), RecolourSettings()),
    "best": Preset(
        "best",
        FieldSettings(),
        ReconstructSettings(
            iterations=6000,
            known_part=1.0,
            pixels_a_cell=0.7,
            most_cells=512,
            most_vertices=8_000_000,
            refine_known=True,
        ),
        RecolourSettings(iterations=2400, joined=1.0 / 128.0),
        all_samples=True,
    ),
    "paper": Preset(
        "paper",
        FieldSettings("hash", (16, 4096), features=2, shading=False),
        *PAPER_STAGES,
        MatchSettings(),
        fitted=False,
    ),
}


HOMES = {"lattice": "balanced"}
"""Encoding -> the preset whose table and learning rates were tuned for it; others use those of ``paper``."""

VALUES = "values"
"""Encoding of scenes that are functions of their volume's values."""

VALUE_STEPS = 4
"""Part of stage 1 of a preset, one of so many, that such scenes need."""

VALUE_RATE = 0.05
"""Learning rate of their extinction, a table that all vertices share."""


def preset(name: str | Preset, encoding: str | None = None) -> Preset:
    """Return the preset ``draft``, ``fast``, ``balanced``, ``best`` or ``paper``; custom settings as they are.

    ``lattice`` or ``hash`` override its encoding: table and learning rates are then those of the encoding's home preset
    (:data:`HOMES`), schedule, widths and losses stay. ``values``: the lattice's, with a shorter schedule, because
    little is left to learn. Raises BadInput if the preset or the encoding does not exist.
    """
    if isinstance(name, Preset):
        return name
    if name not in PRESETS:
        raise BadInput(f"There is no preset '{name}'; choose one of {', '.join(PRESETS)}.")
    if encoding == VALUES:
        chosen = preset(name, "lattice")
        first, second, rate = chosen.reconstruct, chosen.recolour, FitSettings.network_rate
        steps = first.iterations // VALUE_STEPS
        return replace(
            chosen,
            reconstruct=replace(first, iterations=steps, network_rate=rate, known_density_rate=VALUE_RATE),
            recolour=replace(second, feature_rate=0.0),
            values=True,
        )
    chosen = PRESETS[name]
    if encoding is None or encoding == chosen.field.encoding:
        return chosen
    if encoding not in ENCODINGS:
        raise BadInput(f"There is no encoding '{encoding}'; choose one of {', '.join(ENCODINGS)}.")
    home = PRESETS[HOMES.get(encoding, "paper")]
    table = {"encoding": encoding, **{name: getattr(home.field, name) for name in ("resolutions", "features")}}
    rates = ("feature_rate", "network_rate", "decay", "hold", "by_contrast")
    return replace(
        chosen,
        field=replace(chosen.field, **table),
        reconstruct=replace(chosen.reconstruct, **{name: getattr(home.reconstruct, name) for name in rates}),
        recolour=replace(chosen.recolour, **{name: getattr(home.recolour, name) for name in rates}),
        fitted=home.fitted,
    )


def lit_by(chosen: Preset, lighting: str | None) -> Preset:
    """Return a preset with another kind of light (None: its own); raises BadInput if it cannot have that."""
    if lighting is None:
        return chosen
    if lighting not in LIGHTINGS:
        raise BadInput(f"There is no lighting '{lighting}'; choose one of {', '.join(LIGHTINGS)}.")
    if lighting != "network" and chosen.field.encoding != "lattice":
        raise BadInput(
            "An explicit light needs the lattice: leave out --lighting, or choose another preset or encoding."
        )
    return replace(chosen, lighting=lighting)


STAGES = ("field", "reconstruct", "recolour", "stylize")
"""Parts of a preset whose settings can be changed individually."""


def changed(chosen: Preset, changes: Sequence[str]) -> Preset:
    """Return a preset with settings changed, each written as ``stage.name=value``; raises BadInput if one cannot be."""
    for text in changes:
        key, sign, value = (word.strip() for word in text.partition("="))
        stage, _, name = key.partition(".")
        if not sign or stage not in STAGES:
            raise BadInput(
                f"'{text}' does not change a setting; write STAGE.NAME=VALUE with one of the stages "
                f"{', '.join(STAGES)}, for example reconstruct.iterations=4000."
            )
        settings = getattr(chosen, stage)
        known = {field.name: field for field in described(type(settings))}
        if name not in known:
            raise BadInput(f"There is no setting '{key}'; choose one of {', '.join(known)}.")
        chosen = replace(chosen, **{stage: replace(settings, **{name: _value(known[name], key, value)})})
    return chosen


def _value(setting: Described, key: str, text: str) -> object:
    """Parse the value of a setting; raises BadInput if it has the wrong type."""
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
        needed = kinds.get(setting.kind, "whole numbers with spaces between them")
        raise BadInput(f"{key} needs {needed}, not '{text}'.") from None


def settings_of(options: TrainOptions | PaletteOptions | PaintOptions, own: Preset | None = None) -> Preset:
    """Return the settings of all stages for some options, based on the user's ``own`` settings or on their preset.

    Raises BadInput if an option or a setting does not exist, or an option has no effect with this preset.
    """
    training = options if isinstance(options, TrainOptions) else TrainOptions(preset=options.preset)
    chosen = lit_by(preset(own or options.preset, training.encoding), training.lighting)
    if isinstance(options, PaletteOptions):
        return chosen
    chosen = changed(chosen, options.change)
    if isinstance(options, PaintOptions):
        _check_used(options, chosen)
    return chosen


def _check_used(options: PaintOptions, chosen: Preset) -> None:
    """Raise BadInput if an option for laid paint is given where features are matched, or the other way round."""
    matched = isinstance(chosen.stylize, MatchSettings)
    if options.features != "auto" and not matched:
        raise BadInput(
            f"The preset '{chosen.name}' matches no features: leave out --features, or paint with --preset paper."
        )
    for name in ("manner", "hand"):
        if getattr(options, name) != "auto" and matched:
            raise BadInput(
                f"The preset '{chosen.name}' matches features and lays neither strokes nor pieces: leave out --{name}, "
                "or choose another preset."
            )


Options = TypeVar("Options", TrainOptions, PaletteOptions, PaintOptions)


def given(
    kind: type[Options], options: Options | Preset | str, changes: Mapping[str, object]
) -> tuple[Options, Preset]:
    """Return the options of a class passed to a function of the Python interface, and the settings of its stages.

    They are options, the name of a preset or custom settings, of which ``changes`` changes fields by name. Raises
    BadInput as :func:`settings_of`, and TypeError if a field does not exist.
    """
    own = options if isinstance(options, Preset) else None
    base: Any = options if isinstance(options, kind) else kind() if own else kind(preset=options)  # type: ignore[arg-type]
    asked: Options = replace(base, **changes)
    return asked, settings_of(asked, own)
