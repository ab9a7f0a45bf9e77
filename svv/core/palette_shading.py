"""Equation 4 of StyleRF-VolVis: the colour of a sample from what the palette network says of it, and from the light.

c = c_s + m I sum_i w_i (P_i + delta_i), where the shade m and what edits and paint make of the light are ours.

Plain torch, with gradients: what training and the images of every device use. The kernels that do the same for images
without gradients (:class:`svv.kernels.types.ImageKernels`) must match it.

Letters: S samples, P palette colours.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import softplus

WEIGHT_FLOOR = 0.05
"""Added to the palette weights before they are normalised, so that no colour is ever cut off from learning."""

INTENSITY_SHIFT = 0.55
"""softplus(0.55) is about 1: an untrained network's materials are as bright as the palette."""

SPECULAR_SHIFT = -3.0
"""softplus(-3) is about 0.05: an untrained network has hardly any highlights."""


def material(raw: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """What the palette MLP's output means.

    Args:
        raw: Its output for each sample. (S, 1 + 4 P)

    Returns:
        Intensity I >= 0 (S,), weights w > 0 whose sum is 1 (S, P), and offsets delta of the palette colours (S, P, 3).
    """
    count = (raw.shape[1] - 1) // 4
    weights = softplus(raw[:, 1 : 1 + count]) + WEIGHT_FLOOR
    intensity = softplus(raw[:, 0] + INTENSITY_SHIFT)
    return intensity, weights / weights.sum(1, keepdim=True), raw[:, 1 + count :].view(-1, count, 3)


def diffuse(intensity: Tensor, weights: Tensor, colours: Tensor) -> Tensor:
    """Diffuse colour I sum_i w_i c_i (StyleRF-VolVis, eq. 4, without light).

    Args:
        intensity: I, >= 0. (S,)
        weights: w, sum 1. (S, P)
        colours: Palette colours with their offsets, c_i = P_i + delta_i. (S, P, 3)

    Returns:
        RGB, not clipped. (S, 3)
    """
    return intensity[:, None] * (weights[:, :, None] * colours).sum(dim=1)


def network_light(raw: Tensor) -> tuple[Tensor, Tensor]:
    """What the lighting MLP's output means.

    Args:
        raw: Its output for each sample; one number where the network says no shade. (S, 1 or 2)

    Returns:
        Specular grey c_s >= 0 (S,) and shade m in (0, 2), 1 where the network says none (S,).
    """
    specular = softplus(raw[:, 0] + SPECULAR_SHIFT)
    return specular, 2.0 * torch.sigmoid(raw[:, 1]) if raw.shape[1] > 1 else torch.ones_like(specular)


def lit(
    colour: Tensor,
    specular: Tensor,
    shade: Tensor,
    factor: Tensor,
    scale: Tensor | None = None,
    less: Tensor | None = None,
) -> Tensor:
    """Diffuse colour under the light: max(1 + f (a m - 1), 0) c_d + f (c_s - b).

    For f = 1, a = 1 and b = 0 it is equation 4. What f, a and b are, :func:`svv.fields.paint_light.lights_of` says.

    Args:
        colour: Diffuse, c_d. (S, 3)
        specular: c_s. (S,)
        shade: m. (S,)
        factor: f, how much of the light is seen. (S,)
        scale: a, by default 1: a GPU then has fewer operations to start. (S,)
        less: b, by default 0. (S,)

    Returns:
        RGB, not clipped. (S, 3)
    """
    shade = shade if scale is None else scale * shade
    specular = specular if less is None else specular - less
    factor_of_diffuse = (1.0 + factor * (shade - 1.0)).clamp(min=0.0)
    return colour * factor_of_diffuse[:, None] + (factor * specular)[:, None]
