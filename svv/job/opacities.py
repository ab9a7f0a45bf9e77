"""Other opacities of the transfer function of a scene, without views and without training."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from svv.core.interval_text import interval_text
from svv.core.rays.extinction import EMPTY_LOG_EXTINCTION, MOST_LOG_EXTINCTION
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.errors import BadInput
from svv.fields.radiance.networks import UnrestrictedField
from svv.fields.scene.scene import Scene
from svv.fields.values.followed_scene import at_step, check_follows
from svv.fields.values.of_values import SLOPE_RANGE, SLOPES, VALUES, colours_of

KNOWN = 4097
"""Values at which functions are compared."""

LEAST, OTHER = 2e-3, 0.03
"""Opacity from which a value counts as visible, and difference of colours, in [0, 1], from which they are others."""

UNLEARNED, SHOWN = 0.3, 0.05
"""Difference of a learned colour to the transfer function's, in [0, 1], from which it was never seen, and the opacity
from which that matters: the colours of faint values are less exact in any case."""


def with_opacities(scene: Scene, function: TransferFunction) -> Scene:
    """Return a scene as its transfer function shows it with other opacities, with its palette, edits and paint.

    The extinction that training found for a value and slope is multiplied by the ratio of the classified extinctions
    (:class:`svv.train.base.extinction_table.ExtinctionTable` starts from these), so what training adapted is kept.

    Args:
        scene: A scene of the encoding ``values`` of one transfer function; its time steps stay.
        function: The function, at values of the data.

    Raises:
        BadInput: The scene is not one of these, the function has other colours, or shows values of which the scene
            never saw a colour.
    """
    scene.check_alone("Changing opacities")
    values, _ = check_follows(scene)
    told, steps = scene.made.get("source", {}).get("tf"), scene.steps
    if told is None or steps is None:
        raise BadInput("The scene does not record its transfer function and its values: train it again.")
    if not function.placed:
        raise BadInput(f"'{function.name}' has no opacity points: export it from ParaView with its opacities.")
    before = TransferFunction.from_dict(told)
    low, high = values.interval
    at = np.linspace(low, high, KNOWN)
    _check(before, function, at)
    _check_learned(scene, before, function)
    if before.unit_distance is None:
        raise BadInput("The scene does not record the unit distance of its opacities: train it again.")
    old = _classified(before, at, before.unit_distance / values.size)
    new = _classified(function, at, (function.unit_distance or before.unit_distance) / values.size)
    learned = values.table.cpu().numpy().reshape(VALUES, SLOPES)
    # Where nothing was visible, training had nothing to adapt.
    shown, now = old > EMPTY_LOG_EXTINCTION, new > EMPTY_LOG_EXTINCTION
    kept = np.where(shown, np.minimum(learned, EMPTY_LOG_EXTINCTION), learned)
    table = np.where(now, np.where(shown, learned + new - old, np.maximum(learned, new)), kept)
    table = np.minimum(table, MOST_LOG_EXTINCTION).astype(np.float32)
    changed = replace(values, table=torch.from_numpy(table.ravel()).to(values.table))
    made = {**scene.made, "source": {**scene.made["source"], "tf": function.to_dict()}}
    result = at_step(replace(scene, values=changed, made=made), steps.own, anew=True)
    for mine, its in zip(_paintings(result), _paintings(scene), strict=True):
        if mine.brushed is not None and its.brushed is not None:
            mine.brushed.lives = its.brushed.lives
            mine.painted_in = its.painted_in
    return replace(result, steps=steps)


def _check(before: TransferFunction, function: TransferFunction, at: NDArray[np.float64]) -> None:
    """Raise BadInput if a function shows values of which there is no colour, or in other colours."""
    seen = function.opacity_at(at) > LEAST
    if not seen.any():
        raise BadInput(f"'{function.name}' shows none of the scene's values, {interval_text(at[0], at[-1])}.")
    new = at[seen & (before.opacity_at(at) <= 0.0)]
    if len(new):
        raise BadInput(
            f"The scene was trained where values of {interval_text(new[0], new[-1])} were transparent, so it has no "
            "colour for them: train a scene with this function."
        )
    low, high = function.range
    outside = np.linspace(low, high, KNOWN)
    outside = outside[(function.opacity_at(outside) > LEAST) & ((outside < at[0]) | (outside > at[-1]))]
    if len(outside) and (before.opacity_at(outside) <= 0.0).any():
        raise BadInput(
            f"The function shows values of {interval_text(outside[0], outside[-1])}, which the scene does not know: "
            "train a scene with this function."
        )
    if np.abs(function.colour_at(at[seen]) - before.colour_at(at[seen])).max() > OTHER:
        raise BadInput(
            "The function has other colours than the scene's: only opacities can be changed so; svv edit --colour "
            "changes the colours of regions."
        )


@torch.no_grad()
def _check_learned(scene: Scene, before: TransferFunction, function: TransferFunction) -> None:
    """Raise BadInput if a function may uncover values whose colours the scene has not learned, as others hid them.

    Scenes that were trained since views tell the colours of values have learned all of them.
    """
    values, palette = check_follows(scene)
    share = torch.linspace(0.0, 1.0, VALUES)
    low, high = values.visible
    at = np.interp(low + (high - low) * share.numpy(), (0.0, 1.0), values.interval)
    opacity = function.opacity_at(at)
    if (opacity >= before.opacity_at(at) - LEAST).all():
        return  # nothing is uncovered
    own, light = (found.cpu().numpy() for found in colours_of(palette, share.to(scene.device)))
    wanted = function.colour_at(at)
    # Some of a scene's brightness may be in its light.
    off = np.minimum(*(np.abs(c.clip(0.0, 1.0) - wanted).max(axis=1) for c in (own, own * light)))
    wrong = at[(opacity > SHOWN) & (off > UNLEARNED)]
    if len(wrong):
        raise BadInput(
            f"Values of {interval_text(wrong[0], wrong[-1])} were hidden behind others when the scene was trained, so "
            "it has not learned their colours: train a scene with this function."
        )


def _classified(function: TransferFunction, at: NDArray[np.float64], unit: float) -> NDArray[np.float64]:
    """Return the logarithm of the mean extinction over values around a value, for each slope. (VALUES, SLOPES)

    Args:
        function: The function.
        at: Evenly spaced values. (K,)
        unit: Its opacity unit distance in box units.
    """
    sigma = -np.log1p(-np.minimum(function.opacity_at(at), 1.0 - 1e-6)) / unit
    place = np.linspace(0.0, 1.0, len(at))
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (sigma[1:] + sigma[:-1]) * np.diff(place))])
    value = np.linspace(0.0, 1.0, VALUES)[:, None]
    half = 0.5 * np.geomspace(*SLOPE_RANGE, SLOPES)[None]
    low, high = np.clip(value - half, 0.0, 1.0), np.clip(value + half, 0.0, 1.0)
    mean = (np.interp(high, place, integral) - np.interp(low, place, integral)) / (high - low)
    return np.log(np.maximum(mean, np.exp(EMPTY_LOG_EXTINCTION)))


def _paintings(scene: Scene) -> list[UnrestrictedField]:
    return [n for n in (scene.styled, *(other.network for other in scene.others)) if n is not None]
