"""Colours: conversion between RGB and HSB, circular hue, palette edits, hex codes, blending.

RGB is gamma-encoded sRGB as stored in an image, in [0, 1]. HSB (also called HSV) is hue, saturation and
brightness, all in [0, 1]; hue is a circle on which 0 and 1 are the same red.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from torch import Tensor

WHITE = (1.0, 1.0, 1.0)
"""Background over which images are compared and shown."""

LUMA = (0.2126, 0.7152, 0.0722)
"""Weights of red, green and blue in luminance or, of encoded values, in luma (ITU-R BT.709)."""

GREY_SATURATION = 0.02
"""Saturation below which a hue is noise, because eight bits cannot resolve it."""

AT_A_TIME = 1 << 14
"""Number of colours that are converted to or from CIELAB together."""

Hue = TypeVar("Hue", float, NDArray[np.float64], "Tensor")


def rgb_to_hsb(rgb: Tensor) -> Tensor:
    """Return hue in [0, 1), saturation in [0, 1] and brightness >= 0 of RGB (Smith 1978). (..., 3)

    Negative components are read as 0 and brightness may exceed 1, since offset palette colours leave the gamut. Grey
    has hue 0; black has saturation 0, too. Gradients are finite everywhere.
    """
    import torch

    rgb = rgb.clamp(min=0)
    red, green, blue = rgb.unbind(-1)
    value = rgb.amax(-1)
    chroma = value - rgb.amin(-1)
    tiny = torch.finfo(rgb.dtype).tiny
    divisor = torch.where(chroma > tiny, chroma, 1.0)
    sector = torch.where(
        value == red,
        (green - blue) / divisor,
        torch.where(value == green, 2 + (blue - red) / divisor, 4 + (red - green) / divisor),
    )
    hue = torch.remainder(sector / 6, 1.0)
    # remainder turns a hue that is a rounding error below 0 into exactly 1
    hue = torch.where((chroma > tiny) & (hue < 1), hue, 0.0)
    saturation = torch.where(value > tiny, chroma / torch.where(value > tiny, value, 1.0), 0.0)
    return torch.stack((hue, saturation, value), -1)


def hsb_to_rgb(hsb: Tensor) -> Tensor:
    """Convert HSB to RGB; a hue outside [0, 1) wraps around. (..., 3) -> (..., 3)."""
    import torch

    hue, saturation, value = hsb.unbind(-1)
    k = torch.remainder(torch.tensor([5.0, 3.0, 1.0]).to(hsb) + 6 * hue[..., None], 6.0)
    drop = torch.minimum(k, 4 - k).clamp(0, 1)
    return value[..., None] * (1 - saturation[..., None] * drop)


def hsb_array(rgb: NDArray[np.floating]) -> NDArray[np.float64]:
    """Apply :func:`rgb_to_hsb` to an array. (..., 3) -> (..., 3)."""
    import torch

    return np.asarray(rgb_to_hsb(torch.from_numpy(np.array(rgb, dtype=np.float64))).numpy())


def rgb_array(hsb: NDArray[np.floating]) -> NDArray[np.float64]:
    """Apply :func:`hsb_to_rgb` to an array. (..., 3) -> (..., 3)."""
    import torch

    return np.asarray(hsb_to_rgb(torch.from_numpy(np.array(hsb, dtype=np.float64))).numpy())


def hue_distance(a: Hue, b: Hue) -> Hue:
    """Return the distance of two hues along the shorter arc of the circle, in [0, 0.5]."""
    return abs((a - b + 0.5) % 1.0 - 0.5)


def shift_colours(colours: Tensor, palette: Tensor, target: Tensor) -> Tensor:
    """Recolour samples (..., P, 3) by the HSB difference of two palettes (P, 3) (StyleRF-VolVis, section PSE).

    hsb(target_i) - hsb(palette_i) is added to the HSB of the samples P_i + delta_i; the hue wraps, saturation and
    brightness are clamped to [0, 1]. Colours of palette entries that were not edited are returned unchanged. Grey has
    no hue: samples of a grey palette colour take the target's hue, and a grey target leaves the hue unchanged.
    """
    return with_change(colours, hsb_change(palette, target))


def hsb_change(palette: Tensor, target: Tensor) -> Tensor:
    """Return how :func:`shift_colours` changes colours: (..., 3) and (..., 3) -> (..., 4).

    What is added to the hue; the hue that all take, -1 for their own; what is added to saturation and brightness.
    """
    import torch

    before, after = rgb_to_hsb(palette), rgb_to_hsb(target)
    was_grey, is_grey = before[..., 1] < GREY_SATURATION, after[..., 1] < GREY_SATURATION
    turn = torch.where(was_grey | is_grey, 0.0, after[..., 0] - before[..., 0])
    return torch.cat(
        [torch.stack([turn, torch.where(was_grey, after[..., 0], -1.0)], -1), (after - before)[..., 1:]], -1
    )


def with_change(colours: Tensor, change: Tensor) -> Tensor:
    """Return colours changed as :func:`hsb_change` tells: (..., 3) and (..., 4) -> (..., 3).

    Where nothing is added and colours keep their hue, they stay as they are, also out of range.
    """
    import torch

    hsb, all_take = rgb_to_hsb(colours), change[..., 1:2] >= 0.0
    hue = torch.where(all_take, change[..., 1:2], hsb[..., :1] + change[..., :1])
    rest = (hsb[..., 1:] + change[..., 2:]).clamp(0, 1)
    same = ~all_take & (change[..., ::2] == 0.0).all(-1, keepdim=True) & (change[..., 3:] == 0.0)
    return torch.where(same, colours, hsb_to_rgb(torch.cat((hue, rest), -1)))


def over(rgba: NDArray[np.floating], background: Sequence[float] = WHITE) -> NDArray[np.floating]:
    """Blend straight-alpha RGBA over an opaque background, all in [0, 1]. (..., 4) -> (..., 3)."""
    alpha, behind, out = rgba[..., 3], np.asarray(background, dtype=rgba.dtype), np.empty_like(rgba[..., :3])
    for k in range(3):  # loops over three numbers at each pixel would take three times as long
        out[..., k] = rgba[..., k] * alpha + behind[k] * (1 - alpha)
    return out


def colour_differences(a: NDArray[np.floating], b: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return CIEDE2000 (Sharma et al. 2005) of each sRGB colour (A, 3) and each of others (B, 3). (A, B)

    Colours are clipped to [0, 1]. A difference of 1 is just about noticeable.
    """
    first, second = (rgb_to_lab(np.clip(np.asarray(c, np.float64), 0.0, 1.0)) for c in (a, b))
    return lab_differences(first[:, None], second[None])


def lab_differences(a: NDArray[np.floating], b: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return CIEDE2000 of CIELAB colours one by one. (..., 3), (..., 3) -> (...)

    scikit-image has the formula and the conversions below. colour-science, the reference in the tests, has the same
    values, but takes two seconds more to import, and imports matplotlib, which is not ParaView's.
    """
    from skimage.color import deltaE_ciede2000  # takes half a second, so imported only here

    return np.asarray(deltaE_ciede2000(a, b), np.float64)


def rgb_to_lab(rgb: NDArray[np.floating]) -> NDArray[Any]:
    """Return CIELAB (D65, 2 degrees) of sRGB in [0, 1], float32 of float32. (..., 3)

    >>> rgb_to_lab(np.array([1.0, 0.0, 0.0])).round(1).tolist()
    [53.2, 80.1, 67.2]
    """
    from skimage.color import rgb2lab

    return _by_parts(rgb2lab, rgb)


def lab_to_rgb(lab: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return the nearest RGB of CIELAB colours, of which edits may lie outside the gamut. (..., 3)

    Colours beyond those that light can have are first made less blue-yellow: they have no XYZ (scikit-image warns).

    >>> (100 * lab_to_rgb(np.array([[50.0, 0.0, 0.0], [20.0, 0.0, 150.0]]))).round().astype(int).tolist()
    [[47, 47, 47], [24, 18, 0]]
    """
    from skimage.color import lab2rgb

    def converted(lab: NDArray[np.floating]) -> NDArray[np.float32]:
        light = lab[..., 0].clip(0.0, 100.0)
        most = 200.0 * light / 116.0  # where Z is 0
        inside = np.stack([light, lab[..., 1], np.minimum(lab[..., 2], most)], -1)
        return np.asarray(lab2rgb(inside), np.float32).clip(0, 1)

    return _by_parts(converted, lab)


def _by_parts(convert: Callable[[NDArray[np.floating]], NDArray[Any]], colours: NDArray[np.floating]) -> NDArray[Any]:
    """Convert colours (..., 3) some at a time: a dozen arrays of millions of them would leave the processor's cache."""
    if colours.size <= 3 * AT_A_TIME:
        return np.asarray(convert(colours))
    flat = colours.reshape(-1, 3)
    parts = [convert(flat[first : first + AT_A_TIME]) for first in range(0, len(flat), AT_A_TIME)]
    return np.concatenate(parts).reshape(colours.shape)
