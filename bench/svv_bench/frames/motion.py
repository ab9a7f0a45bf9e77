"""The motion between two frames of a folder: estimated from pictures, or read from files of flows or depths.

Flows are in pixels as in :mod:`svv_bench.styles.flow`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from svv.core.geometry.cameras import Camera
from svv.errors import BadInput
from svv.io.files.atomic import atomic_path
from svv.io.files.keyed_results import make_keyed_folder
from svv.io.views.transforms import camera_in, read_transforms, transforms_file
from svv_bench.frames.sequence import FrameFolder
from svv_bench.styles.flow import (
    camera_flow,
    estimated_flow,
    is_consistent,
    is_motion_boundary,
    sampled,
    splatted,
)
from svv_bench.styles.path import BRIGHTER, LEAST_ARRIVED, Warp

Flow = NDArray[np.float64]

FLO = 202021.25
"""First number of a Middlebury flow file (.flo)."""
UNKNOWN = 1e9
"""Components of a .flo file above this mean that the flow is unknown."""


@dataclass(frozen=True)
class Motion:
    """The motion from the first frame of a pair to the second, in both directions."""

    there: Flow
    """Flow from the first frame to the second, of every pixel; nan where it is unknown. (h, w, 2)"""
    back: Flow
    """Flow from the second frame to the first. (h, w, 2)"""
    importance: NDArray[np.float64]
    """Which pixel of the first frame wins where several arrive: the one that fits the second frame better. (h, w)"""

    def warp(self, seen: NDArray[np.bool_], seen_there: NDArray[np.bool_]) -> Warp:
        """Return the warp of what both frames show, by the checks of the protocol for scenes.

        Args:
            seen: Pixels of the first frame that show something. (h, w)
            seen_there: Pixels of the second frame that do. (h, w)
        """
        flow, back = (np.where(s[..., None], f, np.nan) for s, f in ((seen, self.there), (seen_there, self.back)))
        _, arrived = splatted(np.zeros((*seen.shape, 1)), flow, self.importance)
        mask = is_consistent(back, flow) & ~is_motion_boundary(back) & (arrived >= LEAST_ARRIVED)
        return Warp(flow, self.importance, mask)


class Source(ABC):
    """Where the motion comes from.

    Args:
        guide: The frames by which colliding pixels are told apart, and from which flows are estimated.
    """

    name: str
    """Name of the flow in tables."""
    sharpness = BRIGHTER
    """How much importance falls with the difference in grey to the flow's target."""

    def __init__(self, guide: FrameFolder) -> None:
        self.guide = guide

    @abstractmethod
    def flows(self, first: int, second: int) -> tuple[Flow, Flow]:
        """Return the flows from one frame to another and back, by their numbers."""

    def between(self, first: int, second: int) -> Motion:
        """Return the motion from one frame to a later one, by their numbers."""
        there, back = self.flows(first, second)
        one, two = (grey(self.guide, number) for number in (first, second))
        return Motion(there, back, fitting(one, two, there, self.sharpness))


class Estimated(Source):
    """Flows that are estimated from the pictures, and kept.

    Args:
        guide: The frames from which flows are estimated.
        name: ``tvl1`` or ``ilk``; see :func:`svv_bench.styles.flow.estimated_flow`.
        folder: Folder in which flows are kept.
        key: Key of the frames; flows of other frames are removed.
    """

    def __init__(self, guide: FrameFolder, name: str, folder: Path, key: str) -> None:
        super().__init__(guide)
        self.name, self.folder = name, make_keyed_folder(folder, key)

    def flows(self, first: int, second: int) -> tuple[Flow, Flow]:
        """Return the flows from one frame to another and back, kept as half floats."""
        file = self.folder / f"{first}-{second}.npz"
        if not file.exists():
            one, two = (grey(self.guide, number) for number in (first, second))
            there, back = (estimated_flow(a, b, self.name).astype(np.float16) for a, b in ((one, two), (two, one)))
            with atomic_path(file) as temporary, temporary.open("wb") as stream:
                np.savez_compressed(stream, there=there, back=back)
        with np.load(file) as content:
            return content["there"].astype(np.float64), content["back"].astype(np.float64)


class FlowFiles(Source):
    """Flows in files: ``frame0001.flo`` or ``.npy`` leads from ``frame0001.png`` to the next frame.

    Flows over several frames are chained. The flow back is the flow itself, moved along itself: where nothing arrives,
    the later frame shows what the earlier one hides.
    """

    name = "given"
    sharpness = 500.0  # two flows that arrive at one place must not be blended

    def __init__(self, guide: FrameFolder, folder: Path) -> None:
        super().__init__(guide)
        self.files = _one_each(guide, folder, guide.numbers[:-1], (".flo", ".npy"), "flow")

    def flows(self, first: int, second: int) -> tuple[Flow, Flow]:
        """Return the chained flow, and the flow back."""
        there = self._flow(first)
        for number in self.guide.numbers[self.guide.numbers.index(first) + 1 : self.guide.numbers.index(second)]:
            there = there + sampled(self._flow(number), there)
        one, two = (grey(self.guide, number) for number in (first, second))
        back, _ = splatted(-there, there, fitting(one, two, there, self.sharpness))
        return there, back

    def _flow(self, number: int) -> Flow:
        return read_flow(self.files[number], self.guide.size)


class DepthFiles(Source):
    """Depths in files, ``frame0001.npy`` for ``frame0001.png``, and the cameras in the same folder's transforms.json.

    Depths are distances along a pixel's ray in world units, nan or infinite where nothing is visible.
    """

    name = "depth"

    def __init__(self, guide: FrameFolder, folder: Path) -> None:
        super().__init__(guide)
        self.files = _one_each(guide, folder, guide.numbers, (".npy",), "depth")
        path, scene, frames = read_transforms(folder, "train")
        cameras = {Path(str(frame.get("file_path", ""))).stem: frame for frame in frames}
        self.cameras: dict[int, Camera] = {}
        for number, file in zip(guide.numbers, guide.files):
            if file.stem not in cameras:
                raise BadInput(f"{path} has no camera for the frame {file.name}: add one whose file_path is its name.")
            camera, lens = camera_in(path, scene, cameras[file.stem], *guide.size)
            if lens is not None:
                raise BadInput(f"The camera of {file.name} in {path} distorts: give frames and depths of a pinhole.")
            self.cameras[number] = camera

    def flows(self, first: int, second: int) -> tuple[Flow, Flow]:
        """Return the flows of a static scene, from its depths and cameras."""
        a, b = self.cameras[first], self.cameras[second]
        return camera_flow(a, b, self._depth(first)), camera_flow(b, a, self._depth(second))

    def between(self, first: int, second: int) -> Motion:
        """Return the motion; of pixels that collide, the nearest one wins."""
        there, back = self.flows(first, second)
        depth = self._depth(first)
        known = np.isfinite(depth)
        span = float(np.ptp(depth[known])) if known.any() else 0.0
        # From the nearest to the farthest pixel, importance falls by 500: as in the protocol for scenes, no blending.
        return Motion(there, back, -500.0 * np.where(known, depth, 0.0) / max(span, 1e-12))

    def _depth(self, number: int) -> NDArray[np.float64]:
        depth = _array(self.files[number])
        width, height = self.guide.size
        if depth.shape[:2] != (height, width) or depth.squeeze().ndim != 2:
            raise BadInput(f"{self.files[number]} is not a depth of {height} x {width} numbers, but {depth.shape}.")
        depth = depth.reshape(height, width)
        return np.where(np.isfinite(depth) & (depth > 0), depth, np.nan)


def given_motion(guide: FrameFolder, folder: Path) -> Source:
    """Return the motion that files in a folder give: depths if there is a transforms.json, otherwise flows.

    Raises:
        BadInput: A frame has no file, or one has another form.
    """
    return FlowFiles(guide, folder) if transforms_file(folder, "train") is None else DepthFiles(guide, folder)


def grey(guide: FrameFolder, number: int) -> NDArray[np.float64]:
    """Return the mean of a frame's channels, in [0, 1]. (h, w)"""
    return np.asarray(guide.whole(number).mean(axis=-1))


def fitting(one: NDArray[np.floating], two: NDArray[np.floating], flow: Flow, sharpness: float) -> NDArray[np.float64]:
    """Return how well each pixel of a grey picture fits another where the flow leads; larger is better. (h, w)"""
    led = sampled(two[..., None], flow)[..., 0]
    return np.asarray(-sharpness * np.abs(one - np.nan_to_num(led, nan=2.0)))


def read_flow(file: Path, size: tuple[int, int]) -> Flow:
    """Read a flow of pictures of (width, height) pixels: Middlebury's .flo, or an array (h, w, 2) as .npy.

    Returns:
        The flow, nan where it is unknown. (h, w, 2)

    Raises:
        BadInput: The file is damaged, has another form, or another size.
    """
    width, height = size
    if file.suffix.lower() == ".flo":
        content = file.read_bytes()
        stated = np.frombuffer(content[4:12], "<i4").tolist() if len(content) >= 12 else []
        if not stated or np.frombuffer(content[:4], "<f4")[0] != np.float32(FLO):
            raise BadInput(f"{file} is not a Middlebury flow file: write it as .flo, or as .npy (h, w, 2).")
        if stated != [width, height] or len(content) != 12 + 8 * width * height:
            raise BadInput(f"{file} is no flow of {width} x {height} pixels, or is truncated: write it again.")
        values = np.frombuffer(content[12:], "<f4").reshape(height, width, 2).astype(np.float64)
        return np.where(np.abs(values) < UNKNOWN, values, np.nan)
    values = _array(file)
    if values.shape != (height, width, 2):
        raise BadInput(f"{file} is not a flow of {height} x {width} x 2 numbers, but {values.shape}.")
    return np.where(np.isfinite(values), values, np.nan)


def _array(file: Path) -> NDArray[np.float64]:
    try:
        return np.asarray(np.load(file, allow_pickle=False), np.float64)
    except (OSError, ValueError, TypeError, EOFError) as error:
        raise BadInput(
            f"{file} is not an array of numbers that can be read ({error}): write it with numpy.save."
        ) from error


def _one_each(
    guide: FrameFolder, folder: Path, numbers: tuple[int, ...], suffixes: tuple[str, ...], what: str
) -> dict[int, Path]:
    """Return the file of each of these frames, which has the frame's name but for its suffix."""
    names = dict(zip(guide.numbers, guide.files))
    found = {}
    for number in numbers:
        stem = names[number].stem
        there = [folder / f"{stem}{suffix}" for suffix in suffixes if (folder / f"{stem}{suffix}").is_file()]
        if not there:
            raise BadInput(f"{folder} has no {what} for {names[number].name}: it would be {stem}{suffixes[0]}.")
        found[number] = there[0]
    return found
