"""Other opacities of the transfer function of a scene, without views and without training."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.core.interval_text import interval_text
from svv.core.rays.extinction import EMPTY_LOG_EXTINCTION
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.errors import BadInput
from svv.fields.following.followed_scene import at_step, check_follows
from svv.fields.radiance.networks import UnrestrictedField
from svv.fields.radiance.of_values import SLOPES, VALUES, colours_of
from svv.fields.scene.scene import Scene
from svv.job.volume_opacities import adapted, with_opacities_of
from svv.train.base.extinction_table import mean_extinction

KNOWN = 4097
"""Values at which functions are compared."""

LEAST, OTHER = 2e-3, 0.03
"""Opacity from which a value counts as visible, and difference of colours, in [0, 1], from which they are others."""

UNLEARNED, SHOWN = 0.3, 0.05
"""Difference of a learned colour to the transfer function's, in [0, 1], from which it was never seen, and the opacity
from which that matters: the colours of faint values are less exact in any case."""


def with_opacities(scene: Scene, function: TransferFunction, volume: vtkImageData | None = None) -> Scene:
    """Return a scene as another transfer function's opacities show it, with its palette, edits, paint and time steps.

    The extinction that training found is multiplied by the ratio of the classified extinctions, from which it started
    (:class:`svv.train.base.extinction_table.ExtinctionTable`): for each value and slope in a scene of the encoding
    ``values``, and otherwise at each vertex, from the ``volume`` on which it was trained. What is then shown only
    approximately is told in ``made["approximate"]``. A scene whose opacities are the same is returned itself.

    Raises BadInput if the scene is not one of these, or was trained on another volume; or if the function, at values of
    the data, has other colours, or shows values of which the scene never saw a colour.
    """
    scene.check_alone("Changing opacities")
    told = scene.made.get("source", {}).get("tf")
    if scene.values is None and volume is None:
        raise BadInput("The scene does not know its volume's values: name its volume, or train it on that with "
                       "--encoding values.")  # fmt: skip
    if told is None:
        raise BadInput("The scene does not record its transfer function: train it again.")
    if not function.placed:
        raise BadInput(f"'{function.name}' has no opacity points: export it from ParaView with its opacities.")
    before = TransferFunction.from_dict(told)
    if before.unit_distance is None:
        raise BadInput("The scene does not record the unit distance of its opacities: train it again.")
    function = replace(function, unit_distance=unit_for(function, before.unit_distance, volume))
    low, high = before.range
    _check_colours(before, function, np.linspace(low, high, KNOWN))
    if _is_same(before, function):
        return scene
    if scene.values is None and volume is not None:
        result = with_opacities_of(scene, before, function, volume)
    else:
        result = _with_opacities(scene, before, function)
    made = {**result.made, "source": {**scene.made["source"], "tf": function.to_dict()}}
    return replace(result, made=made, expected=None)  # errors are those of the opacities that it was trained with


def unit_for(function: TransferFunction, before: float, volume: vtkImageData | None) -> float:
    """Return the unit distance of a function's opacities, world units: its own, or the one before.

    Raises BadInput if it counts by the size of a volume that is not given.
    """
    if function.unit_distance is None and function.slabs is not None:
        if volume is None:
            raise BadInput(f"'{function.name}' counts opacities by the volume's size: name the volume, too.")
        from svv.dvr.read.grids import level_of_image

        return function.unit_in(level_of_image(volume))
    return function.unit_distance or before


def _is_same(before: TransferFunction, function: TransferFunction) -> bool:
    """Return whether two functions have the same opacities."""
    low, high = (pick(before.range[k], function.range[k]) for k, pick in enumerate((min, max)))
    at = np.linspace(low, high, KNOWN)
    same = np.array_equal(before.opacity_at(at), function.opacity_at(at))
    return same and before.unit_distance == function.unit_distance


def _with_opacities(scene: Scene, before: TransferFunction, function: TransferFunction) -> Scene:
    """Return a scene of the encoding ``values`` with another function than the one ``before``."""
    values, _ = check_follows(scene)
    steps = scene.steps
    if steps is None or before.unit_distance is None or function.unit_distance is None:
        raise BadInput("The scene was made before scenes kept their values: train it again.")
    low, high = values.interval
    at = np.linspace(low, high, KNOWN)
    _check(before, function, at)
    _check_learned(scene, before, function)
    old = _classified(before, at, before.unit_distance / values.size)
    new = _classified(function, at, function.unit_distance / values.size)
    table = adapted(values.table.cpu().numpy().reshape(VALUES, SLOPES), old, new)
    changed = replace(values, table=torch.from_numpy(table.ravel()).to(values.table))
    result = at_step(replace(scene, values=changed), steps.own, anew=True)
    for mine, its in zip(_paintings(result), _paintings(scene), strict=True):
        if mine.brushed is not None and its.brushed is not None:
            mine.brushed.lives = its.brushed.lives
            mine.painted_in = its.painted_in
    return replace(result, steps=steps, made=scene.made)  # it is the volume of its training


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
    _check_colours(before, function, at)


def _check_colours(before: TransferFunction, function: TransferFunction, at: NDArray[np.float64]) -> None:
    """Raise BadInput if a function has other colours than before, at values that both show."""
    both = at[(function.opacity_at(at) > LEAST) & (before.opacity_at(at) > LEAST)]
    if len(both) and np.abs(function.colour_at(both) - before.colour_at(both)).max() > OTHER:
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
    """Return logarithms of mean extinctions around values (K,), for each slope. (VALUES, SLOPES)

    ``unit`` is the function's opacity unit distance in box units.
    """
    sigma = -np.log1p(-np.minimum(function.opacity_at(at), 1.0 - 1e-6)) / unit
    place = np.linspace(0.0, 1.0, len(at))
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (sigma[1:] + sigma[:-1]) * np.diff(place))])
    return np.log(np.maximum(mean_extinction(integral), np.exp(EMPTY_LOG_EXTINCTION)))


def _paintings(scene: Scene) -> list[UnrestrictedField]:
    return [n for n in (scene.styled, *(other.network for other in scene.others)) if n is not None]
