"""The gallery: every picture exists, is different, is the same for the same seed, and is kept in the user's cache."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from svv.errors import BadInput
from svv.io.pictures.style_picture import read_style
from svv.render.gallery import style_file, write_gallery
from svv.styles import gallery
from svv.styles.gallery import gallery_picture, open_style
from svv.styles.gallery.drawings import discs, streamed
from svv.styles.gallery.offered import GALLERY
from svv.styles.gallery.subjects import flowers, hills, sea, still_life
from tests.nightly import nightly

SIZE = 96


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "svv" / "gallery"


@pytest.mark.parametrize("name", nightly(GALLERY, "oil"))
def test_pictures_are_lively_and_their_seed_decides(name: str) -> None:
    picture = GALLERY[name][0](np.random.default_rng(0), SIZE)
    assert picture.shape == (SIZE, SIZE, 3) and picture.dtype == np.float32
    assert picture.min() >= 0 and picture.max() <= 1
    assert np.abs(np.diff(picture, axis=0)).mean() > 0.005  # marks, not fog
    np.testing.assert_array_equal(picture, GALLERY[name][0](np.random.default_rng(0), SIZE))
    assert np.abs(picture - GALLERY[name][0](np.random.default_rng(1), SIZE)).mean() > 0.02


def test_no_two_pictures_share_their_colours() -> None:
    """Three tenths of the pixels at least would have to change colour to turn one picture's colours into another's."""
    assert len(GALLERY) >= 10
    cells = [(gallery_picture(name, SIZE) * 3.999).astype(int).reshape(-1, 3) @ [16, 4, 1] for name in GALLERY]
    shares = np.stack([np.bincount(cell, minlength=64) / len(cell) for cell in cells])
    apart = np.abs(shares[:, None] - shares).sum(-1) / 2 + np.eye(len(shares))
    assert apart.min() > 0.3, (apart.min(), list(GALLERY)[apart.min(0).argmin()])


def test_pictures_are_painted_once_and_then_read(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = gallery_picture("Screen print", 64)
    (kept,) = cache.iterdir()
    assert kept.name.startswith("screen-print-64-0-") and kept.suffix == ".png"
    monkeypatch.setitem(GALLERY, "screen-print", (lambda rng, n: np.zeros((n, n, 3), np.float32), ""))
    np.testing.assert_array_equal(gallery_picture("screen-print", 64), first)
    kept.write_bytes(kept.read_bytes()[:100])  # damaged: painted again, and kept again
    assert not gallery_picture("screen-print", 64).any()
    assert not read_style(kept).any()
    monkeypatch.setattr(gallery, "VERSION", gallery.VERSION + 1)
    gallery_picture("screen-print", 64)
    assert len(list(cache.iterdir())) == 2


def test_a_cache_that_cannot_be_written_is_no_obstacle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert gallery_picture("stipple", 64).shape == (64, 64, 3)


@pytest.mark.parametrize(
    ("name", "size", "seed", "words"),
    [
        ("gouache", 64, 0, "no 'gouache'.*stipple, cross-hatching"),
        ("mosaic", 8, 0, "16 to 1024"),
        ("mosaic", 4096, 0, "16 to 1024"),
        ("mosaic", 64, -1, "seed"),
    ],
)
def test_pictures_that_cannot_be(name: str, size: int, seed: int, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        gallery_picture(name, size, seed)


def test_styles_are_opened_by_name_or_from_files(tmp_path: Path) -> None:
    name, picture = open_style("gallery:ink wash")
    assert name == "ink-wash" and picture.shape == (512, 512, 3)
    write_gallery(tmp_path / "made", ["stipple"], 32)
    assert open_style(tmp_path / "made" / "stipple.png")[0] == "stipple"
    with pytest.raises(BadInput, match="write gallery:mosaic"):
        open_style("mosaic")
    with pytest.raises(BadInput, match="no style picture"):
        open_style("nothing.png")


def test_the_gallery_is_written_with_a_contact_sheet(tmp_path: Path) -> None:
    names = ["stipple", "woodcut", "mosaic", "oil", "charcoal"]
    sheet = write_gallery(tmp_path / "made", names, 64)
    assert sorted(p.stem for p in sheet.parent.iterdir()) == sorted([*names, "gallery"])
    height, width = read_style(sheet).shape[:2]
    assert width >= 4 * 180 and height >= 2 * 180  # four beside each other, the fifth below


def test_a_job_gets_a_file_of_a_gallery_picture_and_keeps_it(tmp_path: Path) -> None:
    assert style_file("a.png", tmp_path) == Path("a.png")
    path = style_file("gallery:Screen print", tmp_path / "out")
    assert path == tmp_path / "out" / "screen-print.png" and read_style(path).shape == (512, 512, 3)
    before = path.stat().st_mtime_ns
    assert style_file("gallery:screen-print", tmp_path / "out") == path and path.stat().st_mtime_ns == before
    with pytest.raises(BadInput, match="no 'lithograph'"):
        style_file("gallery:lithograph", tmp_path)


@pytest.mark.parametrize("paint", [hills, sea, still_life, flowers])
def test_subjects_have_tones_and_parts(paint) -> None:
    subject = paint(np.random.default_rng(3), 96)
    assert subject.tone.min() >= 0 and subject.tone.max() <= 1 and np.ptp(subject.tone) > 0.5
    assert len(np.unique(subject.part)) >= 4 and subject.outline.any()
    assert np.isfinite(subject.angle).all()


def test_a_dot_covers_its_area_and_smears_follow_their_direction() -> None:
    cover = discs(64, np.array([20.3, 45.0]), np.array([30.7, 10.0]), np.array([4.0, 6.5]))
    assert cover.sum() == pytest.approx(np.pi * (4.0**2 + 6.5**2), rel=0.03)
    noise = np.random.default_rng(0).normal(size=(96, 96)).astype(np.float32)
    across = streamed(noise, np.zeros((96, 96), np.float32), 12)
    assert np.abs(np.diff(across, axis=1)).mean() < 0.4 * np.abs(np.diff(across, axis=0)).mean()
