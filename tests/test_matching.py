"""The paper's way to paint: a network is distilled, and matching lowers the paper's loss against the style."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from svv.errors import silent
from svv.fields.scene.scene import Scene
from svv.styles.features import load_features
from svv.train.match.distil import Distillation
from svv.train.match.style_loss import PAPER_LOSS, StyleTarget
from svv.train.match.stylize import Stylization
from tests.balls import STEPS

STYLE = 100


def stripes() -> torch.Tensor:
    row, column = np.mgrid[0:STYLE, 0:STYLE]
    wave = 0.5 + 0.5 * np.sin((column + 0.5 * row) * 0.9)
    return torch.from_numpy(np.stack([wave, 0.6 * wave + 0.2, 1 - wave]).astype(np.float32))


def test_matching_lowers_the_loss_of_a_distilled_network(balls: Scene) -> None:
    assert balls.palette_network is not None
    target = StyleTarget(load_features("embedded"), stripes(), replace(PAPER_LOSS, style_size=STYLE))
    transferred = balls.palette_network.colours.detach()[balls.roots].clone()
    transferred[:] = target.statistics[0]
    start = Distillation(balls, transferred, STEPS, 0)
    errors = [float(start.step(number, number / 50)) for number in range(50)]
    assert errors[-1] < 0.2 * errors[0]
    work = Stylization(balls, start.field, {0: target, 1: target}, STEPS, silent)

    @torch.no_grad()
    def loss() -> float:
        found = [sum(work.losses(k, start.field(view.position))) for k, view in enumerate(work.views)]
        return float(np.mean([float(value) for value in found]))

    before = loss()
    for number in range(32):
        work.step(number, 0.0)
    assert loss() < 0.9 * before
