"""Sort-last compositing: the order of boxes is that of the rays through them, and layers add up to the whole."""

from __future__ import annotations

import numpy as np
import pytest

from svv.core.rays.sort_last import front_to_back, over
from svv.errors import BadInput

FULL = 32767


def divided(rng: np.random.Generator, low: np.ndarray, high: np.ndarray, parts: int) -> list[np.ndarray]:
    """Divide a box of whole numbers into parts by planes, each of which cuts one part: (2, 3) corners of each."""
    boxes = [np.stack([low, high])]
    while len(boxes) < parts:
        box = boxes.pop(rng.integers(len(boxes)))
        axis = int(np.argmax(box[1] - box[0]))
        cut = rng.integers(box[0, axis] + 1, box[1, axis])
        first, second = box.copy(), box.copy()
        first[1, axis] = second[0, axis] = cut
        boxes += [first, second]
    return boxes


def entries(box: np.ndarray, start: np.ndarray, direction: np.ndarray) -> float | None:
    """Where a ray enters a box; None if it misses it or only touches it."""
    with np.errstate(divide="ignore", invalid="ignore"):
        times = (box - start) / direction
    near, far = np.nanmax(times.min(axis=0)), np.nanmin(times.max(axis=0))
    return None if far <= max(near, 0.0) + 1e-9 else max(near, 0.0)


@pytest.mark.parametrize("parallel", [False, True])
@pytest.mark.parametrize("seed", range(6))
def test_rays_pass_boxes_in_their_order(seed: int, parallel: bool) -> None:
    """Against rays through points of the boxes; the camera may be inside, and on a plane between two boxes."""
    rng = np.random.default_rng(seed)
    boxes = np.array(divided(rng, np.zeros(3, int), np.array([16, 12, 9]), 11), float)
    eye = rng.integers(-8, 24, 3).astype(float) if seed % 2 else rng.uniform(-8, 24, 3)
    if parallel:
        eye[seed % 3] *= seed % 2
    order = front_to_back(boxes[:, 0], boxes[:, 1], eye, parallel)
    assert sorted(order) == list(range(11))
    place = np.argsort(order)
    for _ in range(300):
        aim = rng.uniform([0, 0, 0], [16, 12, 9])
        start, direction = (aim - 100.0 * eye, eye) if parallel else (eye, aim - eye)
        hits = [
            (entry, place[i]) for i, box in enumerate(boxes) if (entry := entries(box, start, direction)) is not None
        ]
        assert [place for _, place in sorted(hits)] == sorted(place for _, place in hits)


def test_boxes_that_overlap_have_no_order() -> None:
    low, high = np.zeros((2, 3)), np.array([[2.0, 2, 2], [3, 3, 3]])
    with pytest.raises(BadInput, match="hide each other"):
        front_to_back(low, high, np.full(3, 9.0), False)


def test_layers_are_composited_as_samples_are() -> None:
    """Layers of samples are as good as the samples: *over* is associative. An opaque layer hides what is behind it."""
    rng = np.random.default_rng(1)
    alpha = rng.uniform(0.0, 0.6, (6, 5, 4, 1))
    samples = np.rint(FULL * alpha * np.append(rng.uniform(0, 1, (6, 5, 4, 3)), np.ones((6, 5, 4, 1)), axis=-1))
    layers = np.stack([over(part.astype(np.uint16), FULL) for part in np.split(samples, 3)])
    whole = over(samples.astype(np.uint16), FULL).astype(int)
    assert np.abs(over(layers, FULL).astype(int) - whole).max() <= 2
    transparency = np.prod(1.0 - samples[..., 3] / FULL, axis=0)
    assert np.abs(whole[..., 3] / FULL - (1.0 - transparency)).max() < 1e-4
    front = np.full((1, 5, 4, 4), FULL, np.uint16)
    assert (over(np.concatenate([front, layers]), FULL) == FULL).all()
