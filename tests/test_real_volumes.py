"""The campaign of real volumes finds what is right, refused and wrong, and lists it."""

from __future__ import annotations

from pathlib import Path

import nibabel
import numpy as np
import pytest

from campaign import real_volumes
from campaign.real_volumes import Found, by_nibabel, candidates, examine, page
from tests.ell_volume import FIRST, STEP, ell


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    place = np.diag([*STEP, 1.0])
    place[:3, 3] = FIRST
    nibabel.save(nibabel.Nifti1Image(ell().T.copy(), place), tmp_path / "a.nii")
    nibabel.save(nibabel.Nifti1Image(np.stack([ell().T, 2 * ell().T], -1), place), tmp_path / "b.nii.gz")
    np.save(tmp_path / "c.npy", ell()[0])
    (tmp_path / "d.nrrd").write_bytes(b"NRRD")
    (tmp_path / "e.nii").touch()
    return tmp_path


def test_files_are_right_refused_or_wrong(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = list(candidates(folder))
    assert [file.name for file in files] == ["a.nii", "b.nii.gz", "c.npy", "d.nrrd"], "empty ones are none"
    found = [examine(file, folder, 0, 0) for file in files]
    assert [one.outcome for one in found] == ["right", "right", "refused", "refused"]
    assert found[1].said == "time 0" and found[0].shape == "22 x 18 x 14"
    monkeypatch.setitem(real_volumes.REFERENCES, ".nii", lambda file, at: (2 * by_nibabel(file, at)[0], None))
    assert examine(files[0], folder, 0, 0).outcome == "wrong"
    turned = np.eye(4)
    monkeypatch.setitem(real_volumes.REFERENCES, ".nii", lambda file, at: (by_nibabel(file, at)[0], turned))
    assert examine(files[0], folder, 0, 0).said == "another place or size of voxels"


def test_a_page_begins_with_what_is_wrong() -> None:
    found = [
        Found("a.nii", ".nii", "right", shape="2 x 2 x 2", stored="uint8", psnr=40.0, train_seconds=3.0),
        Found("b.nii", ".nii", "right", shape="2 x 2 x 2", stored="uint8", psnr=30.0, train_seconds=3.0),
        Found("c.map", ".map", "wrong", "values differ by up to 3"), Found("d.map", ".map", "refused", "It is empty."),
    ]  # fmt: skip
    text = page(found, "python -m campaign.real_volumes")
    assert "| .nii | 2 | 0 | 0 | 0 | 0 |" in text and "| all | 2 | 0 | 1 | 1 | 0 |" in text
    assert text.index("values differ") < text.index("It is empty") < text.index("b.nii") < text.index("| a.nii")
