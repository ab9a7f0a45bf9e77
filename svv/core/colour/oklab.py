"""Oklab, a space in which equal distances look about equal (Ottosson 2020), and recolouring in it.

RGB is gamma-encoded sRGB in [0, 1].
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torch import Tensor


TO_CONES = (
    (0.4122214708, 0.5363325363, 0.0514459929),
    (0.2119034982, 0.6806995451, 0.1073969566),
    (0.0883024619, 0.2817188376, 0.6299787005),
)
"""Linear sRGB to the responses of cones."""

TO_LAB = (
    (0.2104542553, 0.7936177850, -0.0040720468),
    (1.9779984951, -2.4285922050, 0.4505937099),
    (0.0259040371, 0.7827717662, -0.8086757660),
)
"""Cube roots of the responses to lightness, green-red and blue-yellow."""

FROM_LAB = (
    (1.0, 0.3963377774, 0.2158037573),
    (1.0, -0.1055613458, -0.0638541728),
    (1.0, -0.0894841775, -1.2914855480),
)
FROM_CONES = (
    (4.0767416621, -3.3077115913, 0.2309699292),
    (-1.2684380046, 2.6097574011, -0.3413193965),
    (-0.0041960863, -0.7034186147, 1.7076147010),
)
"""Their inverses."""


def rgb_to_oklab(rgb: Tensor) -> Tensor:
    """Return lightness in [0, 1] and two coordinates of colour; negative components are read as 0. (..., 3)"""
    import torch

    rgb = rgb.clamp(min=0.0)
    light = torch.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return (light @ rgb.new_tensor(TO_CONES).T) ** (1.0 / 3.0) @ rgb.new_tensor(TO_LAB).T


def oklab_to_rgb(lab: Tensor) -> Tensor:
    """Invert :func:`rgb_to_oklab`; the result may lie outside [0, 1]. (..., 3)"""
    import torch

    light = (lab @ lab.new_tensor(FROM_LAB).T) ** 3 @ lab.new_tensor(FROM_CONES).T
    return torch.where(light <= 0.0031308, 12.92 * light, 1.055 * light.clamp(min=1e-9) ** (1.0 / 2.4) - 0.055)


def shift_in_oklab(colours: Tensor, palette: Tensor, target: Tensor) -> Tensor:
    """Recolour samples (..., P, 3) by the Oklab difference of two palettes (P, 3).

    How light and dark differ stays as it looked. :func:`svv.core.colour.colour.shift_colours` does the same by hue,
    saturation and brightness, in which a blue and a yellow of the same brightness do not look equally light. Samples
    are in [0, 1] where their palette colour was edited.
    """
    import torch

    shifted = oklab_to_rgb(rgb_to_oklab(colours) + rgb_to_oklab(target) - rgb_to_oklab(palette)).clamp(0.0, 1.0)
    edited = (palette != target).any(-1, keepdim=True)
    return torch.where(edited, shifted, colours)
