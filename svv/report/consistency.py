"""Cross-view consistency: frames of an orbit warped onto each other, and how much they differ there.

The protocol, after StyleRF-VolVis (section "Evaluation metrics"): pairs of frames an interval apart on the 181-view
path, 1 for short-range and 10 for long-range consistency; the earlier one is moved onto the later one by softmax
splatting along the optical flow. Compared are the pixels that are visible in both frames, pass the forward-backward
check and are not on a motion boundary. The flow comes once from the scene's expected depth and once from an estimator
that sees pictures of the unstyled scene only.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from svv import __version__
from svv.core.cameras import Camera
from svv.core.flow import (
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
from svv.core.metrics import flip_map
from svv.errors import BadInput, Progress, part, silent
from svv.fields.scene import Scene
from svv.io.atomic import atomic_path, make_folder, to_json, write_json
from svv.io.output import write_png
from svv.report.pictures import over_white, read_png
from svv.report.render import orbit

Array = NDArray[np.float64]
Frame = Callable[[int], NDArray[np.floating]]
"""RGBA of a frame of the orbit, straight alpha in [0, 1] (h, w, 4), by its number."""

LEAST_ALPHA = 0.1
"""Opacity from which on a pixel counts as visible."""

LEAST_ARRIVED = 0.5
"""Part of a pixel that must have been splatted onto a pixel for it to be compared."""

NEARER = 1000.0
"""Importance in splatting: this times how much nearer a point is, in diameters of the camera path."""

BRIGHTER = 20.0
"""The same without depth: minus this times the difference in grey to where the flow leads (Niklaus & Liu 2020)."""

FINE: dict[str, Any] = {"stride": 0.5, "joined": 1 / 1024}
"""Sampling of depths and compared frames. With that of images (:mod:`svv.train.sampling`) the noise of sampling, which
moves with the camera, was three fifths of what frames of an unstyled scene differed by."""

RULES = [LEAST_ALPHA, LEAST_ARRIVED, NEARER, BRIGHTER, RELATIVE, ABSOLUTE, BOUNDARY_RELATIVE, BOUNDARY_ABSOLUTE]
"""What decides on pixels and warps: figures under other rules are measured anew."""

METRICS = ("rmse", "mse", "flip", "rmse_part", "flip_part")
TINY = 1e-3
"""Contrast below which a frame counts as having this much: a plain colour agrees with itself."""

SAVE_EVERY = 20
"""Pairs that are measured between two savings."""


@dataclass(frozen=True)
class Protocol:
    """Which frames are compared, and how."""

    orbit: int = 181
    """Frames of the whole path."""
    size: int = 400
    """Width and height in pixels."""
    every: int = 1
    """A pair begins at every so manyth frame."""
    intervals: tuple[int, ...] = (1, 10)
    """Frames from the first of a pair to its second."""
    flows: tuple[str, ...] = ("depth", "tvl1")
    """``depth``, and estimators of :func:`svv.core.flow.estimated_flow`."""

    def __post_init__(self) -> None:
        if self.orbit < 1 + max(self.intervals):
            raise BadInput(f"An orbit of {self.orbit} frames has no two that are {max(self.intervals)} apart.")
        if self.every < 1 or self.size < 16:
            raise BadInput("Pairs begin at every 1st frame or fewer, and frames have 16 pixels or more.")

    @property
    def pairs(self) -> list[tuple[int, int, int]]:
        """Interval, first and second frame of each pair."""
        return [(n, a, a + n) for n in self.intervals for a in range(0, self.orbit - n, self.every)]

    @property
    def frames(self) -> list[int]:
        """Numbers of all frames that are in a pair."""
        return sorted({frame for _, *both in self.pairs for frame in both})


@dataclass(frozen=True)
class Warp:
    """How the first frame of a pair is moved onto the second, and which pixels of the second are compared then."""

    flow: Array
    importance: Array
    mask: NDArray[np.bool_]

    def moved(self, first: NDArray[np.uint8]) -> Array:
        """The first frame, levels (h, w, 3), as it is seen from the second camera; nan where nothing arrives."""
        return splatted(first / 255.0, self.flow, self.importance)[0]

    def differences(self, first: NDArray[np.uint8], second: NDArray[np.uint8]) -> dict[str, float]:
        """RMSE, MSE and FLIP between two frames over white, levels (h, w, 3), and the share of pixels compared.

        ``rmse_part`` and ``flip_part`` are RMSE and FLIP as parts of what they are between the second frame and its
        mean colour: pale pictures differ little whatever they show, and here they gain nothing by it. 0 is agreement, 1
        no better than a plain colour. Pixels that are not compared are white in both pictures for FLIP, which looks at
        neighbours, too.
        """
        moved = self.moved(first)
        there = second / 255.0
        error = np.square(moved - there)[self.mask]
        if not len(error):
            return {**dict.fromkeys(METRICS, float("nan")), "share": 0.0}
        mean = there[self.mask].mean(axis=0)
        shown = [np.where(self.mask[..., None], picture, 1.0) for picture in (moved, there, mean)]
        mse, flip = float(error.mean()), float(flip_map(shown[0], shown[1])[self.mask].mean())
        plain = float(np.square(there[self.mask] - mean).mean()) ** 0.5
        plain_flip = float(flip_map(shown[2], shown[1])[self.mask].mean())
        parts = {"rmse_part": mse**0.5 / max(plain, TINY), "flip_part": flip / max(plain_flip, TINY)}
        return {"rmse": mse**0.5, "mse": mse, "flip": flip, **parts, "share": float(self.mask.mean())}


def finely(scene: Scene) -> Scene:
    """A scene whose images take more samples: what a step of the marching is too coarse for, depth shows."""
    return replace(scene, **FINE)


class OrbitPath:
    """The orbit around one geometry: cameras, depths, and the warps of its pairs. Styles have no part in it.

    Args:
        scene: Whose density and unstyled colours are seen.
        protocol: Which frames.
        folder: Where depths, unstyled frames and estimated flows are kept.
        key: What tells whether those that are there are of this scene and protocol.
        progress: Called after every frame.
    """

    def __init__(self, scene: Scene, protocol: Protocol, folder: Path, key: str, progress: Progress = silent) -> None:
        self.protocol, self.key = protocol, digest([key, FINE, RULES])
        self.folder = kept(folder, self.key)
        self.cameras: list[Camera] = orbit(scene, protocol.orbit, protocol.size, protocol.size)
        self.diameter = 2.0 * float(scene.camera_rig["radius"])
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
        """The unstyled frame over white."""
        return over_white(read_png(self.folder / f"{frame:04d}.png"))

    def render(self, scene: Scene, network: str, frame: int) -> NDArray[np.float32]:
        """RGBA of one frame of a scene, straight alpha."""
        return scene.render(self.cameras[frame], network).rgba

    def _view(self, frame: int) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Depth, nan where nothing counts as visible, and what does."""
        with np.load(self._file(frame)) as content:
            visible = content["visible"]
            return np.where(visible, content["depth"], np.nan).astype(np.float32), visible

    def warp(self, kind: str, first: int, second: int) -> Warp:
        """The warp of a pair, by ``depth`` or by the estimator of that name."""
        (depth, seen), (other, seen_there) = self.view(first), self.view(second)
        if kind == "depth":
            a, b = self.cameras[first], self.cameras[second]
            flow, back = camera_flow(a, b, depth), camera_flow(b, a, other)
            importance = -NEARER * np.nan_to_num(depth, nan=0.0).astype(np.float64) / self.diameter
        else:
            flow, back, importance = self._estimated(kind, first, second)
            flow = np.where(seen[..., None], flow, np.nan)
            back = np.where(seen_there[..., None], back, np.nan)
        mask = is_consistent(back, flow) & ~is_motion_boundary(back)
        _, arrived = splatted(np.zeros((*seen.shape, 1)), flow, importance)
        return Warp(flow, importance, mask & (arrived >= LEAST_ARRIVED))

    def _estimated(self, kind: str, first: int, second: int) -> tuple[Array, Array, Array]:
        """Flow there and back, and importance, read from the unstyled pictures; kept as half floats."""
        file = self.folder / f"{kind}-{first:04d}-{second:04d}.npz"
        one, two = (self.picture(frame).mean(axis=-1) / 255.0 for frame in (first, second))
        if not file.exists():
            flows = estimated_flow(one, two, kind), estimated_flow(two, one, kind)
            _save(file, **{name: f.astype(np.float16) for name, f in zip(("there", "back"), flows)})
        with np.load(file) as content:
            there, back = (content[name].astype(np.float64) for name in ("there", "back"))
        led = sampled(two[..., None], there)[..., 0]
        return there, back, -BRIGHTER * np.abs(one - np.nan_to_num(led, nan=2.0))


def draw_frames(folder: Path, key: str, numbers: Sequence[int], make: Frame, progress: Progress = silent) -> Path:
    """Write frames that are not there yet as ``folder/0000.png`` ...; frames of another key are removed first."""
    kept(folder, key)
    for index, number in enumerate(numbers):
        progress(index / len(numbers), f"frame {index + 1} of {len(numbers)}")
        path = folder / f"{number:04d}.png"
        if not path.exists():
            write_png(path, make(number))
    progress(1.0, "frames")
    return folder


def measure_frames(path: OrbitPath, frames: Path, progress: Progress = silent) -> list[dict[str, Any]]:
    """Differences of all pairs of a folder of frames; those that are in its ``pairs.json`` are not measured again.

    Returns:
        One record a pair and kind of flow: ``flow``, ``interval``, ``first``, ``second``, ``rmse``, ``mse``, ``flip``,
        ``share`` (of the image's pixels that were compared).
    """
    file = frames / "pairs.json"
    records = _read(file, path.key)
    found = {(r["flow"], r["first"], r["second"]) for r in records}
    wanted = [(kind, n, a, b) for kind in path.protocol.flows for n, a, b in path.protocol.pairs]
    left = [pair for pair in wanted if (pair[0], *pair[2:]) not in found]
    for index, (kind, interval, first, second) in enumerate(left):
        progress(index / len(left), f"{kind} flow, frames {first} and {second}")
        one, two = (over_white(read_png(frames / f"{number:04d}.png")) for number in (first, second))
        values = path.warp(kind, first, second).differences(one, two)
        records.append({"flow": kind, "interval": interval, "first": first, "second": second, **values})
        if index % SAVE_EVERY == 0 or index == len(left) - 1:
            write_json(file, {"key": path.key, "pairs": records})
    progress(1.0, "measured")
    return records


def means(records: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """A row for each kind of flow and interval: the means over its pairs in which anything could be compared."""
    groups = dict.fromkeys((r["flow"], r["interval"]) for r in records)
    rows = []
    for flow, interval in groups:
        own = [r for r in records if (r["flow"], r["interval"]) == (flow, interval) and r["share"] > 0]
        names = (*METRICS, "share")
        values = {name: float(np.mean([r[name] for r in own])) if own else None for name in names}
        rows.append({"flow": flow, "interval": interval, "pairs": len(own), **values})
    return rows


def flow_error(path: OrbitPath, kind: str) -> dict[int, float]:
    """Mean distance in pixels of an estimator's flow from the depth's, where that one is checked; by interval."""
    result: dict[int, list[float]] = {}
    for interval, first, second in path.protocol.pairs:
        exact, guess = path.warp("depth", first, second), path.warp(kind, first, second)
        back = camera_flow(path.cameras[second], path.cameras[first], path.view(second)[0])
        checked = is_consistent(exact.flow, back)
        distance = np.linalg.norm(guess.flow - exact.flow, axis=-1)[checked]
        result.setdefault(interval, []).append(float(np.nanmean(distance)))
    return {interval: float(np.mean(values)) for interval, values in result.items()}


def consistency(
    scene: Scene, network: str, protocol: Protocol, out: Path, key: str, progress: Progress = silent
) -> dict[str, Any]:
    """Short- and long-range consistency of a scene's own orbit.

    Args:
        scene: What is measured.
        network: ``base``, ``pcn`` or ``styled``.
        protocol: Which frames.
        out: Folder of frames, geometry and results; what is there of the same key is not done again.
        key: What tells the scene.
        progress: Called several times a second; stops the work when it raises, and the same call goes on.

    Returns:
        ``rows`` of :func:`means`, and ``flow_error``: for each estimator :func:`flow_error`.
    """
    how = digest({"scene": key, "protocol": asdict(protocol)})
    path = OrbitPath(scene, protocol, out / "geometry", how, part(progress, 0.0, 0.2))
    frames = draw_frames(
        out / "frames", f"{how}-{network}", protocol.frames,
        partial(path.render, finely(scene), network), part(progress, 0.2, 0.4),
    )  # fmt: skip
    rows = means(measure_frames(path, frames, part(progress, 0.4, 0.95)))
    errors = {}
    for kind in protocol.flows:
        if kind != "depth":
            progress(0.95, f"{kind} against depth")
            errors[kind] = flow_error(path, kind)
    progress(1.0, "measured")
    return {"rows": rows, "flow_error": errors}


def digest(content: Any) -> str:
    """A hash of bytes, or of plain values and of our version."""
    if not isinstance(content, bytes):
        plain = json.loads(to_json({"version": __version__, "content": content}))
        content = json.dumps(plain, sort_keys=True).encode()
    return hashlib.sha256(content).hexdigest()[:16]


def kept(folder: Path, key: str) -> Path:
    """A folder whose content is of that key: made where it is missing, emptied where it is of another."""
    note = folder / "key.json"
    if folder.exists() and not note.exists() and any(folder.iterdir()):
        raise BadInput(f"{folder} holds something else; choose another folder with --out.")
    if note.exists() and _read_key(note) != key:
        shutil.rmtree(folder)
    make_folder(folder)
    if not note.exists():
        write_json(note, {"key": key})
    return folder


def _read_key(note: Path) -> str | None:
    try:
        return str(json.loads(note.read_text(encoding="utf-8"))["key"])
    except (OSError, ValueError, KeyError, TypeError):
        return None  # nothing that can be relied on


def _read(file: Path, key: str) -> list[dict[str, Any]]:
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        return list(content["pairs"]) if content["key"] == key else []
    except (OSError, ValueError, KeyError, TypeError):
        return []  # not begun, or nothing that can be relied on


def _save(path: Path, **arrays: NDArray[Any]) -> None:
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
