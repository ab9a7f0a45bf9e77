"""What finds parts of a style picture: scikit-image's superpixels, or SAM where it is installed; one interface.

:class:`Superpixels` is the default and needs nothing more. :class:`SegmentAnything` (Kirillov et al. 2023) is what the
paper uses; neither its package nor its weights come with this one, and it is experimental: tests show how its package
is called and how its answers are used, with a stand-in for the model, never what the model itself finds.
"""

from __future__ import annotations

import os
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from svv.core import segmentation
from svv.core.segmentation import Labels, Mask, Points
from svv.errors import BadInput

SEGMENTERS = ("scikit-image", "sam")
SAM_WEIGHTS = {"vit_h": "sam_vit_h_4b8939.pth", "vit_l": "sam_vit_l_0b3195.pth", "vit_b": "sam_vit_b_01ec64.pth"}
"""Model -> the name under which its authors give its weights away; the best is looked for first."""
SAM_VARIABLE = "SVV_SAM_WEIGHTS"
MOST_REGIONS = 32


class Segmenter(Protocol):
    """Finds parts of pictures (h, w, 3), sRGB in [0, 1]; places are (x, y) in pixels."""

    name: str

    def regions(self, picture: NDArray[np.floating], count: int) -> Labels:
        """The picture in at most ``count`` regions, numbered by size from 0. (h, w)"""

    def select(
        self, picture: NDArray[np.floating], positive: Points, negative: Points, start: Mask | None = None
    ) -> Mask:
        """What the points ask for, going on from a mask if there is one. (h, w)"""


class Superpixels:
    """Superpixels joined by colour and texture; points by a random walker over them (:mod:`svv.core.segmentation`)."""

    name = "scikit-image"

    def regions(self, picture: NDArray[np.floating], count: int) -> Labels:
        return segmentation.regions(picture, count)

    def select(
        self, picture: NDArray[np.floating], positive: Points, negative: Points, start: Mask | None = None
    ) -> Mask:
        return segmentation.selection(picture, positive, negative, start)


class SegmentAnything:
    """Segment Anything, with its authors' package and weights.

    Args:
        weights: Where the weights are; by default where ``SVV_SAM_WEIGHTS`` says, or in torch's cache.

    Raises:
        BadInput: the package or the weights are not there.
    """

    name = "sam"

    def __init__(self, weights: Path | None = None) -> None:
        if find_spec("segment_anything") is None:
            raise BadInput(
                "SAM needs the package segment_anything, which is not installed: install it from "
                "github.com/facebookresearch/segment-anything, or use scikit-image."
            )
        file = weights or sam_weights()
        kinds = [kind for kind in SAM_WEIGHTS if kind in file.name]
        if not file.is_file() or not kinds:
            raise BadInput(f"{file} is no file of SAM's weights: their names say {', '.join(SAM_WEIGHTS)}.")
        self._package: Any = import_module("segment_anything")
        device = "cuda" if torch.cuda.is_available() else "cpu"
        self._model = self._package.sam_model_registry[kinds[0]](checkpoint=str(file)).to(device)

    def regions(self, picture: NDArray[np.floating], count: int) -> Labels:
        """The ``count - 1`` largest masks, smaller ones over larger, and what none of them covers as the last."""
        masks = self._package.SamAutomaticMaskGenerator(self._model).generate(_levels(picture))
        masks = sorted((np.asarray(m["segmentation"], bool) for m in masks), key=lambda m: -int(m.sum()))
        labels = np.zeros(picture.shape[:2], np.int64)
        for number, mask in enumerate(masks[: count - 1], start=1):
            labels[mask] = number
        areas = np.bincount(labels.ravel(), minlength=len(masks) + 1)
        place = np.empty(len(areas), np.int64)
        place[np.argsort(-areas, kind="stable")] = np.arange(len(areas))
        return place[labels]

    def select(
        self, picture: NDArray[np.floating], positive: Points, negative: Points, start: Mask | None = None
    ) -> Mask:
        predictor = self._package.SamPredictor(self._model)
        predictor.set_image(_levels(picture))
        masks, scores, _ = predictor.predict(
            point_coords=np.array([*positive, *negative], np.float32).reshape(-1, 2),
            point_labels=np.array([1] * len(positive) + [0] * len(negative)),
            mask_input=None if start is None else _low_resolution(start),
            # One point may mean a part or the whole: SAM then offers three masks, and says which it trusts most.
            multimask_output=len(positive) + len(negative) == 1 and start is None,
        )
        return np.asarray(masks[int(np.argmax(scores))], bool)


def _levels(picture: NDArray[np.floating]) -> NDArray[np.uint8]:
    return np.rint(np.clip(picture, 0, 1) * 255).astype(np.uint8)


def _low_resolution(mask: Mask) -> NDArray[np.float32]:
    """A mask as SAM's decoder takes it: logits on 256 x 256, the long side filled, the rest outside. (1, 256, 256)"""
    from skimage.transform import resize

    factor = 256 / max(mask.shape)
    size = tuple(max(1, round(side * factor)) for side in mask.shape)
    logits = np.full((1, 256, 256), -10, np.float32)
    logits[0, : size[0], : size[1]] = 20 * resize(mask.astype(np.float32), size, order=1) - 10
    return logits


def sam_weights() -> Path:
    """The file of SAM's weights: where ``SVV_SAM_WEIGHTS`` says, else the best model in torch's cache.

    Raises:
        BadInput: there is none.
    """
    named = os.environ.get(SAM_VARIABLE)
    if named:
        return Path(named)
    folder = Path(torch.hub.get_dir()) / "checkpoints"
    for file in SAM_WEIGHTS.values():
        if (folder / file).is_file():
            return folder / file
    raise BadInput(
        f"SAM's weights are not there: put one of {', '.join(SAM_WEIGHTS.values())} into {folder}, say with "
        f"{SAM_VARIABLE} where one is, or use scikit-image."
    )


def segmenter(name: str = "scikit-image") -> Segmenter:
    """What finds parts of pictures, by name: ``scikit-image`` or ``sam``.

    Raises:
        BadInput: another name, or SAM where it is not installed.
    """
    if name == "scikit-image":
        return Superpixels()
    if name == "sam":
        return SegmentAnything()
    raise BadInput(f"There is no segmenter '{name}'; choose one of {', '.join(SEGMENTERS)}.")


def style_regions(picture: NDArray[np.floating], count: int, by: Segmenter | None = None) -> Labels:
    """A picture in regions by likeness of colour and texture, or by SAM.

    Args:
        picture: (h, w, 3) sRGB in [0, 1].
        count: 2 to 32.
        by: What finds them.

    Returns:
        Region of each pixel, numbered by size, the largest 0; as many as asked for, or fewer. (h, w)

    Raises:
        BadInput: a count out of range, or a picture in which nothing can be told apart.
    """
    if not 2 <= count <= MOST_REGIONS:
        raise BadInput(f"A picture can be cut into 2 to {MOST_REGIONS} regions, not {count}.")
    labels = (by or Superpixels()).regions(picture, count)
    if labels.max() == 0:
        raise BadInput("No regions can be told apart in this picture: use it whole, or set points.")
    return labels
