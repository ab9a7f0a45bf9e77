"""Comparison of feature networks in image space, for ``svv bench judge``.

A view with an alpha mask is stylized with each candidate and style, and compared with the style by figures that are
independent of all candidates: sliced Wasserstein distances of pixels and of patches without their mean, and the
orientations of edges. Contact sheets are written with the table because the eye has the last word.
"""

from __future__ import annotations

import csv
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from PIL import Image
from torch import Tensor, nn

from svv.core.nnfm import colour_statistics, colour_transfer
from svv.errors import BadInput, Progress, silent
from svv.io.atomic import atomic_path, make_folder
from svv.io.output import write_png
from svv.styles.features import STRIDE, PatchFeatures, VggFeatures, load_features
from svv.styles.gallery import open_style
from svv.styles.textures import STYLE_PICTURES, style_picture
from svv.train.style_loss import PAPER_LOSS, PATCH_LOSS, StyleLossSettings, StyleTarget, resized

OURS = PATCH_LOSS
DIRECTIONS = 128
"""Number of random projections of a sliced Wasserstein distance."""


class RawPatches(nn.Module):
    """Unmodified patches of 8 x 8 pixels as features."""

    def forward(self, image: Tensor) -> Tensor:
        size = [n // STRIDE for n in image.shape[2:]]
        return F.unfold(F.pad(image, (2,) * 4, mode="reflect"), 8, stride=STRIDE).unflatten(2, size)


def untrained() -> nn.Module:
    """Return VGG-16 with random weights (He et al. 2015)."""
    torch.manual_seed(0)
    network = VggFeatures("untrained VGG-16")
    for layer in network.modules():
        if isinstance(layer, nn.Conv2d):
            nn.init.kaiming_normal_(layer.weight)
            nn.init.zeros_(layer.bias)  # type: ignore[arg-type]
    return network.requires_grad_(False)


CANDIDATES: dict[str, tuple[Callable[[], nn.Module], StyleLossSettings]] = {
    "untrained network, plain matching": (untrained, PAPER_LOSS),
    "untrained network, ours": (untrained, replace(OURS, balance=0.02)),
    "VGG-16, plain matching": (lambda: load_features("vgg16"), PAPER_LOSS),
    "VGG-16, ours": (lambda: load_features("vgg16"), replace(StyleLossSettings(), seeded=False)),
    "raw patches, plain matching": (RawPatches, PAPER_LOSS),
    "raw patches, ours": (RawPatches, OURS),
    "cosine patches, plain matching": (PatchFeatures, PAPER_LOSS),
    "cosine patches, ours without balance": (PatchFeatures, replace(OURS, balance=None)),
    "cosine patches, ours without colours": (PatchFeatures, replace(OURS, colours=0.0)),
    "cosine patches, ours without energy": (PatchFeatures, replace(OURS, energy=0.0)),
    "cosine patches, ours": (PatchFeatures, OURS),
    "cosine patches, ours, two octaves": (PatchFeatures, replace(OURS, octaves=2)),
}


def stylized(colours: Tensor, mask: Tensor, target: StyleTarget, steps: int, rate: float = 0.03) -> Tensor:
    """Optimise the colours (3, h, w) of a view towards a style; its opacity (h, w) does not change."""
    loss = partial(style_loss, mask=mask, target=target)
    return optimised(with_style_colours(colours, mask, target), mask, loss, steps, rate)


def with_style_colours(colours: Tensor, mask: Tensor, target: StyleTarget) -> Tensor:
    """Give colours (3, h, w) with opacity (h, w) the mean and covariance of the style's, to start a frame from."""
    matrix, offset = colour_transfer(colour_statistics(colours.flatten(1).T, mask.flatten()), target.statistics, 1e-3)
    return (torch.einsum("dc,chw->dhw", matrix, colours) + offset[:, None, None]).clamp(0.02, 0.98)


def style_loss(picture: Tensor, mask: Tensor, target: StyleTarget) -> Tensor:
    """Return the style loss of straight colours (3, h, w) with opacity (h, w), over the style's background."""
    return target.loss(picture * mask + target.background * (1 - mask), mask)


def optimised(start: Tensor, mask: Tensor, loss: Callable[[Tensor], Tensor], steps: int, rate: float = 0.03) -> Tensor:
    """Minimize a loss of colours (3, h, w) in [0, 1] with Adam, from a start.

    The change is a pyramid of five levels, as a radiance field has features at several resolutions. ``mask`` (h, w)
    weights the penalty on colours outside [0, 1], which the loss does not see.
    """
    size = mask.shape
    levels = [torch.zeros(1, 3, *(-(-n >> k) + 1 for n in size)).requires_grad_() for k in range(5)]
    optimizer = torch.optim.Adam(levels, rate)

    def picture() -> Tensor:
        return start + sum(F.interpolate(level, size=size, mode="bilinear")[0] for level in levels)

    for _ in range(steps):
        now = picture()
        outside = ((now - now.clamp(0, 1)).square() * mask).mean()
        total = loss(now.clamp(0, 1)) + 10 * outside
        optimizer.zero_grad()
        total.backward()
        optimizer.step()
    return picture().detach().clamp(0, 1)


def sliced_wasserstein(a: Tensor, b: Tensor) -> float:
    """Return the mean distance of sorted projections of two sets of vectors (N, C), (M, C) (Rabin et al. 2011)."""
    generator = torch.Generator().manual_seed(0)
    directions = F.normalize(torch.randn(a.shape[1], DIRECTIONS, generator=generator), dim=0)
    at = torch.linspace(0, 1, 257)
    return float((torch.quantile(a @ directions, at, 0) - torch.quantile(b @ directions, at, 0)).abs().mean())


def patches(picture: Tensor, mask: Tensor | None = None, side: int = 5) -> Tensor:
    """Return at most 20,000 patches without their mean that lie completely in the foreground. (N, 3 side^2)"""
    columns = F.unfold(picture[None], side)[0].T
    if mask is not None:
        columns = columns[F.unfold(mask[None, None], side)[0].amin(0) > 0.9]
    columns = columns[:: max(1, len(columns) // 20_000)].unflatten(1, (3, -1))
    return (columns - columns.mean(2, keepdim=True)).flatten(1)


def orientations(picture: Tensor, mask: Tensor | None = None) -> Tensor:
    """Return a histogram (12,) of the directions of grey gradients, weighted by their length."""
    grey = picture.mean(0)
    dy, dx = (grey[2:, 1:-1] - grey[:-2, 1:-1]) / 2, (grey[1:-1, 2:] - grey[1:-1, :-2]) / 2
    length = torch.hypot(dx, dy)
    if mask is not None:
        length = length * (-F.max_pool2d(-mask[None], 3, 1)[0] > 0.9)
    part = ((torch.atan2(dy, dx) / torch.pi) % 1 * 12).long().clamp(0, 11)
    histogram = torch.bincount(part.flatten(), length.flatten(), 12)
    return histogram / histogram.sum().clamp_min(1e-9)


def figures(picture: Tensor, mask: Tensor, style: Tensor, background: float) -> dict[str, float]:
    """Return distances of a picture's foreground from a style, best at 0; ``contrast`` and ``chroma`` are best at 1."""
    inside = mask > 0.9
    shown = picture.flatten(1).T[inside.flatten()]
    result = {"colour": sliced_wasserstein(shown, style.flatten(1).T)}
    for octave in range(3):
        small, cover, there = (F.avg_pool2d(x, 1 << octave) if octave else x for x in (picture, mask[None], style))
        found, wanted = patches(small, cover[0]), patches(there)
        if len(found) < 30:
            break
        spread = wanted.square().mean().sqrt().clamp_min(1e-3)
        result[f"patches 1/{1 << octave}"] = sliced_wasserstein(found / spread, wanted / spread)
        if octave == 0:
            result["contrast"] = float(found.square().mean().sqrt() / spread)
            chroma = [x.unflatten(1, (3, -1)) for x in (found, wanted)]
            noise = [(c - c.mean(1, keepdim=True)).square().mean().sqrt() for c in chroma]
            result["chroma"] = float(noise[0] / noise[1].clamp_min(1e-3))
    result["orientation"] = float((orientations(picture, mask) - orientations(style)).abs().sum() / 2)
    near = (shown - background).abs().amax(1) < 0.08
    near_style = (style.flatten(1) - background).abs().amax(0) < 0.08
    result["background"] = max(0.0, float(near.float().mean() - near_style.float().mean()))
    return result


def read_view(path: Path, size: int) -> tuple[Tensor, Tensor]:
    """Read straight colours (3, h, w) and opacity (h, w) of a view, ``size`` pixels wide, cropped to its content."""
    try:
        with Image.open(path) as image:
            levels = np.asarray(image.convert("RGBA"), np.float32)
    except OSError as error:
        raise BadInput(f"Cannot read {path} as a picture ({error}): give a PNG with alpha.") from error
    if not levels[..., 3].any():
        raise BadInput(f"{path} shows nothing: every pixel is transparent.")
    rgba = torch.from_numpy(levels / 255).permute(2, 0, 1)
    rgba = torch.cat([rgba[:3] * rgba[3:], rgba[3:]])
    rgba = F.interpolate(rgba[None], scale_factor=size / rgba.shape[2], mode="bilinear", antialias=True)[0]
    rows, columns = torch.where(rgba[3] > 0.01)
    rgba = rgba[
        :, max(0, int(rows.min()) - 8) : int(rows.max()) + 9, max(0, int(columns.min()) - 8) : int(columns.max()) + 9
    ]
    return rgba[:3] / rgba[3:].clamp_min(1e-3), rgba[3].clamp(0, 1)


def judge(
    view: Path, styles: Sequence[str], out: Path, size: int, steps: int, only: Sequence[str] = (),
    progress: Progress = silent,
) -> str:  # fmt: skip
    """Stylize a view with every candidate and style; write ``table.csv`` and one contact sheet per style.

    Args:
        view: A PNG with alpha.
        styles: Picture files or ``gallery:NAME``, in addition to the two built-in ones.
        out: Output folder; created if missing.
        size: Width at which the view is stylized, in pixels.
        steps: Iterations of each stylization.
        only: Parts of the names of the candidates to be judged; empty for all.
        progress: Called before every stylization and at the end.

    Returns:
        The table as Markdown, averaged over the styles.

    Raises:
        BadInput: The view or a style cannot be read, the view shows nothing, or no candidate has such a name.
    """
    chosen = {k: v for k, v in CANDIDATES.items() if not only or any(part in k for part in only)}
    if not chosen:
        raise BadInput(f"No candidate has such a name; choose from {', '.join(CANDIDATES)}.")
    colours, mask = read_view(view, size)
    pictures = {name: style_picture(name) for name in STYLE_PICTURES} | dict(open_style(s) for s in styles)
    make_folder(out)
    rows: list[dict[str, str | float]] = []
    for style_name, style in pictures.items():
        picture = torch.from_numpy(style).permute(2, 0, 1)
        sheet = [colours * mask + 1 - mask]
        for name, (make, settings) in chosen.items():
            progress(len(rows) / (len(pictures) * len(chosen)), f"{style_name}, {name}")
            target = StyleTarget(make(), picture, settings)
            began = time.perf_counter()
            result = stylized(colours, mask, target, steps)
            seconds = (time.perf_counter() - began) / steps
            scores = figures(result, mask, resized(picture, settings.style_size), target.background)
            rows.append({"style": style_name, "candidate": name} | scores | {"seconds a step": seconds})
            sheet.append(result * mask + 1 - mask)
        write_png(out / f"{style_name}.png".replace(" ", "_"), torch.cat(sheet, 2).permute(1, 2, 0).numpy())
    with atomic_path(out / "table.csv") as temporary, temporary.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(dict.fromkeys(key for row in rows for key in row)))
        writer.writeheader()
        writer.writerows(rows)
    progress(1.0, "")
    return markdown(rows)


def markdown(rows: list[dict[str, str | float]]) -> str:
    """Format the table averaged over styles, with a line per candidate."""
    keys = [key for key in rows[0] if key not in ("style", "candidate")]
    lines = ["| candidate | " + " | ".join(keys) + " |", "|---|" + "---|" * len(keys)]
    for name in dict.fromkeys(row["candidate"] for row in rows):
        own = [row for row in rows if row["candidate"] == name]
        means = [np.mean([float(row[key]) for row in own if key in row]) for key in keys]
        lines.append(f"| {name} | " + " | ".join(f"{mean:.3f}" for mean in means) + " |")
    return "\n".join(lines)
