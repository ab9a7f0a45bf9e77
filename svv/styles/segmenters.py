"""Segmenters, which find parts of a style picture, behind one interface: scikit-image's superpixels, or SAM.

:class:`SegmentAnything` (Kirillov et al. 2023), used by the paper, must be installed separately, package and weights,
and is experimental: the tests use a stand-in for the model.
"""

from __future__ import annotations

import os
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from svv.core.images import segmentation
from svv.core.images.segmentation import Labels, Mask, Points
from svv.errors import BadInput

SEGMENTERS = ("scikit-image", "sam")
SAM_WEIGHTS = {"vit_h": "sam_vit_h_4b8939.pth", "vit_l": "sam_vit_l_0b3195.pth", "vit_b": "sam_vit_b_01ec64.pth"}
"""Model -> file name of its weights as its authors publish them; the best model is looked for first."""
SAM_VARIABLE = "SVV_SAM_WEIGHTS"
MOST_REGIONS = 32


class Segmenter(Protocol):
    """Finds parts of pictures (h, w, 3), sRGB in [0, 1]; points are (x, y) in pixels."""

    name: str

    def regions(self, picture: NDArray[np.floating], count: int) -> Labels:
        """Divide the picture into at most ``count`` regions, numbered by size, the largest 0. (h, w)"""

    def select(
        self, picture: NDArray[np.floating], positive: Points, negative: Points, start: Mask | None = None
    ) -> Mask:
        """Select the part that the points ask for, starting from a mask if one is given. (h, w)"""


class Superpixels:
    """Superpixels, joined by their look or selected by a random walker (:mod:`svv.core.images.segmentation`)."""

    name = "scikit-image"

    def regions(self, picture: NDArray[np.floating], count: int) -> Labels:
        return segmentation.regions(picture, count)

    def select(
        self, picture: NDArray[np.floating], positive: Points, negative: Points, start: Mask | None = None
    ) -> Mask:
        return segmentation.selection(picture, positive, negative, start)


class SegmentAnything:
    """Segment Anything by its authors' package, with :func:`sam_weights`; BadInput without either."""

    name = "sam"

    def __init__(self) -> None:
        if find_spec("segment_anything") is None:
            raise BadInput(
                "SAM needs the package segment_anything, which is not installed: install it from "
                "github.com/facebookresearch/segment-anything, or use scikit-image."
            )
        file = sam_weights()
        kinds = [kind for kind in SAM_WEIGHTS if kind in file.name]
        if not file.is_file() or not kinds:
            raise BadInput(f"{file} is not a file of SAM's weights: its name must contain {' or '.join(SAM_WEIGHTS)}.")
        self._package = import_module("segment_anything")
        device = "cuda" if torch.cuda.is_available() else "cpu"
        self._model = self._package.sam_model_registry[kinds[0]](checkpoint=str(file)).to(device)

    def regions(self, picture: NDArray[np.floating], count: int) -> Labels:
        """Return the ``count - 1`` largest masks, smaller ones over larger, and the part that no mask covers."""
        masks = self._package.SamAutomaticMaskGenerator(self._model).generate(_levels(picture))
        masks = sorted((np.asarray(m["segmentation"], bool) for m in masks), key=lambda m: -int(m.sum()))
        labels = np.zeros(picture.shape[:2], np.int64)
        for number, mask in enumerate(masks[: count - 1], start=1):
            labels[mask] = number
        return segmentation.by_size(labels, len(masks) + 1)

    def select(
        self, picture: NDArray[np.floating], positive: Points, negative: Points, start: Mask | None = None
    ) -> Mask:
        predictor = self._package.SamPredictor(self._model)
        predictor.set_image(_levels(picture))
        masks, scores, _ = predictor.predict(
            point_coords=np.array([*positive, *negative], np.float32).reshape(-1, 2),
            point_labels=np.array([1] * len(positive) + [0] * len(negative)),
            mask_input=None if start is None else _low_resolution(start),
            # One point can mean a part or the whole: SAM then returns three masks with a score for each.
            multimask_output=len(positive) + len(negative) == 1 and start is None,
        )
        return np.asarray(masks[int(np.argmax(scores))], bool)


def _levels(picture: NDArray[np.floating]) -> NDArray[np.uint8]:
    return np.rint(np.clip(picture, 0, 1) * 255).astype(np.uint8)


def _low_resolution(mask: Mask) -> NDArray[np.float32]:
    """Convert a mask to the input of SAM's decoder: logits whose long side fills 256 pixels, padded. (1, 256, 256)"""
    from skimage.transform import resize

    factor = 256 / max(mask.shape)
    size = tuple(max(1, round(side * factor)) for side in mask.shape)
    logits = np.full((1, 256, 256), -10, np.float32)
    logits[0, : size[0], : size[1]] = 20 * resize(mask.astype(np.float32), size, order=1) - 10
    return logits


def sam_weights() -> Path:
    """Return SAM's weights, which ``SVV_SAM_WEIGHTS`` names, or the best in torch's cache; BadInput if none are."""
    named = os.environ.get(SAM_VARIABLE)
    if named:
        return Path(named)
    folder = Path(torch.hub.get_dir()) / "checkpoints"
    for file in SAM_WEIGHTS.values():
        if (folder / file).is_file():
            return folder / file
    raise BadInput(
        f"SAM's weights are missing: put one of {', '.join(SAM_WEIGHTS.values())} into {folder}, set {SAM_VARIABLE} "
        "to the path of such a file, or use scikit-image."
    )


def segmenter(name: str = "scikit-image") -> Segmenter:
    """Return a segmenter, ``scikit-image`` or ``sam``; raises BadInput if it is neither, or SAM is not installed."""
    if name == "scikit-image":
        return Superpixels()
    if name == "sam":
        return SegmentAnything()
    raise BadInput(f"There is no segmenter '{name}'; choose one of {', '.join(SEGMENTERS)}.")


def style_regions(picture: NDArray[np.floating], count: int, by: Segmenter | None = None) -> Labels:
    """Divide a picture (h, w, 3), sRGB in [0, 1], into at most 2 to 32 regions of like colour and texture, or with SAM.

    They are numbered by size, the largest 0 (h, w). Raises BadInput if the count is out of range, or no regions can be
    distinguished.
    """
    if not 2 <= count <= MOST_REGIONS:
        raise BadInput(f"A picture can be cut into 2 to {MOST_REGIONS} regions, not {count}.")
    labels = (by or Superpixels()).regions(picture, count)
    if labels.max() == 0:
        raise BadInput("No regions can be distinguished in this picture: use it whole, or set points.")
    return labels
