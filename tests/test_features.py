"""Feature networks: shapes, files and refused inputs; the style loss: what it responds to and what it ignores."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file
from torch import nn

from svv.core.images.nnfm import luminance
from svv.core.rounding import sums_apart
from svv.errors import BadInput
from svv.styles.features import PatchFeatures, VggFeatures, load_features, read_features
from svv.train.match.style_loss import PAPER_LOSS, StyleLossSettings, StyleTarget, solid
from tests.untrained import vgg16_state

SMALL = StyleLossSettings(style_size=64)


@pytest.mark.parametrize(("height", "width"), [(40, 56), (41, 59), (23, 100)])
def test_features_are_maps_of_a_quarter_of_the_resolution(height: int, width: int) -> None:
    network = load_features("embedded")
    found = network(torch.rand(2, 3, height, width))
    assert found.shape == (2, network.channels, height // 4, width // 4)
    assert torch.isfinite(found).all()
    assert not any(p.requires_grad for p in network.parameters())


def test_features_depend_on_the_picture_differentiably() -> None:
    for network in (PatchFeatures(), VggFeatures()):
        image = torch.rand(1, 3, 32, 32, requires_grad=True)
        network(image).square().sum().backward()
        assert image.grad is not None and (image.grad != 0).float().mean() > 0.9


def test_cosine_patches_are_an_orthonormal_basis_weighed_by_frequency() -> None:
    network = PatchFeatures(8)
    basis = network.kernels.flatten(1)
    gram = basis @ basis.T
    frequency = torch.hypot(*torch.meshgrid(torch.arange(8.0), torch.arange(8.0), indexing="ij")).flatten()
    frequency[0] = 1
    rounding, largest = sums_apart(8 * 8), float(frequency.max())
    torch.testing.assert_close(gram, torch.diag(frequency**2), rtol=0, atol=rounding * largest**2)
    flat = network(torch.full((1, 3, 32, 32), 0.25))[0, :, 4, 4].view(3, 64)
    torch.testing.assert_close(flat[:, 0], torch.full((3,), 2.0), rtol=rounding, atol=0)  # 64 times 0.25 over sqrt 64
    torch.testing.assert_close(flat[:, 1:], torch.zeros(3, 63), rtol=0, atol=rounding * 2 * largest)


def test_vgg16_is_read_from_pth_and_safetensors_and_gives_conv3_of_all_three(tmp_path: Path) -> None:
    torch.manual_seed(0)
    state = vgg16_state()
    torch.save(state, tmp_path / "vgg.pth")
    save_file(state, tmp_path / "vgg.safetensors")
    image = torch.rand(1, 3, 32, 48)
    first, second = (load_features(str(tmp_path / name))(image) for name in ("vgg.pth", "vgg.safetensors"))
    torch.testing.assert_close(first, second)
    assert first.shape == (1, 768, 8, 12)
    plain: list[nn.Module] = []  # the same layers put together as torchvision does, without padding's influence
    for number in (0, 2, None, 5, 7, None, 10, 12, 14):
        if number is None:
            plain.append(nn.MaxPool2d(2))
            continue
        weight = state[f"features.{number}.weight"]
        layer = nn.Conv2d(weight.shape[1], weight.shape[0], 3, padding=1)
        layer.load_state_dict({"weight": weight, "bias": state[f"features.{number}.bias"]})
        plain += [layer, nn.ReLU()]
    image = torch.rand(1, 3, 64, 64)
    mean, deviation = torch.tensor([0.485, 0.456, 0.406]), torch.tensor([0.229, 0.224, 0.225])
    expected = nn.Sequential(*plain)((image - mean[:, None, None]) / deviation[:, None, None])
    found = load_features(str(tmp_path / "vgg.pth"))(image)[:, 512:]
    torch.testing.assert_close(found[..., 6:10, 6:10], expected[..., 6:10, 6:10], rtol=1e-3, atol=1e-3)


def test_files_that_are_not_weights_are_refused(tmp_path: Path) -> None:
    (tmp_path / "text.pth").write_text("hello")
    (tmp_path / "text.safetensors").write_text("hello")
    torch.save([1, 2], tmp_path / "list.pth")
    torch.save({"model": nn.Linear(2, 2)}, tmp_path / "pickled.pth")
    save_file({"a": torch.zeros(2)}, tmp_path / "other.safetensors")
    wrong = vgg16_state()
    wrong["features.0.weight"] = torch.zeros(3, 3, 3, 3)
    torch.save(wrong, tmp_path / "shapes.pth")
    for name in (
        "missing.pth",
        "text.pth",
        "text.safetensors",
        "list.pth",
        "pickled.pth",
        "other.safetensors",
        "shapes.pth",
    ):
        with pytest.raises(BadInput):
            read_features(tmp_path / name)


def stripes(along: int, size: int = 64) -> torch.Tensor:
    """Red and blue stripes of 4 pixels, of the same colours in either direction."""
    index = torch.arange(size) // 4 % 2
    picture = torch.zeros(3, size, size)
    picture[0], picture[2] = index[:, None].expand(size, size), 1 - index[:, None].expand(size, size)
    return picture if along == 0 else picture.transpose(1, 2)


@pytest.mark.parametrize("loss", [replace(SMALL, variation=0.0), replace(PAPER_LOSS, style_size=64)])
def test_the_style_loss_prefers_the_strokes_of_its_style(loss: StyleLossSettings) -> None:
    target = StyleTarget(PatchFeatures(), stripes(0), loss)
    mask = torch.ones(64, 64)
    own, other = target.loss(stripes(0), mask), target.loss(stripes(1), mask)
    flat = target.loss(torch.full((3, 64, 64), 0.5), mask)
    assert own < 0.2 * other and own < 0.2 * flat


def test_what_is_masked_out_does_not_matter() -> None:
    mask = torch.zeros(64, 64)
    mask[16:48, 16:48] = 1
    losses = []
    for beyond in (0.0, 1.0):
        target = StyleTarget(PatchFeatures(), stripes(0), SMALL)
        picture = stripes(1).clone()
        picture[:, :4] = beyond  # far from the region: no patch that is matched reaches it
        losses.append(target.loss(picture, mask))
    torch.testing.assert_close(*losses)
    empty = StyleTarget(PatchFeatures(), stripes(0), SMALL).loss(stripes(1).requires_grad_(), torch.zeros(64, 64))
    assert torch.isfinite(empty)


@pytest.mark.parametrize("network", [PatchFeatures(), VggFeatures()])
def test_a_small_region_is_matched_in_a_crop_with_the_same_loss(
    network: PatchFeatures | VggFeatures, monkeypatch: pytest.MonkeyPatch
) -> None:
    generator = torch.Generator().manual_seed(0)
    mask = torch.zeros(160, 144)
    mask[70:111, 33:66] = 1.0
    picture = torch.where(mask > 0, torch.rand(3, 160, 144, generator=generator), 0.5)
    seen: list[int] = []
    network.register_forward_pre_hook(lambda _, inputs: seen.append(inputs[0][0, 0].numel()))

    def loss() -> torch.Tensor:
        seen.clear()
        return StyleTarget(network, stripes(0), SMALL).loss(picture, mask)

    small, pixels = loss(), max(seen)
    monkeypatch.setattr("svv.train.match.style_loss.cropped", lambda picture, cover: (picture, cover))
    torch.testing.assert_close(small, loss(), rtol=sums_apart(160 * 144), atol=0)
    assert pixels < 0.4 * max(seen)


def test_the_background_is_the_luminance_of_the_style_s_mean_colour() -> None:
    style = torch.tensor([0.9, 0.2, 0.4])[:, None, None].expand(3, 64, 64)
    target = StyleTarget(PatchFeatures(), style, SMALL)
    rounding = sums_apart(64 * 64)  # of the mean over the pixels
    assert target.background == pytest.approx(float(luminance(torch.tensor([0.9, 0.2, 0.4]))), rel=rounding)
    assert 0 <= target.background <= 1


def test_styles_that_are_flat_dark_or_tiny_give_a_finite_loss() -> None:
    render, mask = torch.rand(3, 48, 48, requires_grad=True), torch.ones(48, 48)
    for style in (torch.zeros(3, 16, 16), torch.full((3, 40, 40), 0.11), torch.rand(3, 16, 300), torch.rand(3, 20, 16)):
        loss = StyleTarget(PatchFeatures(), style, SMALL).loss(render, mask)
        (gradient,) = torch.autograd.grad(loss, render)
        assert torch.isfinite(loss) and torch.isfinite(gradient).all()


def test_a_translucent_region_is_seen_as_its_own_colour() -> None:
    colour, background = torch.rand(3, 20, 20), 0.3
    mask = torch.full((20, 20), 0.25)
    mask[:, 10:] = 0
    seen, opaque = solid(colour * mask + background * (1 - mask), mask, background)
    torch.testing.assert_close(opaque, (mask > 0).float())
    torch.testing.assert_close(seen[:, :, :10], colour[:, :, :10])
    torch.testing.assert_close(seen[:, :, 10:], torch.full((3, 20, 10), background))
    torch.testing.assert_close(solid(colour, torch.ones(20, 20), background)[0], colour)
    torch.testing.assert_close(solid(colour, torch.zeros(20, 20), background)[0], colour)
