"""The Triton kernels of images and of training steps, compared with those of the CPU and with plain torch.

They run on a GPU if there is one, otherwise in Triton's interpreter. See ``tests/test_triton_kernels.py``.
"""

from __future__ import annotations

import numpy as np
import pytest
import torch

from svv.core.geometry.box import Box
from svv.core.geometry.cameras import sphere_cameras
from svv.fields.devices.image_checks import image_checks
from svv.fields.devices.training_checks import training_checks
from svv.io.views.viewset import ViewSet
from svv.train.run import batches
from svv.train.run.batches import RayPool
from svv.train.run.views_there import ViewsThere, sorted_by_contrast
from tests.interpreted import GPU, triton_kernels
from tests.nightly import nightly

DEVICE = torch.device("cuda" if GPU else "cpu")


CHECKS = image_checks(150) | training_checks(150)


@pytest.mark.parametrize("name", CHECKS)
@pytest.mark.parametrize("seed", nightly([0, 1], 0))
def test_a_kernel_gives_what_the_cpu_gives(name: str, seed: int) -> None:
    CHECKS[name](triton_kernels, DEVICE, seed)


def test_a_card_draws_pixels_as_the_cpu_does_on_average(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each ray has its pixel's colour, parts of a batch are those of the whole, and weighted means are those of all."""
    rng = np.random.default_rng(0)
    images = rng.integers(0, 256, (3, 24, 24, 4)).astype(np.uint8)
    images[:, :, :10, 3] = 0
    images[:, :, 16:] = (90, 60, 30, 255)
    views = ViewSet(tuple(sphere_cameras(3, (0.0, 0.0, 0.0), 3.0, 0.5, 24)), images, tuple("abc"))
    own = ViewsThere(torch.from_numpy(images), *sorted_by_contrast(torch.from_numpy(images)))
    index, levels = own.index, own.levels.view(-1, 4)
    box, rays = Box.of_bounds((-0.5,) * 3, (0.5,) * 3), 60_000
    on_cpu = RayPool(views, box, 4, torch.device("cpu"))
    monkeypatch.setattr(batches, "views_on", lambda views, device: own)
    pool = RayPool(views, box, 4, torch.device("cpu"))
    whole, part, other = (
        pool.batch(2, rays, by_contrast=0.5), pool.batch(2, rays, slice(100, 300), 0.5), pool.batch(3, rays),
    )  # fmt: skip
    levels_there = levels[whole.pixels].float() / 255.0
    torch.testing.assert_close(whole.shown[:, 3], levels_there[:, 3])
    torch.testing.assert_close(whole.shown[:, :3], levels_there[:, :3] * levels_there[:, 3:])
    assert torch.equal(part.pixels, whole.pixels[100:300]) and torch.equal(part.weight, whole.weight[100:300])
    assert part.first == 100 and not torch.equal(other.pixels, whole.pixels)
    shown = levels[index.long()].float() / 255.0
    for drawn in (whole, on_cpu.batch(2, rays, by_contrast=0.5)):
        mean = (drawn.weight[:, None] * drawn.shown).sum(dim=0)
        torch.testing.assert_close(mean[3], shown[:, 3].mean(), atol=0.01, rtol=0.0)
        assert float(drawn.weight.sum()) == pytest.approx(1.0, abs=0.01)
    assert len(whole.pixels.unique()) > 0.95 * len(index)
    for most in (100_000, 50):
        for mine, theirs in zip(pool.visible_colours(most), on_cpu.visible_colours(most), strict=True):
            np.testing.assert_array_equal(mine, theirs)
