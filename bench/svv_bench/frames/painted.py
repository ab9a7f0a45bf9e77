"""Frames in a folder, stylized as pictures by the methods of :mod:`svv_bench.styles.rival_frames`."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from svv.errors import BadInput, Progress, silent
from svv.styles.features import load_features
from svv.train.match.style_loss import StyleLossSettings
from svv.train.run.config import StylizeSettings
from svv_bench.frames.measure import Compared
from svv_bench.frames.motion import Source
from svv_bench.frames.sequence import FrameFolder
from svv_bench.keys import key_of_measure
from svv_bench.styles.consistency import draw_frames, straight
from svv_bench.styles.modes import FRAMES, SCHEDULE
from svv_bench.styles.rival_frames import FORMS, Before, frame_after, frame_alone, frame_of_statistics


@dataclass(frozen=True)
class Painting:
    """How frames are stylized."""

    modes: tuple[str, ...] = FRAMES
    steps: int = SCHEDULE.style_iterations
    """Steps of a frame that does not start from another one."""
    features: str = "auto"
    seed: int = 0

    def __post_init__(self) -> None:
        for name in self.modes:
            if name not in FRAMES:
                raise BadInput(f"There is no mode '{name}' that paints frames; choose from {', '.join(FRAMES)}.")
        if self.steps < 1:
            raise BadInput(f"--steps must be at least 1, not {self.steps}.")


def paint_frames(
    source: Source, compared: Compared, style: NDArray[np.float32], mode: str, how: Painting,
    folder: Path, key: str, progress: Progress = silent,
) -> FrameFolder:  # fmt: skip
    """Stylize frames one by one; what is there already is kept.

    Strokes are in proportion to the frames, as in ``svv bench compare``. In the mode ``video`` a frame starts from the
    one before it, moved along the motion of ``source``, unless that is farther away than the frames of a pair.

    Args:
        source: The motion of the unstyled frames, which are its ``guide``. Their background is not painted.
        compared: Pairs that are compared; only their frames are stylized, in order.
        style: The style picture, in [0, 1]. (h, w, 3)
        mode: One of :data:`svv_bench.styles.modes.FRAMES`.
        how: Settings.
        folder: Folder of the result, ``0000.png`` and so on.
        key: Key of the frames.
        progress: Called before each frame.

    Returns:
        The stylized frames, with the alpha of the unstyled ones.
    """
    frames = source.guide
    numbers = sorted({number for _, *both in compared.pairs(frames)[0] for number in both})
    longest = max(compared.intervals) * frames.step
    own = StyleLossSettings()
    scale = max(frames.size) / StylizeSettings().style_size
    loss = replace(own, style_size=max(32, round(own.style_size * scale)))
    picture = torch.from_numpy(np.ascontiguousarray(style)).permute(2, 0, 1)
    made_with = (load_features(how.features), picture, loss, how.steps, how.seed)
    follows = {b: a for a, b in pairwise(numbers) if mode == "video" and b - a <= longest}

    def make(number: int) -> NDArray[np.float32]:
        rgba = frames.rgba(number) / np.float32(255)
        if number not in follows:
            return (frame_of_statistics if mode == "adain" else frame_alone)(rgba, *made_with)
        earlier = follows[number]
        warp = source.between(earlier, number).warp(frames.visible(earlier), frames.visible(number))
        return frame_after(rgba, Before(warp.moved(straight(folder, earlier)), warp.mask), *made_with)

    settings = {
        "mode": mode,
        "form": FORMS.get(mode),
        "how": asdict(replace(how, modes=())),
        "loss": asdict(loss),
        "style": style,
    }
    follow = [source.name, numbers] if mode == "video" else []
    draw_frames(folder, key_of_measure(key, settings, follow), numbers, make, progress)
    return frames.painted(folder, numbers)
