"""Parts of pictures: known parts are found, points are obeyed, and all segmenters share one interface."""

from __future__ import annotations

import sys
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from svv.core.images.filling import filled
from svv.core.images.segmentation import neighbours, regions, selection, superpixels
from svv.errors import BadInput
from svv.styles.segmenters import SAM_VARIABLE, SAM_WEIGHTS, SegmentAnything, Superpixels, segmenter, style_regions

H, W = 72, 96
CASES = 12


def patchwork(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Red above, blue at the lower left, grey checks at the lower right: the picture, and which part is where."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:H, :W]
    truth = np.where(y < H // 2, 0, np.where(x < W // 2, 1, 2))
    picture = np.array([[0.8, 0.2, 0.15], [0.15, 0.3, 0.8], [0.4, 0.4, 0.4]])[truth]
    picture += 0.25 * (truth == 2)[..., None] * (np.where((x // 3 + y // 3) % 2, 1, -1))[..., None]
    return (picture + rng.normal(0, 0.03, picture.shape)).clip(0, 1).astype(np.float32), truth


def overlap(a: np.ndarray, b: np.ndarray) -> float:
    return (a & b).sum() / (a | b).sum()


def test_superpixels_cover_the_picture_with_numbers_without_gaps() -> None:
    labels = superpixels(patchwork()[0], 100)
    assert labels.shape == (H, W)
    np.testing.assert_array_equal(np.unique(labels), np.arange(labels.max() + 1))
    assert 50 <= labels.max() <= 150
    pairs = neighbours(np.array([[0, 0, 1], [2, 2, 1]]))
    assert pairs.tolist() == [[0, 1], [0, 2], [1, 2]]


@pytest.mark.parametrize("seed", range(3))
def test_regions_of_colour_and_texture_are_found(seed: int) -> None:
    picture, truth = patchwork(seed)
    found = regions(picture, 3)
    assert np.bincount(found.ravel()).tolist() == sorted(np.bincount(found.ravel()), reverse=True)
    for number in range(3):
        assert max(overlap(found == k, truth == number) for k in range(3)) > 0.85


def test_regions_of_one_look_are_one_although_they_are_apart() -> None:
    picture = np.full((H, W, 3), 0.2, np.float32)
    picture[:, :20], picture[:, -20:] = [0.9, 0.8, 0.1], [0.9, 0.8, 0.1]
    found = regions(picture, 2)
    assert found[H // 2, 5] == found[H // 2, -5] != found[H // 2, W // 2]


@pytest.mark.parametrize("count", [2, 5, 32])
def test_as_many_regions_as_asked_for(count: int) -> None:
    picture = np.random.default_rng(0).random((H, W, 3)).astype(np.float32)
    assert len(np.unique(style_regions(picture, count))) == count


@pytest.mark.parametrize(("count", "words"), [(1, "2 to 32"), (33, "2 to 32"), (-4, "2 to 32")])
def test_counts_of_regions_that_cannot_be(count: int, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        style_regions(patchwork()[0], count)


def test_one_point_selects_what_looks_alike_and_a_second_more() -> None:
    picture, truth = patchwork()
    blue = selection(picture, [(20, 60)])
    assert overlap(blue, truth == 1) > 0.85
    assert overlap(selection(picture, [(20, 60), (20, 10)]), truth <= 1) > 0.85


def test_a_negative_point_takes_away_what_looks_like_it() -> None:
    picture, truth = patchwork()
    both = selection(picture, [(20, 10), (20, 60), (80, 60)])
    assert both.mean() > 0.95
    assert overlap(selection(picture, [(20, 10), (80, 60)], [(20, 60)]), truth != 1) > 0.85


def test_a_drawn_mask_is_kept_but_for_its_points() -> None:
    picture, truth = patchwork()
    start = truth == 0
    again = selection(picture, [], [], start)
    assert overlap(again, start) > 0.9
    more = selection(picture, [(20, 60)], [], start)
    assert more[60, 20] and overlap(more & start, start) > 0.9


@settings(max_examples=CASES)
@given(
    st.lists(st.tuples(st.integers(0, W - 1), st.integers(0, H - 1)), min_size=2, max_size=6, unique=True),
    st.integers(1, 5),
)
def test_every_positive_point_is_in_and_no_negative_one(points: list[tuple[int, int]], cut: int) -> None:
    wanted, unwanted = points[:cut], points[cut:]
    mask = selection(patchwork()[0], wanted, unwanted)
    assert all(mask[y, x] for x, y in wanted)
    assert not any(mask[y, x] for x, y in unwanted)


@pytest.mark.parametrize("value", [0.0, 0.5, 1.0])
def test_flat_pictures_are_selected_whole_or_cut_between_points(value: float) -> None:
    picture = np.full((H, W, 3), value, np.float32)
    assert selection(picture, [(5, 5)]).all()
    cut = selection(picture, [(5, 36)], [(90, 36)])
    assert cut[36, 5] and not cut[36, 90]


# --- filling ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("share", ["half", "line", "pixel"])
def test_beyond_a_mask_there_is_only_what_is_inside(share: str) -> None:
    picture, truth = patchwork()
    mask = np.zeros((H, W), bool)
    mask[{"half": truth == 1, "line": np.s_[50:52, :40], "pixel": np.s_[60, 20]}[share]] = True
    out = filled(picture, mask)
    np.testing.assert_array_equal(out[mask], picture[mask])
    assert out[..., 2].min() > 0.6 and out[..., 0].max() < 0.4  # blue everywhere
    np.testing.assert_allclose(out.mean((0, 1)), picture[mask].mean(0), atol=0.06)
    np.testing.assert_array_equal(out, filled(picture, mask))


def test_a_mask_of_everything_changes_nothing() -> None:
    picture, _ = patchwork()
    np.testing.assert_array_equal(filled(picture, np.ones((H, W), bool)), picture)


# --- SAM, with a stand-in for its package and weights ----------------------------------------------------------------


class FakePredictor:
    """As SamPredictor is called: three masks for one point, one for more; they are discs around the first point."""

    def __init__(self, model: str) -> None:
        assert model == "vit_b on cpu" or model.endswith("cuda")

    def set_image(self, image: np.ndarray) -> None:
        assert image.dtype == np.uint8 and image.ndim == 3
        self.shape = image.shape[:2]

    def predict(self, point_coords, point_labels, mask_input, multimask_output):
        assert point_coords.shape == (len(point_labels), 2) and set(point_labels) <= {0, 1}
        assert mask_input is None or mask_input.shape == (1, 256, 256)
        y, x = np.mgrid[: self.shape[0], : self.shape[1]]
        far = np.hypot(x - point_coords[0, 0], y - point_coords[0, 1])
        radii = (5, 12, 30) if multimask_output else (8,)
        return np.stack([far < r for r in radii]), np.array([0.2, 0.9, 0.4])[: len(radii)], None


class FakeModel(str):
    def to(self, device: str) -> str:
        return f"{self} on {device}"


@pytest.fixture
def sam(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """The package in name, and a file of weights in torch's cache."""
    package = ModuleType("segment_anything")
    package.__spec__ = ModuleSpec("segment_anything", None)
    package.sam_model_registry = {"vit_b": lambda checkpoint: FakeModel("vit_b")}  # type: ignore[attr-defined]
    package.SamPredictor = FakePredictor  # type: ignore[attr-defined]

    class Generator:
        def __init__(self, model: str) -> None:
            pass

        def generate(self, image: np.ndarray) -> list[dict[str, np.ndarray]]:
            small, large = np.zeros((2, *image.shape[:2]), bool)
            small[:4, :4], large[:10] = True, True
            return [{"segmentation": small}, {"segmentation": large}]

    package.SamAutomaticMaskGenerator = Generator  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "segment_anything", package)
    monkeypatch.setattr(torch.hub, "get_dir", lambda: str(tmp_path))
    monkeypatch.delenv(SAM_VARIABLE, raising=False)
    weights = tmp_path / "checkpoints" / SAM_WEIGHTS["vit_b"]
    weights.parent.mkdir()
    weights.write_bytes(b"")
    return weights


def test_sam_stands_behind_the_same_interface(sam: Path) -> None:
    picture, _ = patchwork()
    found = segmenter("sam").select(picture, [(20, 30)], [])
    assert found.sum() == pytest.approx(np.pi * 12**2, rel=0.1)  # the mask that it trusts most
    again = segmenter("sam").select(picture, [(20, 30)], [(60, 60)], found)
    assert again.sum() == pytest.approx(np.pi * 8**2, rel=0.15)
    labels = style_regions(picture, 3, segmenter("sam"))
    assert np.bincount(labels.ravel()).tolist() == [H * W - 10 * W, 10 * W - 16, 16]
    assert np.bincount(style_regions(picture, 2, segmenter("sam")).ravel()).tolist() == [H * W - 10 * W, 10 * W]


def test_sam_says_what_is_missing(sam: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(SAM_VARIABLE, str(sam))
    assert SegmentAnything().name == "sam"
    monkeypatch.setenv(SAM_VARIABLE, "elsewhere.pth")
    with pytest.raises(BadInput, match="not a file of SAM's weights"):
        segmenter("sam")
    monkeypatch.delenv(SAM_VARIABLE)
    sam.unlink()
    with pytest.raises(BadInput, match=r"weights are missing.*sam_vit_h_4b8939\.pth"):
        segmenter("sam")
    monkeypatch.delitem(sys.modules, "segment_anything")
    monkeypatch.setattr("svv.styles.segmenters.find_spec", lambda name: None)
    with pytest.raises(BadInput, match="package segment_anything, which is not installed"):
        segmenter("sam")


def test_segmenters_have_names() -> None:
    assert isinstance(segmenter(), Superpixels)
    with pytest.raises(BadInput, match="no segmenter 'magic'"):
        segmenter("magic")


@pytest.mark.parametrize("shape", [(16, 16), (16, 400)])
def test_the_smallest_pictures_can_be_cut(shape: tuple[int, int]) -> None:
    picture = np.zeros((*shape, 3), np.float32)
    picture[:, shape[1] // 2 :] = [0.9, 0.8, 0.2]
    assert len(np.unique(style_regions(picture, 2))) == 2
    mask = selection(picture, [(1, 8)], [(shape[1] - 2, 8)])
    assert mask[:, : shape[1] // 2 - 2].all() and not mask[:, shape[1] // 2 + 2 :].any()
