"""Splats of a scene, fitted to its own pictures.

Kerbl et al., "3D Gaussian Splatting", ACM TOG 2023, from a start that knows the scene: hundreds of steps instead of
tens of thousands. Letters: N splats, K harmonics.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from svv.core.colour.colour import WHITE
from svv.core.geometry.cameras import Camera
from svv.errors import BadInput, Progress, part, silent
from svv.fields.scene.scene import Scene
from svv.fields.scene.sections import has_section_lines
from svv.fields.scene.shadows import check_shadows_stay
from svv.fields.splats.splats import Floats, Splats
from svv.options.splats import MOST_SPLATS, SplatOptions
from svv.train.run.loop import Loop
from svv.train.splats import raster_kernels as kernels
from svv.train.splats.raster import Drawing, Eye, Gaussians, draw
from svv.train.splats.starting import Seen, ball_around, cameras_around, seen_of, splats_at, turns_of

VIEWS, PIXELS = 42, 352
"""Pictures that splats are fitted to, and pixels along their sides."""

BEGIN = 0.6
"""Share of the splats at the start; the others come where the error is."""

DENSE_FROM, DENSE_TO, DENSE_EVERY = 0.1, 0.6, 0.1
"""Parts of the fit between which splats are divided and dropped, and between two such times."""

UNSEEN, FAINT = 0.02, 0.006
"""Weight in all pictures, in pixels, and opacity, below which a splat is dropped."""

SMALLER = 1.6
"""Divisor of the standard deviations of splats that are divided (Kerbl et al. 2023)."""

KNEE = 0.05
"""Difference of colours up to which the loss is nearly their square, and beyond nearly the difference itself."""

ALPHA = 0.3
"""Weight of differences in alpha, so that splats may lie on any background."""

RATES = {"centres": 0.05, "scales": 0.015, "rotations": 0.01, "opacities": 0.05, "harmonics": 0.015}
"""Adam's rates: of centres in cells of the start, of logarithms of standard deviations, of quaternions, of logits of
opacities, and of harmonics."""

LATER = 0.2
"""Factor on the rate of harmonics beyond the first."""

END = 0.1
"""Factor on the rates at the end."""

FAR = 0.1
"""Error of a place in single precision, in standard deviations of half of the splats, beyond which none is made."""

OLD, OLDER, TINY = np.float32(0.9), np.float32(0.99), np.float32(1e-12)


def fit_splats(scene: Scene, options: SplatOptions = SplatOptions(), progress: Progress = silent) -> Splats:
    """Return Gaussian splats that look as a scene does, with its edits, paint and light, from all around.

    Args:
        scene: The scene; of several time steps, the one shown.
        options: How many splats, and how long to fit them.
        progress: Called several times a second; stops the work when it raises.

    Raises:
        BadInput: The scene shows nothing, lacks the network, or has what no splats hold: lines that are drawn on
            pictures, shadows that follow the camera, or a place so far from the origin that single precision fails.

    >>> splats = svv.fit_splats(scene, svv.SplatOptions(count=500, steps=5))
    >>> splats.names, splats.centres.shape[1], len(splats) <= 500
    (('region 0', 'region 1'), 3, True)
    """
    begin = time.monotonic()
    network = _network_of(scene, options)
    seen = seen_of(scene, network, part(progress, 0.0, 0.1))
    part(progress, 0.1, 0.12)(0.0, "placing splats")
    degree = None if options.degree == "auto" else int(options.degree)
    fit = Fit(*splats_at(seen, max(1, round(BEGIN * options.count)), degree))
    cameras = cameras_around(*ball_around(seen), max(3, min(VIEWS, options.steps)), PIXELS)
    eyes = [Eye.of(camera, seen.origin, seen.size) for camera in cameras]
    pictures = []
    for number, camera in enumerate(cameras):
        part(progress, 0.12, 0.3)(number / len(cameras), "drawing pictures")
        pictures.append(picture_of(scene, camera, network))
    left = None if options.time_limit is None else max(0.1, options.time_limit - (time.monotonic() - begin))
    loop = Loop(options.steps, left, part(progress, 0.3, 1.0), "fitting splats")
    schedule = _Schedule(fit, eyes, pictures, options)
    loop.run(schedule)
    fit.divide(0, options.count, schedule.rounds > 0)
    names = tuple(region.name or f"region {number}" for number, region in enumerate(scene.regions))
    return _in_world(fit, seen, ("scene",) if network == "base" or not names else names)


def _network_of(scene: Scene, options: SplatOptions) -> str:
    """Return the network that draws; BadInput if there is none, options are out of range, or splats cannot show it."""
    if not 100 <= options.count <= MOST_SPLATS:
        raise BadInput(f"The number of splats must be between 100 and {MOST_SPLATS}, not {options.count}.")
    if options.degree not in ("auto", "0", "1", "2", "3"):
        raise BadInput(f"The degree of harmonics is auto, 0, 1, 2 or 3, not {options.degree}.")
    if options.steps < 1:
        raise BadInput(f"The number of steps must be at least 1, not {options.steps}.")
    network = options.network or scene.networks[-1]
    if network not in scene.networks:
        raise BadInput(f"The scene has no network '{network}', only {', '.join(scene.networks)}.")
    if network != "base":
        if any(region.outline > 0.0 for region in scene.regions) or has_section_lines(scene):
            raise BadInput(
                "Outlines and lines around sections are drawn on pictures, and no splats hold them: take them off with "
                "svv edit --outline K=0 and --section-line K=0, or render pictures."
            )
        check_shadows_stay(scene, "A set of splats")
    return network


def _in_world(fit: Fit, seen: Seen, names: tuple[str, ...]) -> Splats:
    """Return what was fitted, in world units; BadInput if float32 cannot hold the places."""
    found = fit.splats
    centres = seen.origin + seen.size * found.centres.astype(np.float64)
    scales = seen.size * found.scales.astype(np.float64)
    away = float(np.abs(centres).max(initial=0.0)) * float(np.finfo(np.float32).eps)
    if len(found) and away > FAR * float(np.median(scales)):
        raise BadInput(
            "The scene lies so far from the origin, for its size, that splats, which are of single precision, would be "
            "out of place: move its volume to the origin, and train it there."
        )
    rotations = found.rotations / np.linalg.norm(found.rotations, axis=1, keepdims=True)
    return Splats(
        centres.astype(np.float32), scales.astype(np.float32), rotations.astype(np.float32),
        found.opacities, np.ascontiguousarray(found.harmonics), fit.regions, names, WHITE,
    )  # fmt: skip


class _Schedule:
    """The steps of a fit: pictures in random order, and now and then splats are divided and dropped."""

    def __init__(self, fit: Fit, eyes: list[Eye], pictures: list[Floats], options: SplatOptions) -> None:
        self.fit, self.eyes, self.pictures, self.most = fit, eyes, pictures, options.count
        self.random = np.random.default_rng(options.seed)
        self.queue: list[int] = []
        self.next, self.before = DENSE_FROM, 0.0
        self.rounds = 0
        """How often all pictures were fitted since splats were divided."""

    def __call__(self, number: int, fraction: float) -> Tensor:
        """Do a step, and return its loss."""
        if not self.queue:
            self.rounds += number > 0
            if self.rounds and self.next <= fraction <= DENSE_TO:
                self._divide(fraction)
            self.queue = self.random.permutation(len(self.eyes)).tolist()
            self.before = fraction
        view = self.queue.pop()
        return torch.tensor(self.fit.step(self.eyes[view], self.pictures[view], fraction))

    def _divide(self, fraction: float) -> None:
        """Divide splats, so many that all are there when it is done the last time."""
        every = max(DENSE_EVERY, fraction - self.before)
        times = int((DENSE_TO - fraction) / every) + 1
        self.fit.divide(-(-(self.most - len(self.fit.regions)) // times), self.most, True)
        self.next, self.rounds = fraction + DENSE_EVERY, 0


class Fit:
    """Splats that are being fitted to pictures of a scene."""

    def __init__(self, splats: Gaussians, regions: NDArray[np.int16], side: float) -> None:
        """Begin with splats, their regions (N,), and the ``side`` of their cells."""
        logits = np.log(splats.opacities) - np.log1p(-splats.opacities)
        self.values: dict[str, Floats] = {
            "centres": splats.centres, "scales": np.log(splats.scales), "rotations": splats.rotations,
            "opacities": logits[:, None], "harmonics": splats.harmonics.reshape(len(splats), -1),
        }  # fmt: skip
        self.regions, self.side = regions, side
        self.moments = {name: [np.zeros_like(value), np.zeros_like(value)] for name, value in self.values.items()}
        self.seen = np.zeros((len(splats), 2), np.float32)
        self.done = 0

    @property
    def splats(self) -> Gaussians:
        """The splats as they are."""
        v = self.values
        opacities = np.float32(1.0) / (np.float32(1.0) + np.exp(-v["opacities"][:, 0]))
        return Gaussians(
            v["centres"], np.exp(v["scales"]), v["rotations"], opacities, v["harmonics"].reshape(len(opacities), -1, 3)
        )

    def step(self, eye: Eye, picture: Floats, fraction: float) -> float:
        """Fit to one picture (4, height, width) of RGB times alpha, and alpha; return the loss."""
        splats = self.splats
        drawing = draw(splats, eye)
        loss, slope, error = loss_of(drawing.image, picture)
        found, seen = drawing.gradients(slope, error)
        self.seen += seen
        found = replace(
            found, scales=found.scales * splats.scales,
            opacities=(found.opacities * splats.opacities * (1.0 - splats.opacities))[:, None],
            harmonics=found.harmonics.reshape(len(splats), -1),
        )  # fmt: skip
        self._move(found, drawing, fraction)
        return loss

    def _move(self, gradients: Gaussians, drawing: Drawing, fraction: float) -> None:
        self.done += 1
        unbiased = np.array([1.0 - float(OLD) ** self.done, 1.0 - float(OLDER) ** self.done], np.float32)
        for name, value in self.values.items():
            rates = np.full(value.shape[1], RATES[name] * END**fraction, np.float32)
            if name == "centres":
                rates *= np.float32(self.side)
            if name == "harmonics":
                rates[3:] *= np.float32(LATER)
            kernels.step(
                value, getattr(gradients, name), drawing.firsts, *self.moments[name], rates, OLD, OLDER, unbiased, TINY
            )

    def divide(self, count: int, most: int, sure: bool) -> None:
        """Drop splats that show nothing, and divide those where the error is, ``count`` or up to ``most`` in all.

        ``sure``: whether all pictures were fitted since this was done before, so that what none showed is dropped.
        """
        splats = self.splats
        shown = (self.seen[:, 0] > UNSEEN) | (not sure)
        kept = np.flatnonzero(shown & (splats.opacities > FAINT))
        score = self.seen[kept, 1]
        room = max(0, min(count, most - len(kept)))
        among = np.argsort(-score, kind="stable")[:room]
        chosen = kept[np.sort(among[score[among] > 0.0])]
        self._keep(kept, chosen)

    def _keep(self, kept: NDArray[np.int64], divided: NDArray[np.int64]) -> None:
        """Keep some splats, and divide some of them in two along their longest axis."""
        splats = self.splats
        turns = turns_of(splats.rotations[divided].astype(np.float64))
        longest = splats.scales[divided].argmax(axis=1)
        away = turns[np.arange(len(divided)), :, longest] * splats.scales[divided].max(axis=1)[:, None] * 0.5
        for name, value in self.values.items():
            own = value.copy()
            if name == "scales":
                own[divided, longest] -= np.float32(np.log(SMALLER))
            extra = own[divided]
            if name == "centres":
                own[divided] += away.astype(np.float32)
                extra = extra - away.astype(np.float32)
            self.values[name] = np.ascontiguousarray(np.concatenate([own[kept], extra]))
            self.moments[name] = [
                np.concatenate([moment[kept], np.zeros_like(moment[divided])]) for moment in self.moments[name]
            ]
        self.regions = np.concatenate([self.regions[kept], self.regions[divided]])
        self.seen = np.zeros((len(self.regions), 2), np.float32)


def loss_of(image: Floats, picture: Floats) -> tuple[float, Floats, Floats]:
    """Return the loss between pictures (4, H, W) of RGB times alpha, and alpha, its gradient by the first, and errors.

    It is the mean of a smooth absolute difference (Charbonnier) of colours on white, and that of alpha. The errors (H,
    W) are the differences of colours.
    """
    apart = image - picture
    on_white = apart[:3] - apart[3]
    lengths = np.sqrt(on_white**2 + np.float32(KNEE**2))
    alphas = np.sqrt(apart[3] ** 2 + np.float32(KNEE**2))
    scale = np.float32(1.0 / apart[3].size)
    slope = np.empty_like(apart)
    slope[:3] = on_white / lengths * scale
    slope[3] = np.float32(ALPHA) * scale * apart[3] / alphas - slope[:3].sum(axis=0)
    loss = float((lengths - KNEE).sum() + ALPHA * (alphas - KNEE).sum()) / apart[3].size
    return loss, slope, np.asarray(np.abs(on_white).sum(axis=0), np.float32)


def picture_of(scene: Scene, camera: Camera, network: str) -> Floats:
    """Return a scene's picture as RGB times alpha, and alpha. (4, height, width)"""
    image = scene.render(camera, network).rgba
    image[..., :3] *= image[..., 3:]
    return np.ascontiguousarray(image.transpose(2, 0, 1))
