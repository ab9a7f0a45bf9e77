"""Silhouettes that one pass over pictures finds are those of masks, one for each level, made with NumPy."""

from __future__ import annotations

from dataclasses import replace

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, uniform_filter

from svv.core.view_checks.agreement import CLEANED, CONTRASTS, OPACITIES, Tracing, some_of, step_of
from svv.core.view_checks.silhouettes import Silhouettes
from tests.nightly import nightly

Images = NDArray[np.uint8]
Masks = list[NDArray[np.bool_]]


def contrast(images: Images) -> Images:
    """How much pixels differ from the background: that of empty pixels, or black if alpha has many levels."""
    alpha = images[..., 3]
    if np.isin(alpha[:, ::4, ::4], (0, 255)).all():
        empty = images[..., :3][alpha == 0]
        background = np.median(empty[:: max(1, len(empty) // 10000)], axis=0) if len(empty) else np.zeros(3)
        apart = np.abs(images[..., :3].astype(np.int16) - background.astype(np.int16)).max(axis=-1)
        return np.where(alpha > 0, apart, 0).astype(np.uint8)
    return (images[..., :3].max(axis=-1).astype(np.uint16) * alpha // 255).astype(np.uint8)


def masks_of(images: Images) -> Masks:
    """The masks of all levels. (levels) x (n, height, width)"""
    alpha = images[..., 3]
    masks = [alpha > level for level in OPACITIES] + [contrast(images) > level for level in CONTRASTS]
    return masks + [uniform_filter((alpha > level).astype(np.float32), (0, 3, 3)) > 0.5 for level in CLEANED]


def expected(images: Images, step: int) -> tuple[list[Silhouettes], list[bool]]:
    """The silhouettes of the levels that differ and that three pictures have, and which are of alpha."""
    masks = masks_of(images[:, step // 2 :: step, step // 2 :: step])
    of_alpha = np.repeat((True, False, True), (len(OPACITIES), len(CONTRASTS), len(CLEANED)))
    different = [k for k, m in enumerate(masks) if not any(np.array_equal(m, other) for other in masks[:k])]
    found = {k: Silhouettes.of(list(masks[k]), step) for k in different}
    found = {k: silhouettes for k, silhouettes in found.items() if silhouettes.usable.sum() > 2}
    visible = masks[len(OPACITIES) + len(CONTRASTS)]
    cut = visible[:, [0, -1]].any(axis=(1, 2)) | visible[:, :, [0, -1]].any(axis=(1, 2))
    for k, silhouettes in found.items():  # where three frames show the whole, those that cut it off do not count
        if (silhouettes.usable & ~cut).sum() > 2:
            found[k] = replace(silhouettes, usable=silhouettes.usable & ~cut)
    return list(found.values()), of_alpha[list(found)].tolist()


def same(images: Images, chosen: NDArray[np.intp], tracing: Tracing) -> bool:
    """Whether the silhouettes of some pictures are those expected, and whether there are any."""
    found = tracing.outlines(chosen)
    levels, of_alpha = expected(images[chosen], step_of(images))
    assert found.of_alpha.tolist() == of_alpha
    for own, silhouettes in zip(found.levels, levels, strict=True):
        assert np.array_equal(own.usable, silhouettes.usable)
        assert np.array_equal(own.points, silhouettes.points)
    return len(levels) > 0


def discs(count: int, height: int, width: int, rng: np.random.Generator) -> Images:
    """Soft discs, some of which the edge of the picture cuts off, over a coloured background."""
    y, x = np.mgrid[:height, :width]
    images = rng.integers(0, 256, (count, height, width, 4)).astype(np.uint8)
    for image in images:
        centre, radius = rng.uniform(0.2, 0.8, 2) * (height, width), rng.uniform(0.05, 0.4) * min(height, width)
        away = np.hypot(y - centre[0], x - centre[1]) / radius
        image[..., 3] = 255 * np.clip(2.0 - 2.0 * away, 0.0, 1.0)
        image[..., :3] = rng.integers(0, 256, 3)
    return images


def hard(images: Images, rng: np.random.Generator) -> Images:
    """The same with alpha that is 0 or 255, and a background of noise."""
    images[..., 3] = np.where(images[..., 3] > 128, 255, 0)
    empty = images[..., 3] == 0
    images[empty, :3] = rng.integers(90, 256, (int(empty.sum()), 3))
    return images


def dusty(images: Images, rng: np.random.Generator) -> Images:
    images[rng.random(images.shape[:3]) < 0.01] = 200
    return images


def grainy(images: Images, rng: np.random.Generator) -> Images:
    images[..., 3] = images[..., 3] * rng.random(images.shape[:3])
    return images


def half_empty(images: Images, rng: np.random.Generator) -> Images:
    images[::2] = 0
    return images


def cloudy(images: Images, rng: np.random.Generator) -> Images:
    noise = gaussian_filter(rng.random(images.shape[:3]), (0, 2, 2))
    images[..., 3] = np.clip(2000.0 * (noise - 0.55), 0, 255)
    images[:, [0, -1], :, 3] = images[:, :, [0, -1], 3] = 0
    return images


KINDS = {"discs": lambda images, rng: images, "hard": hard, "dust": dusty, "grain": grainy, "half empty": half_empty,
         "clouds": cloudy}  # fmt: skip


@given(
    st.sampled_from(sorted(KINDS)), st.integers(3, 7), st.integers(1, 40), st.integers(1, 40), st.integers(0, 1 << 30)
)
def test_silhouettes_are_those_of_masks(kind: str, count: int, height: int, width: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    images = KINDS[kind](discs(count, height, width, rng), rng)
    same(images, np.arange(count), Tracing(images))


@pytest.mark.parametrize("kind", nightly(KINDS, "hard", "clouds"))
def test_large_pictures_are_thinned_out(kind: str) -> None:
    rng = np.random.default_rng(5)
    images = KINDS[kind](discs(9, 601, 1003, rng), rng)
    assert step_of(images) == 3
    assert same(images, np.arange(9), Tracing(images))


def test_pictures_may_be_looked_at_in_groups() -> None:
    """A group whose alpha is 0 or 255 is told by its own background, although its pictures were seen before."""
    rng = np.random.default_rng(6)
    images = discs(24, 50, 60, rng)
    images[8:] = hard(images[8:], rng)
    images[16:][images[16:, ..., 3] == 0] = (10, 250, 30, 0)
    tracing = Tracing(images)
    for chosen in (np.arange(24), np.arange(8, 24), np.arange(8, 16), np.arange(16, 24), np.arange(0, 24, 2)):
        assert same(images, chosen, tracing)


def test_no_pixel_of_a_thin_or_tiny_picture_is_read_beyond_its_edge() -> None:
    for height, width in ((1, 1), (1, 2000), (2000, 1), (2, 1300), (5, 5)):
        images = np.full((3, height, width, 4), 255, np.uint8)
        assert Tracing(images).outlines(some_of(3)).levels == ()  # all of them touch the edge


def test_silhouettes_do_not_depend_on_the_number_of_threads() -> None:
    images = cloudy(discs(12, 90, 110, np.random.default_rng(7)), np.random.default_rng(8))
    before, found = numba.get_num_threads(), []
    try:
        for threads in (1, numba.config.NUMBA_NUM_THREADS):
            numba.set_num_threads(threads)
            found.append(Tracing(images).outlines(some_of(12)))
    finally:
        numba.set_num_threads(before)
    for one, many in zip(*(outlines.levels for outlines in found), strict=True):
        assert np.array_equal(one.points, many.points) and np.array_equal(one.usable, many.usable)
