"""The start of a stylization, and how its parts resume from a checkpoint."""

from __future__ import annotations

import time
from collections.abc import Mapping
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from svv.fields.encodings import SparseLattice
from svv.fields.networks import UnrestrictedField
from svv.fields.scene import Scene
from svv.train.checkpoint import Arrays, Checkpoint
from svv.train.config import StylizeSettings
from svv.train.contrast import stroke_scales
from svv.train.distil import Distillation, paint_pixel
from svv.train.ink import Style
from svv.train.loop import Loop, Running
from svv.train.painting import Start, painted_field, painted_start
from svv.train.previews import Previews
from svv.train.style_loss import StyleLossSettings, StyleTarget, enlarged
from svv.train.stylize import Stylization

PREFIX = "table_and_network."


def is_laid(scene: Scene, settings: StylizeSettings) -> bool:
    """Return whether paint is laid as a lattice of colours; otherwise the paper's network is distilled."""
    return settings.direct and isinstance(scene.base.encoding, SparseLattice)


def targets_of(
    scene: Scene,
    network: nn.Module,
    pictures: Mapping[int, Style],
    masks: Mapping[int, NDArray[np.bool_] | None],
    loss: StyleLossSettings,
    settings: StylizeSettings,
    seed: int,
) -> dict[int, StyleTarget]:
    """Return the style target of each region; deep regions get larger strokes.

    Args:
        scene: A scene with a palette colour network.
        network: Feature network, on the scene's device.
        pictures: Style of each region, (H, W, 3) sRGB in [0, 1].
        masks: Part of each picture to learn from, or None for all of it.
        loss: Weights and sizes.
        settings: Settings of stage 3.
        seed: Seed of the targets' random choices.
    """
    larger: Mapping[int, float] = {}
    if is_laid(scene, settings) and loss.seeded:
        larger = stroke_scales(scene, list(pictures), paint_pixel(scene, settings), loss.largest)
    targets = {}
    for k, picture in pictures.items():
        values = np.ascontiguousarray(picture, np.float32)  # torch does not accept mirrored views of arrays
        style = torch.from_numpy(values).to(scene.device).permute(2, 0, 1)
        mask = None if (own := masks[k]) is None else torch.from_numpy(own)
        targets[k] = StyleTarget(network, style, enlarged(loss, larger.get(k, 1.0)), seed, mask)
    return targets


def started(
    scene: Scene,
    start: Start,
    settings: StylizeSettings,
    running: Running,
    seconds: dict[str, float],
    previews: Previews | None,
) -> UnrestrictedField:
    """Return the initial colours of the stylization: painted, or distilled into a network as in the paper.

    Args:
        scene: A scene with a palette colour network.
        start: Styles and inks of the regions (inks only where paint is laid, :func:`is_laid`), and earlier colours.
        settings: Settings of stage 3.
        running: Seed of networks, rays and layout; progress; and the checkpoint that keeps a finished start.
        seconds: Dictionary that receives the duration.
        previews: Shows the start while it is made, region by region.

    Raises:
        BadInput: None of the regions is visible.
    """
    saved, before, progress = running.saved, start.before, running.progress
    if not is_laid(scene, settings):
        distillation = Distillation(scene, start.transferred, settings, running.seed, before)
        watch = None if previews is None else partial(previews.look, distillation.field)
        known = before is not None and all(scene.regions[k].style is not None for k in start.targets)
        steps = 0 if known else settings.distil_iterations
        field, notes = distillation.field, running.notes
        loop = Loop(steps, None, progress, "distillation", watch=watch, network=field, notes=notes)
        seconds["distil"] = run_stage(loop, distillation, saved, "distil") if steps else 0.0
        return field
    pixel = paint_pixel(scene, settings)
    # Strokes take less time than it would take to keep them: they are laid again, and are the same.
    if saved is not None and "paint" in saved.finished and not start.hands:
        field = painted_field(scene, pixel)
        field.load_state_dict(_state(saved.arrays))
        seconds["paint"] = float(saved.finished["paint"]["seconds"])
        return field
    begin = time.monotonic()
    show = (lambda field: None) if previews is None else partial(previews.look, at_once=True)
    field = painted_start(scene, start, pixel, running.seed, progress, show, running.notes)
    seconds["paint"] = time.monotonic() - begin
    if saved is not None and not start.hands:
        saved.finish("paint", {"seconds": seconds["paint"]}, _arrays(field))
    return field


def run_stage(loop: Loop, work: Distillation | Stylization, saved: Checkpoint | None, name: str) -> float:
    """Run a part of the stylization, or take its result from the checkpoint; returns the seconds spent."""
    if saved is None:
        return loop.run(work.step)
    if name in saved.finished:
        work.field.load_state_dict(_state(saved.arrays))
        return float(saved.finished[name]["seconds"])
    state = saved.stage(name, work.field, work.networks, work.tables)
    if state.restored is not None:
        loop.done, loop.spent = state.restored
    loop.save = lambda done, spent: state.save(done, spent, {})
    seconds = loop.run(work.step)
    saved.finish(name, {"seconds": seconds}, _arrays(work.field))
    return seconds


def _arrays(field: UnrestrictedField) -> Arrays:
    return {PREFIX + k: v.cpu().numpy().copy() for k, v in field.state_dict().items()}


def _state(arrays: Arrays) -> dict[str, Tensor]:
    return {k[len(PREFIX) :]: torch.from_numpy(v.copy()) for k, v in arrays.items() if k.startswith(PREFIX)}
