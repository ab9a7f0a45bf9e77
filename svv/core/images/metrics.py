"""Image metrics that compare a picture with the truth, as in docs/measurements/protocol.md.

All pictures are (h, w, 3) sRGB in [0, 1]: the truth is blended on white and the prediction is clamped. A metric is
computed per view; its value for a set of views is the mean.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from skimage.metrics import structural_similarity

from svv.core.colour.colour import WHITE, over
from svv.core.images.flip import error_map
from svv.errors import BadInput

Image = NDArray[np.floating]
"""A picture, (h, w, 3) sRGB in [0, 1]."""
SSIM_TAPS = 11
"""Width of the SSIM window in pixels."""


@dataclass(frozen=True)
class Likeness:
    """Similarity of a picture to the truth, or the means over several pictures."""

    psnr: float
    """Peak signal-to-noise ratio in dB; see :func:`psnr`."""
    psnr_foreground: float
    """Peak signal-to-noise ratio of the foreground in dB; see :func:`psnr_foreground`."""
    ssim: float
    """Structural similarity; see :func:`ssim`."""

    @classmethod
    def of(cls, shown: Image, truth: NDArray[np.uint8]) -> Likeness:
        """Compare a picture on white (h, w, 3) with the true view (h, w, 4), straight alpha.

        Raises BadInput if the pictures differ in size or are smaller than 11 x 11 pixels.
        """
        white = on_white(truth)
        return cls(psnr(shown, white), psnr_foreground(shown, white, truth[..., 3]), ssim(shown, white))

    @classmethod
    def mean(cls, views: Sequence[Likeness]) -> Likeness:
        """Return the means over views, ignoring nan (views without a foreground)."""
        psnrs, foregrounds, ssims = (
            float(np.nanmean([getattr(v, name) for v in views])) for name in ("psnr", "psnr_foreground", "ssim")
        )
        return cls(psnrs, foregrounds, ssims)


def on_white(truth: NDArray[np.uint8]) -> NDArray[np.floating]:
    """Blend a view with straight alpha (h, w, 4) on white for comparison; (h, w, 3) in [0, 1]."""
    return over(truth.astype(np.float32) / np.float32(255.0), WHITE)


def psnr(prediction: Image, truth: Image) -> float:
    """Return the peak signal-to-noise ratio -10 log10 MSE in dB; infinite for equal pictures."""
    prediction, truth = _validate_pair(prediction, truth)
    return _decibels((prediction - truth) ** 2)


def psnr_foreground(prediction: Image, truth: Image, alpha: NDArray[np.floating] | NDArray[np.uint8]) -> float:
    """Return the PSNR in dB over the pixels whose true alpha (h, w) is above 0; nan if there are none.

    A white background, which every method reproduces, inflates the PSNR of sparse scenes; here it is excluded.
    """
    prediction, truth = _validate_pair(prediction, truth)
    if alpha.shape != truth.shape[:2]:
        raise BadInput(f"The alpha is {alpha.shape}, the picture {truth.shape[:2]}; give the truth's alpha.")
    return _decibels(((prediction - truth) ** 2)[alpha > 0])


def ssim(prediction: Image, truth: Image) -> float:
    """Return the structural similarity (Wang et al. 2004): 11-tap Gaussian, sigma 1.5; 1 for equal pictures."""
    prediction, truth = _validate_pair(prediction, truth)
    if min(truth.shape[:2]) < SSIM_TAPS:
        raise BadInput(f"SSIM needs pictures of {SSIM_TAPS} x {SSIM_TAPS} pixels or more; render them larger.")
    value = structural_similarity(
        truth,
        prediction,
        gaussian_weights=True,
        sigma=1.5,
        truncate=3.5,  # radius int(3.5 * 1.5 + 0.5) = 5, so 11 taps
        use_sample_covariance=False,
        data_range=1.0,
        channel_axis=2,
    )
    return float(value)


def flip(prediction: Image, truth: Image) -> float:
    """Return the mean FLIP error (Andersson et al. 2020), LDR, 67 pixels per degree; 0 if equal, at most 1."""
    return float(flip_map(prediction, truth).mean())


def flip_map(prediction: Image, truth: Image) -> NDArray[np.float32]:
    """Return the FLIP error of each pixel (h, w); see :func:`flip`."""
    return error_map(*_validate_pair(prediction, truth))


def _decibels(squared_error: NDArray[np.floating]) -> float:
    if not squared_error.size:
        return float("nan")
    mean = float(squared_error.mean())
    return float(-10 * np.log10(mean)) if mean > 0 else float("inf")


def _validate_pair(prediction: Image, truth: Image) -> tuple[Image, Image]:
    if prediction.shape != truth.shape or truth.ndim != 3 or truth.shape[2] != 3:
        raise BadInput(
            f"Pictures of {prediction.shape} and {truth.shape} cannot be compared; make both (height, width, 3)."
        )
    return np.clip(prediction.astype(np.float64), 0, 1), truth.astype(np.float64)
