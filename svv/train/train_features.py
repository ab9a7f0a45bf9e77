"""Train a style feature network on generated textures: ``python -m svv.train.train_features --minutes M --out FILE``.

Two crops of one picture must recognise each other among the crops of other pictures, and each position must recognise
its own picture: so the features tell textures apart where they stand. To tell them apart by colour alone would be
too easy, so most pictures are given the colours of another one of the same batch; colours are never made *unimportant*
(no channel is swapped, no hue turned between two crops), for features that overlook them let colours drift. A linear
map back to the pixels is trained beside it: what features cannot see comes out of stylization as coloured noise.

Resumable: the state is kept beside the output file, which holds the best so far at any time.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Sequence
from pathlib import Path

import torch
import torch.nn.functional as F
from safetensors.torch import save_file
from torch import Tensor, nn

from svv.core.nnfm import colour_statistics, colour_transfer
from svv.train.features import StyleFeatures
from svv.train.textures import texture

WIDTHS = ((16, 32), (48, 64), (96, 128, 128))
FIRST_PICTURES, PICTURES = 192, 1024
"""Pictures to start with and to keep: each iteration adds one, then replaces one, so that none is seen for long."""
BATCH = 42
"""Pictures compared with each other at a time, two crops each."""
CROP = 56
GROUP = 6
"""Pictures of a batch that share the colours of the first of them."""
QUERIES = 8
"""Positions of a crop that look for their picture."""
TEMPERATURE = 0.1


class Pupil(nn.Module):
    """The feature network with batch normalization, and the heads that are dropped after training."""

    def __init__(self, widths: Sequence[Sequence[int]] = WIDTHS) -> None:
        super().__init__()
        self.trunk = StyleFeatures(widths, "mean", (0.5, 0.5, 0.5), (0.25, 0.25, 0.25))
        self.norm_layers = [[nn.BatchNorm2d(width) for width in block] for block in widths]
        self.norms = nn.ModuleList(nn.ModuleList(block) for block in self.norm_layers)
        last, every = widths[2][-1], sum(widths[2])
        self.local = nn.Sequential(nn.Linear(every, 128), nn.ReLU(), nn.Linear(128, 64))
        self.whole = nn.Sequential(nn.Linear(2 * every, 128), nn.ReLU(), nn.Linear(128, 64))
        self.back = nn.Conv2d(last, 48, 1)

    def maps(self, image: Tensor) -> list[Tensor]:
        """Activations of every convolution, in order."""
        x = ((image - self.trunk.mean) / self.trunk.deviation).contiguous(memory_format=torch.channels_last)
        maps = []
        for number, (block, norms) in enumerate(zip(self.trunk.layers, self.norm_layers, strict=True)):
            if number:
                x = self.trunk.pool(x)
            for layer, norm in zip(block, norms, strict=True):
                x = torch.relu(norm(layer(x)))
                maps.append(x)
        return maps

    def loss(self, first: Tensor, second: Tensor) -> tuple[Tensor, dict[str, float]]:
        """Contrast and reconstruction of two crops (B, 3, h, w) of each of B pictures."""
        image = torch.cat([first, second])
        third = self.maps(image)[-3:]
        features = torch.cat(third, 1)
        whole = self.whole(torch.cat([features.mean((2, 3)), features.flatten(2).std(2)], 1))
        at = torch.randint(features[0, 0].numel(), (len(image), 1, QUERIES)).expand(-1, features.shape[1], -1)
        local = self.local(features.flatten(2).gather(2, at).transpose(1, 2))  # (2B, QUERIES, 64)
        whole, local = F.normalize(whole, dim=1), F.normalize(local, dim=2)
        names, b = torch.arange(len(first)), len(first)
        scores = whole[:b] @ whole[b:].T / TEMPERATURE
        contrast = (F.cross_entropy(scores, names) + F.cross_entropy(scores.T, names)) / 2
        # Each position looks among the *other* crops, lest it finds the very pixels it stands on.
        found = torch.cat([local[:b] @ whole[b:].T, local[b:] @ whole[:b].T]).flatten(0, 1) / TEMPERATURE
        truth = names.repeat(2).repeat_interleave(QUERIES)
        positions = F.cross_entropy(found, truth)
        back = F.l1_loss(F.pixel_shuffle(self.back(third[-1]), 4), image)
        figures = {
            "contrast": contrast.item(),
            "positions": positions.item(),
            "right": (found.argmax(1) == truth).float().mean().item(),
            "back": back.item(),
        }
        return contrast + positions + 10 * back, figures


def crops(pictures: Sequence[Tensor], generator: torch.Generator) -> Tensor:
    """A random crop of each of B pictures (3, n, n) uint8, its size changed a little; (B, 3, CROP, CROP) in [0, 1]."""
    out = torch.empty(len(pictures), 3, CROP, CROP)
    for i, picture in enumerate(pictures):
        size = int(torch.randint(CROP * 7 // 8, CROP * 9 // 8 + 1, (1,), generator=generator))
        y, x = torch.randint(picture.shape[1] - size + 1, (2,), generator=generator).tolist()
        crop = picture[None, :, y : y + size, x : x + size].float() / 255
        out[i] = F.interpolate(crop, size=CROP, mode="bilinear", antialias=True)[0]
    return out


def share_colours(first: Tensor, second: Tensor, generator: torch.Generator) -> None:
    """Give the pictures of a group the colours of its first, in two groups of three; changes both in place."""
    for start in range(0, len(first) - GROUP + 1, GROUP):
        if torch.rand(1, generator=generator) < 1 / 3:
            continue
        group = range(start, start + GROUP)
        target, *others = [colour_statistics(torch.cat([first[i], second[i]], 1).flatten(1).T) for i in group]
        for i, source in zip(group[1:], others, strict=True):
            matrix, offset = colour_transfer(source, target, floor=2e-3)
            for crop in (first[i], second[i]):
                crop.copy_((torch.einsum("dc,chw->dhw", matrix, crop) + offset[:, None, None]).clamp(0, 1))


@torch.no_grad()
def export(pupil: Pupil, sample: Tensor, path: Path, facts: dict[str, str]) -> None:
    """Write the trunk: normalization folded in, each channel's mean activation made 1, float16.

    The scaling changes nothing that a later layer sees (ReLU is positively homogeneous) but lets no channel and no
    layer outweigh the others in a cosine (Gatys et al. 2016, sec. 2).
    """
    was = pupil.training
    means = [x.mean((0, 2, 3)).clamp_min(1e-3) for x in pupil.eval().maps(sample)]
    pupil.train(was)
    state: dict[str, Tensor] = {}
    before = torch.ones(3)
    layers = [
        (f"blocks.{b}.{i}", layer, pupil.norm_layers[b][i])
        for b, block in enumerate(pupil.trunk.layers)
        for i, layer in enumerate(block)
    ]
    for (name, layer, norm), mean in zip(layers, means, strict=True):
        assert norm.running_mean is not None and norm.running_var is not None and layer.bias is not None
        gain = norm.weight / (norm.running_var + norm.eps).sqrt()
        weight = layer.weight * (gain / mean)[:, None, None, None] * before[None, :, None, None]
        bias = ((layer.bias - norm.running_mean) * gain + norm.bias) / mean
        state |= {f"{name}.weight": weight.half().contiguous(), f"{name}.bias": bias.half()}
        before = mean
    widths = ",".join("-".join(str(layer.out_channels) for layer in block) for block in pupil.trunk.layers)
    save_file(state, path, {"svv": "style features", "widths": widths, "pool": "mean"} | facts)


def train(minutes: float, seed: int, out: Path) -> None:
    """Train for ``minutes`` of wall time in all (over every resumption) and write the weights to ``out``."""
    torch.manual_seed(seed)
    generator = torch.Generator().manual_seed(seed)
    pupil: Pupil = Pupil().to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    optimizer = torch.optim.AdamW(pupil.parameters(), 2e-3, weight_decay=1e-3)
    kept = out.with_suffix(".checkpoint.pt")
    spent, iteration = 0.0, 0
    if kept.exists():
        state = torch.load(kept, weights_only=True)
        pupil.load_state_dict(state["pupil"])
        optimizer.load_state_dict(state["optimizer"])
        spent, iteration = state["spent"], state["iteration"]
        generator.set_state(state["generator"])
    number = seed * 1_000_000
    print(f"generating {FIRST_PICTURES} pictures, starting with number {number + iteration}", flush=True)
    pictures = [_picture(number + iteration + i) for i in range(FIRST_PICTURES)]
    means: dict[str, float] = {}
    started = saved = time.monotonic()
    while (now := spent + time.monotonic() - started) < 60 * minutes:
        rate = min(1.0, (iteration + 1) / 50) * (0.5 + 0.5 * math.cos(math.pi * now / (60 * minutes)))
        for group in optimizer.param_groups:
            group["lr"] = 2e-3 * rate + 1e-5
        pictures = [*pictures[-PICTURES + 1 :], _picture(number + FIRST_PICTURES + iteration)]
        chosen = [pictures[i] for i in torch.randperm(len(pictures), generator=generator)[:BATCH]]
        first, second = crops(chosen, generator), crops(chosen, generator)
        share_colours(first, second, generator)
        loss, figures = pupil.loss(first, second)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        iteration += 1
        means = {k: 0.95 * means.get(k, v) + 0.05 * v for k, v in figures.items()}
        done = 60 * minutes <= spent + time.monotonic() - started
        if iteration % 20 == 0:
            print(
                f"{now:6.0f} s  {iteration:5d}  " + "  ".join(f"{k} {v:.3f}" for k, v in means.items()),
                flush=True,
            )
        if done or time.monotonic() - saved > 120:
            saved = time.monotonic()
            state = {"pupil": pupil.state_dict(), "optimizer": optimizer.state_dict(), "iteration": iteration}
            torch.save(state | {"spent": saved - started + spent, "generator": generator.get_state()}, kept)
            facts = {"seed": str(seed), "iterations": str(iteration), "minutes": f"{now / 60:.1f}"}
            export(pupil, torch.cat([first, second]), out, facts | {"scores": json.dumps(means)})
    print(f"{iteration} iterations in {spent + time.monotonic() - started:.0f} s: {out}", flush=True)


def _picture(number: int) -> Tensor:
    return torch.from_numpy((texture(number) * 255).astype("uint8")).permute(2, 0, 1)


def main() -> None:
    parser = argparse.ArgumentParser(description="Train the embedded style features on generated textures.")
    parser.add_argument("--minutes", type=float, default=60, help="wall time in all, resumptions included")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True, help="safetensors file; its .checkpoint.pt is resumed from")
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    train(arguments.minutes, arguments.seed, arguments.out)


if __name__ == "__main__":
    main()
