"""Equation 4 of StyleRF-VolVis: the colour of a sample from the output of the palette network and the light.

c = c_s + m I sum_i w_i (P_i + delta_i); the shade m, and the effect of edits and paint on the light, are additions to
the paper. Plain torch with gradients, which kernels without (:class:`svv.kernels.types.ImageKernels`) must match.
Letters: S samples, P palette colours.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import softplus

WEIGHT_FLOOR = 0.05
"""Added to the palette weights before they are normalised, so that every colour keeps learning."""

INTENSITY_SHIFT = 0.55
"""Shift of the intensity: softplus(0.55) is about 1, so untrained materials are as bright as the palette."""

SPECULAR_SHIFT = -3.0
"""Shift of the specular: softplus(-3) is about 0.05, so an untrained network has hardly any highlights."""


def material(raw: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Return intensity I >= 0 (S,), palette weights w > 0 with sum 1 (S, P) and offsets delta (S, P, 3).

    ``raw``: output of the palette MLP for each sample. (S, 1 + 4 P)
    """
    count = (raw.shape[1] - 1) // 4
    weights = softplus(raw[:, 1 : 1 + count]) + WEIGHT_FLOOR
    intensity = softplus(raw[:, 0] + INTENSITY_SHIFT)
    return intensity, weights / weights.sum(1, keepdim=True), raw[:, 1 + count :].view(-1, count, 3)


def diffuse(intensity: Tensor, weights: Tensor, colours: Tensor) -> Tensor:
    """Return the diffuse colour I sum_i w_i c_i, RGB, not clipped (StyleRF-VolVis, eq. 4, without light). (S, 3)

    ``intensity`` (S,) and ``weights`` (S, P) are those of :func:`material`; ``colours`` c_i = P_i + delta_i (S, P, 3).
    """
    return intensity[:, None] * (weights[:, :, None] * colours).sum(dim=1)


def network_light(raw: Tensor) -> tuple[Tensor, Tensor]:
    """Return specular grey c_s >= 0 and shade m in (0, 2), (S,) each, from the output of the lighting MLP.

    ``raw``: (S, 2), or (S, 1) of a network without shade, for which m is 1.
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
    """Light a diffuse colour c_d (S, 3): max(1 + f (a m - 1), 0) c_d + f (c_s - b), RGB, not clipped. (S, 3)

    With f = 1, a = 1 and b = 0 this is equation 4. ``specular`` c_s, ``shade`` m; ``factor`` f, ``scale`` a (None for 1
    saves a GPU operation) and ``less`` b are defined by :func:`svv.fields.scene.paint_light.lights_of`, all (S,).
    """
    shade = shade if scale is None else scale * shade
    specular = specular if less is None else specular - less
    factor_of_diffuse = (1.0 + factor * (shade - 1.0)).clamp(min=0.0)
    return colour * factor_of_diffuse[:, None] + (factor * specular)[:, None]
