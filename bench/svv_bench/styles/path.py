"""The path of the compared frames: its cameras, depths, flows and masks, which are independent of styles.

Results are kept in folders that record what they were made from.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from svv.core.geometry.cameras import Camera
from svv.core.images.metrics import flip_map
from svv.errors import BadInput, Progress, silent
from svv.fields.scene.scene import Scene
from svv.io.files.atomic import atomic_path
from svv.io.files.keyed_results import make_keyed_folder
from svv.io.pictures.output import write_png
from svv.render.frames import orbit
from svv.render.pictures import over_white, read_png
from svv_bench.keys import key_of_measure
from svv_bench.styles.flow import (
    ABSOLUTE,
    BOUNDARY_ABSOLUTE,
    BOUNDARY_RELATIVE,
    RELATIVE,
    camera_flow,
    estimated_flow,
    is_consistent,
    is_motion_boundary,
    sampled,
    splatted,
)

Array = NDArray[np.float64]
LEAST_ALPHA = 0.1
"""Alpha from which a pixel counts as visible."""

LEAST_ARRIVED = 0.5
"""Least total weight, in pixels, that must have been splatted onto a pixel for it to be compared."""

NEARER = 1000.0
"""Importance in splatting per distance by which a point is nearer, in diameters of the camera path."""

BRIGHTER = 20.0
"""Importance without depth: minus this times the difference in grey to the flow's target (Niklaus & Liu 2020)."""

FINE: dict[str, Any] = {"stride": 0.5, "joined": 1 / 1024}
"""Sampling of depths and compared frames. With the sampling of images (:mod:`svv.train.base.sampling`), its noise,
which moves with the camera, caused three fifths of the difference between frames of an unstyled scene."""

RULES = ["straight colours", LEAST_ALPHA, LEAST_ARRIVED, NEARER, BRIGHTER, RELATIVE, ABSOLUTE, BOUNDARY_RELATIVE,
         BOUNDARY_ABSOLUTE]  # fmt: skip
"""Rules that determine pixels and warps; if they change, figures are measured again."""

METRICS = ("rmse", "mse", "flip", "rmse_part", "flip_part")
TINY = 1e-3
"""Least contrast assumed of a frame, because a plain colour agrees with itself."""


@dataclass(frozen=True)
class Protocol:
    """The frames that are compared, and the kinds of flow."""

    orbit: int = 181
    """Number of frames of the whole path."""
    size: int = 400
    """Width and height of frames in pixels."""
    every: int = 1
    """Number of frames from the beginning of one pair to that of the next."""
    intervals: tuple[int, ...] = (1, 10)
    """Numbers of frames from the first frame of a pair to its second."""
    flows: tuple[str, ...] = ("depth", "tvl1")
    """Kinds of flow: ``depth``, and estimators of :func:`svv_bench.styles.flow.estimated_flow`."""
    oversample: int = 1
    """Factor on ``size`` at which frames are drawn and warped; they are compared after averaging. Warping at 1
    interpolates between pixels, which blurs a sharp picture however still it stands."""

    def __post_init__(self) -> None:
        if not 1 <= self.oversample <= 4:
            raise BadInput(f"--oversample must lie between 1 and 4, not {self.oversample}.")
        if self.orbit < 1 + max(self.intervals):
            raise BadInput(f"An orbit of {self.orbit} frames is too short for pairs {max(self.intervals)} apart.")
        if self.every < 1 or self.size < 16:
            raise BadInput("--every must be at least 1, and frames must be at least 16 pixels wide.")

    @property
    def pairs(self) -> list[tuple[int, int, int]]:
        """Interval, first and second frame of each pair."""
        return [(n, a, a + n) for n in self.intervals for a in range(0, self.orbit - n, self.every)]

    @property
    def frames(self) -> list[int]:
        """Numbers of all frames that belong to a pair."""
        return sorted({frame for _, *both in self.pairs for frame in both})


@dataclass(frozen=True)
class Warp:
    """The motion from the first frame of a pair to the second, and the pixels of the second that are compared."""

    flow: Array
    importance: Array
    mask: NDArray[np.bool_]
    oversample: int = 1
    """Factor by which both frames are larger than what is compared."""

    def moved(self, first: NDArray[np.uint8]) -> Array:
        """Warp the first frame's levels (h, w, 3) to the second camera; NaN where nothing arrives."""
        return splatted(first / 255.0, self.flow, self.importance)[0]

    def differences(self, first: NDArray[np.uint8], second: NDArray[np.uint8]) -> dict[str, float]:
        """Return RMSE, MSE and FLIP between straight colours of two frames, levels (h, w, 3), and the share compared.

        ``rmse_part`` and ``flip_part`` are RMSE and FLIP relative to those between the second frame and its mean
        colour, because pale pictures always differ little. 0 is agreement, 1 no better than a plain colour. FLIP also
        depends on neighbours; for it, pixels that are not compared are white in both pictures.
        """
        moved, there, mask = self.compared(first, second)
        error = np.square(moved - there)[mask]
        if not len(error):
            return {**dict.fromkeys(METRICS, float("nan")), "share": 0.0}
        mean = there[mask].mean(axis=0)
        shown = [np.where(mask[..., None], picture, 1.0) for picture in (moved, there, mean)]
        mse, flip = float(error.mean()), float(flip_map(shown[0], shown[1])[mask].mean())
        plain = float(np.square(there[mask] - mean).mean()) ** 0.5
        plain_flip = float(flip_map(shown[2], shown[1])[mask].mean())
        parts = {"rmse_part": mse**0.5 / max(plain, TINY), "flip_part": flip / max(plain_flip, TINY)}
        return {"rmse": mse**0.5, "mse": mse, "flip": flip, **parts, "share": float(mask.mean())}

    def compared(self, first: NDArray[np.uint8], second: NDArray[np.uint8]) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return the first frame, warped, and the second, both in [0, 1] (h, w, 3), and the pixels compared (h, w)."""
        mask = self._averaged(self.mask[..., None].astype(np.float64))[..., 0] == 1.0
        moved, there = (
            self._averaged(np.where(self.mask[..., None], p, 0.0)) for p in (self.moved(first), second / 255.0)
        )
        return moved, there, mask

    def _averaged(self, values: Array) -> Array:
        """Average (h, w, C) over squares of ``oversample`` pixels."""
        height, width, channels = values.shape
        k = self.oversample
        return np.asarray(values.reshape(height // k, k, width // k, k, channels).mean(axis=(1, 3)))


def finely(scene: Scene) -> Scene:
    """Return the scene with more samples in images, as depth reveals details that are finer than the usual step."""
    return replace(scene, **FINE)


class OrbitPath:
    """The orbit around one geometry: cameras, depths, and the warps of its pairs. It is independent of styles.

    Args:
        scene: Scene that provides density and unstyled colours.
        protocol: The frames and kinds of flow.
        folder: Folder in which depths, unstyled frames and estimated flows are kept.
        key: Key of scene and protocol; results with another key are not reused.
        progress: Called before every frame.
    """

    def __init__(self, scene: Scene, protocol: Protocol, folder: Path, key: str, progress: Progress = silent) -> None:
        self.protocol, self.key = protocol, key_of_measure(key, FINE, RULES)
        self.folder = make_keyed_folder(folder, self.key)
        fine = protocol.size * protocol.oversample
        self.cameras: list[Camera] = orbit(scene, protocol.orbit, fine, fine)
        self.seen = orbit(scene, protocol.orbit, protocol.size, protocol.size)
        self.diameter = 2.0 * scene.rig.radius
        self.view = lru_cache(maxsize=32)(self._view)
        for number, frame in enumerate(protocol.frames):
            progress(number / len(protocol.frames), f"geometry, frame {frame}")
            if not self._file(frame).exists():
                seen = finely(scene).render(self.cameras[frame], "pcn")
                write_png(self.folder / f"{frame:04d}.png", seen.rgba)
                _save(self._file(frame), depth=seen.depth, visible=seen.rgba[..., 3] >= LEAST_ALPHA)

    def _file(self, frame: int) -> Path:
        return self.folder / f"{frame:04d}.npz"

    def picture(self, frame: int) -> NDArray[np.uint8]:
        """Return the unstyled frame over white."""
        return over_white(read_png(self.folder / f"{frame:04d}.png"))

    def render(self, scene: Scene, network: str, frame: int) -> NDArray[np.float32]:
        """Render one frame of a scene as RGBA, straight alpha; strokes are as soft as in a frame that is compared."""
        return scene.resolving(self.seen[frame]).render(self.cameras[frame], network).rgba

    def _view(self, frame: int) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Return the depth, NaN where nothing counts as visible, and the mask of visible pixels."""
        with np.load(self._file(frame)) as content:
            visible = content["visible"]
            return np.where(visible, content["depth"], np.nan).astype(np.float32), visible

    def warp(self, kind: str, first: int, second: int) -> Warp:
        """Return the warp of a pair, by ``depth`` or by the estimator of that name."""
        (depth, seen), (other, seen_there) = self.view(first), self.view(second)
        if kind == "depth":
            a, b = self.cameras[first], self.cameras[second]
            flow, back = camera_flow(a, b, depth), camera_flow(b, a, other)
            importance = -NEARER * np.nan_to_num(depth, nan=0.0).astype(np.float64) / self.diameter
        else:
            flow, back, importance = self.estimated(kind, first, second)
            flow = np.where(seen[..., None], flow, np.nan)
            back = np.where(seen_there[..., None], back, np.nan)
        mask = is_consistent(back, flow) & ~is_motion_boundary(back)
        _, arrived = splatted(np.zeros((*seen.shape, 1)), flow, importance)
        return Warp(flow, importance, mask & (arrived >= LEAST_ARRIVED), self.protocol.oversample)

    def estimated(self, kind: str, first: int, second: int) -> tuple[Array, Array, Array]:
        """Return flow there and back, and importance, estimated from the unstyled pictures; kept as half floats.

        The flows are those of all pixels, also of the background.
        """
        file = self.folder / f"{kind}-{first:04d}-{second:04d}.npz"
        one, two = (self.picture(frame).mean(axis=-1) / 255.0 for frame in (first, second))
        if not file.exists():
            flows = estimated_flow(one, two, kind), estimated_flow(two, one, kind)
            _save(file, **{name: f.astype(np.float16) for name, f in zip(("there", "back"), flows)})
        with np.load(file) as content:
            there, back = (content[name].astype(np.float64) for name in ("there", "back"))
        led = sampled(two[..., None], there)[..., 0]
        return there, back, -BRIGHTER * np.abs(one - np.nan_to_num(led, nan=2.0))


def _save(path: Path, **arrays: NDArray[Any]) -> None:
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
