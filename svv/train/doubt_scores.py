"""Whether a scene knows how far its pictures can be trusted: expected errors beside those of views it never saw.

Pixels are averaged in tiles, of which only those count that show something, or should. The sparsification error (Ilg et
al. 2018, "Uncertainty estimates and multi-hypotheses networks for optical flow") is the mean error of what is left as
tiles are taken away, the most doubtful first, less the same with the largest errors first.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from svv.core.colour.colour import WHITE
from svv.core.images.metrics import on_white
from svv.errors import Progress, silent
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet

TILE = 8
"""Side of the tiles in pixels."""

MOST_VIEWS = 16
"""Most views that are looked at, evenly spaced among all."""

Array = NDArray[np.floating]


@dataclass(frozen=True)
class DoubtScores:
    """How well expected errors are those of unseen views; NaN where all errors, or all doubts, are alike."""

    doubt_rank: float
    """Spearman's rank correlation of both, in [-1, 1]; 1 is best."""
    doubt_area: float
    """Area under the sparsification error, relative to the mean error; 0 is best."""
    doubt_ratio: float
    """Mean expected error, divided by the mean error; 1 is best."""

    def to_json(self) -> dict[str, float | None]:
        """Return plain values, None for NaN."""
        return {name: None if np.isnan(value) else value for name, value in asdict(self).items()}


def doubt_scores(scene: Scene, views: ViewSet, progress: Progress = silent) -> DoubtScores:
    """Return how well a scene's expected errors are those of views that it was not trained on.

    Raises BadInput if the scene does not know its errors (:func:`svv.fields.scene.doubt.expected_of`).
    """
    chosen = np.unique(np.linspace(0, len(views) - 1, MOST_VIEWS).round().astype(int)).tolist()
    network, doubts, errors = "pcn" if "pcn" in scene.networks else "base", list[Array](), list[Array]()
    for number in chosen:
        progress(len(doubts) / len(chosen), "evaluating doubt")
        shown, truth = scene.render(views.cameras[number], network, WHITE), views.images[number]
        there = tiles(((truth[..., 3] > 0) | np.isfinite(shown.depth)).astype(np.float32)) > 0.0
        error = np.abs(shown.rgba[..., :3] - on_white(truth)).mean(axis=2)
        errors.append(tiles(error)[there])
        doubts.append(tiles(np.nan_to_num(scene.doubt(views.cameras[number])))[there])
    return scores_of(np.concatenate(doubts), np.concatenate(errors))


def tiles(values: Array) -> Array:
    """Return the means of tiles of an image (H, W), without what is left over at its ends. (H / TILE, W / TILE)"""
    height, width = (max(1, side // TILE) for side in values.shape)
    side = [min(TILE, n) for n in values.shape]
    whole = values[: height * side[0], : width * side[1]]
    return np.asarray(whole.reshape(height, side[0], width, side[1]).mean(axis=(1, 3)))


def scores_of(doubts: Array, errors: Array) -> DoubtScores:
    """Return the scores of expected and true errors (N,), N >= 0, both >= 0.

    >>> scores_of(np.array([0.1, 0.2, 0.3]), np.array([0.2, 0.4, 0.6])).doubt_ratio
    0.5
    """
    if len(errors) < 2 or np.ptp(errors) == 0.0 or np.ptp(doubts) == 0.0:
        return DoubtScores(float("nan"), float("nan"), float("nan"))
    left = np.arange(1, len(errors) + 1)

    def remaining(order: NDArray[np.intp]) -> Array:
        return np.asarray(np.cumsum(errors[order], dtype=np.float64) / left)

    area = float((remaining(np.argsort(doubts, kind="stable")) - remaining(np.argsort(errors))).mean() / errors.mean())
    rank = float(spearmanr(doubts, errors).statistic)
    return DoubtScores(rank, area, float(doubts.mean() / errors.mean()))
