"""Laws and published values of the metrics."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.ndimage import correlate

from svv.core.images.metrics import Likeness, flip, on_white, psnr, psnr_foreground, ssim
from svv.errors import BadInput
from svv.train.lpips import CHANNELS, MIN_SIZE, Lpips, load_lpips, lpips


def picture(seed: int = 0, size: int = 48) -> np.ndarray:
    return np.random.default_rng(seed).random((size, size, 3))


@pytest.mark.parametrize(("error", "decibels"), [(0.1, 20.0), (0.01, 40.0), (0.5, 6.0206), (1.0, 0.0)])
def test_psnr_of_a_known_error(error: float, decibels: float) -> None:
    assert psnr(np.zeros((4, 5, 3)) + error, np.zeros((4, 5, 3))) == pytest.approx(decibels, abs=1e-4)


def test_equal_pictures_are_perfect() -> None:
    truth = picture()
    assert psnr(truth, truth) == np.inf
    assert ssim(truth, truth) == pytest.approx(1)
    assert flip(truth, truth) == pytest.approx(0, abs=1e-6)


def test_predictions_are_clamped() -> None:
    truth = np.ones((16, 16, 3))
    assert psnr(truth * 3, truth) == np.inf
    assert ssim(truth * 3, truth) == pytest.approx(1)
    assert flip(truth * 3, truth) == pytest.approx(0, abs=1e-6)


def test_likeness_of_views_is_the_mean_of_the_metrics_on_white() -> None:
    rng = np.random.default_rng(5)
    truth = rng.integers(0, 256, (3, 24, 20, 4), dtype=np.uint8)
    truth[0, ..., 3] = 0  # nothing there: it has no foreground, and has no part in its mean
    shown = rng.random((3, 24, 20, 3))
    white = truth[..., :3] / 255 * (truth[..., 3:] / 255) + 1 - truth[..., 3:] / 255
    np.testing.assert_allclose([on_white(image) for image in truth], white, atol=1e-6)
    found = Likeness.mean([Likeness.of(*pair) for pair in zip(shown, truth, strict=True)])
    pairs = list(zip(shown, white, truth[..., 3], strict=True))
    assert found.psnr == pytest.approx(np.mean([psnr(s, w) for s, w, _ in pairs]), abs=1e-4)
    assert found.psnr_foreground == pytest.approx(np.mean([psnr_foreground(*p) for p in pairs[1:]]), abs=1e-4)
    assert found.ssim == pytest.approx(np.mean([ssim(s, w) for s, w, _ in pairs]), abs=1e-5)


def test_white_background_flatters_psnr_and_not_the_foreground() -> None:
    truth, alpha = np.ones((10, 10, 3)), np.zeros((10, 10))
    truth[:3, :3], alpha[:3, :3] = 0.5, 0.004  # 9 % of the pixels, hardly opaque
    wrong = truth.copy()
    wrong[:3, :3] += 0.1
    assert psnr_foreground(wrong, truth, alpha) == pytest.approx(20)
    assert psnr(wrong, truth) == pytest.approx(20 - 10 * np.log10(0.09))
    assert np.isnan(psnr_foreground(wrong, truth, alpha * 0))
    assert psnr_foreground(wrong, truth, alpha + 1) == pytest.approx(psnr(wrong, truth))


def test_ssim_is_the_formula_with_an_11_tap_gaussian() -> None:
    truth, prediction = picture(0, 24), picture(1, 24) * 0.3 + picture(0, 24) * 0.7
    tap = np.exp(-0.5 * (np.arange(-5, 6) / 1.5) ** 2)
    window = np.outer(tap, tap)[..., None] / tap.sum() ** 2

    def blur(image: np.ndarray) -> np.ndarray:
        return np.asarray(correlate(image, window, mode="reflect"))[5:-5, 5:-5]

    mean_t, mean_p = blur(truth), blur(prediction)
    var_t, var_p = blur(truth**2) - mean_t**2, blur(prediction**2) - mean_p**2
    covariance = blur(truth * prediction) - mean_t * mean_p
    c1, c2 = 0.01**2, 0.03**2
    expected = (2 * mean_t * mean_p + c1) * (2 * covariance + c2)
    expected /= (mean_t**2 + mean_p**2 + c1) * (var_t + var_p + c2)
    assert ssim(prediction, truth) == pytest.approx(expected.mean(), abs=1e-9)
    assert ssim(prediction, truth) == pytest.approx(ssim(truth, prediction))


def test_flip_grows_with_the_error_and_stays_below_one() -> None:
    truth = picture() * 0.5 + 0.25
    small, large = flip(np.clip(truth + 0.03, 0, 1), truth), flip(np.clip(truth + 0.3, 0, 1), truth)
    assert 0 < small < large < 1
    assert flip(truth, truth + 0.03) == pytest.approx(small, rel=1e-3)  # the pixel error is symmetric
    assert 0.95 < flip(np.ones((40, 40, 3)), np.zeros((40, 40, 3))) < 1  # black for white is nearly the worst


def test_pictures_that_cannot_be_compared_are_bad_input() -> None:
    for bad in (picture(0, 47), picture()[..., :1], picture()[0]):
        for metric in (psnr, ssim, flip):
            with pytest.raises(BadInput):
                metric(bad, picture())
    with pytest.raises(BadInput, match="alpha"):
        psnr_foreground(picture(), picture(), np.ones((3, 3)))
    with pytest.raises(BadInput, match="11"):
        ssim(picture(0, 10), picture(0, 10))


@pytest.fixture(scope="module")
def network() -> Lpips:
    """The architecture with random weights: the published ones may not be shipped, so no value is checked here."""
    torch.manual_seed(0)
    return Lpips().eval()


def test_lpips_is_a_distance_whatever_its_weights(network: Lpips) -> None:
    a, b = picture(0, 64).astype(np.float32), picture(1, 64).astype(np.float32)
    assert lpips(network, a, a) == 0
    assert lpips(network, a, b) == pytest.approx(lpips(network, b, a))
    near = lpips(network, a, np.clip(a + 0.02, 0, 1))
    assert 0 < near < lpips(network, a, b)


def test_lpips_of_unit_heads_is_at_most_4_a_layer_and_linear_in_the_heads(network: Lpips) -> None:
    a, b = picture(0, 64), picture(1, 64)
    one = lpips(network, a, b)
    assert one <= 4 * len(CHANNELS)  # unit vectors are at most 2 apart
    doubled = Lpips()
    doubled.load_state_dict({k: v * (1 + k.startswith("heads")) for k, v in network.state_dict().items()})
    assert lpips(doubled, a, b) == pytest.approx(2 * one, rel=1e-5)


def test_lpips_smallest_picture(network: Lpips) -> None:
    assert lpips(network, picture(0, MIN_SIZE), picture(0, MIN_SIZE)) == 0
    with pytest.raises(BadInput, match="31"):
        lpips(network, picture(0, MIN_SIZE - 1), picture(0, MIN_SIZE - 1))
    with pytest.raises(RuntimeError):
        network(*torch.rand(2, 1, 3, MIN_SIZE - 1, MIN_SIZE - 1))


def test_alexnet_has_the_published_number_of_weights(network: Lpips) -> None:
    assert sum(p.numel() for p in network.features.parameters()) == 2_469_696  # convolutions of torchvision's AlexNet


def test_without_weights_there_is_no_lpips(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(torch.hub, "get_dir", lambda: str(tmp_path))
    assert load_lpips() is None


def test_weights_are_found_checked_and_loaded(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, network: Lpips) -> None:
    monkeypatch.setenv("SVV_WEIGHTS", str(tmp_path / "kept"))
    trunk, heads = tmp_path / "checkpoints" / "alexnet-owt-7be5be79.pth", tmp_path / "lpips/weights/v0.1/alex.pth"
    trunk.parent.mkdir()
    heads.parent.mkdir(parents=True)
    (tmp_path / "lpips/__init__.py").write_text("raise ImportError('its code must not be run')")
    state = network.state_dict()
    torch.save({**{k: v for k, v in state.items() if k[0] == "f"}, "classifier.1.weight": torch.zeros(1)}, trunk)
    torch.save({f"lin{i}.model.1.weight": state[f"heads.{i}"] * 0.5 for i in range(5)}, heads)
    monkeypatch.setattr(torch.hub, "get_dir", lambda: str(tmp_path))
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(BadInput, match="not the published"):
        load_lpips()
    monkeypatch.setattr("svv.styles.weight_files.ALEXNET_SHA256_PREFIX", "")
    loaded = load_lpips()
    assert loaded is not None
    a, b = picture(0, 64), picture(1, 64)
    assert lpips(loaded, a, b) == pytest.approx(lpips(network, a, b) / 2, rel=1e-5)
