"""``svv bench consistency FRAMES``: laws of the figures, given and estimated motion, and other methods."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from svv.core.geometry.cameras import sphere_cameras
from svv.io.pictures.output import to_bytes
from svv.io.views.transforms import intrinsics_of
from svv.train.lpips import Lpips, lpips
from svv_bench.frames import result as results
from svv_bench.frames.measure import LEAST_FOLLOWED, Compared
from svv_bench.frames.motion import given_motion
from svv_bench.frames.painted import Painting
from svv_bench.frames.result import FolderJob, folder_consistency, write_result
from svv_bench.frames.sequence import read_folder
from svv_bench.styles.paper import lpips_within, paper_figures
from tests.frame_folders import NEAR, SIZE, alexnet, flows, pattern, row, shifted, write

__all__ = ["alexnet"]

ERRORS = ("rmse", "mse", "flip", "lpips", "rmse_part", "flip_part", "paper mse", "paper lpips")
pytestmark = pytest.mark.usefixtures("alexnet")


# --- laws --------------------------------------------------------------------------------------------------------


def test_a_still_sequence_has_no_error_and_is_called_still(tmp_path: Path) -> None:
    folder = write(tmp_path / "still", [pattern()] * 4)
    found = folder_consistency(folder, tmp_path / "out", FolderJob(Compared((1, 3))))
    for interval, pairs in ((1, 3), (3, 1)):
        measured = row(found, interval)
        assert {name: measured[name] for name in ERRORS} == dict.fromkeys(ERRORS, pytest.approx(0, abs=1e-6))
        assert (measured["pairs"], measured["share"]) == (pairs, 1.0)
    assert any("the same picture" in note for note in found["notes"])


@pytest.mark.parametrize("name", ["frame{:02d}.npy", "frame{:02d}.flo"])
def test_a_shifted_sequence_has_no_error_along_its_exact_flow(tmp_path: Path, name: str) -> None:
    """Over several frames, too, where flows are chained; what has moved out of the picture is not compared."""
    folder, count = write(tmp_path / "shifted", shifted(5)), 5
    job = FolderJob(Compared((1, 4)), motion=flows(tmp_path / "flows", count, name=name))
    found = folder_consistency(folder, tmp_path / "out", job)
    for interval in (1, 4):
        measured = row(found, interval)
        assert {name: measured[name] for name in ERRORS} == dict.fromkeys(ERRORS, pytest.approx(0, abs=1e-5))
        assert measured["flow"] == "given"
        gone = 2 * interval + 2  # at the sides the slope of the flow is unknown
        assert 1 - gone / SIZE - 0.03 < measured["share"] <= 1 - 2 * interval / SIZE
    assert not any("means nothing" in note or "mean nothing" in note for note in found["notes"])


def test_a_wrong_flow_is_not_free(tmp_path: Path) -> None:
    folder = write(tmp_path / "shifted", shifted(3))
    found = folder_consistency(folder, tmp_path / "out", FolderJob(Compared((1,)), motion=flows(tmp_path / "f", 3, -2)))
    assert row(found, 1)["rmse"] > 0.1


def test_an_estimated_flow_follows_a_shift(tmp_path: Path) -> None:
    found = folder_consistency(write(tmp_path / "shifted", shifted(4)), tmp_path / "out", FolderJob(Compared((1, 3))))
    for interval in (1, 3):
        assert row(found, interval)["rmse_part"] < 0.15
        assert row(found, interval)["followed"] > 0.6
    assert results.OWN in found["notes"]


def test_flicker_is_measured_and_the_guide_tells_it_from_motion(tmp_path: Path) -> None:
    """Brightness that changes from frame to frame is an error of the size of the change, if the flow is the scene's."""
    plain = shifted(4)
    flickering = [np.clip(p.astype(int) + (30 if k % 2 else 0), 0, 255).astype(np.uint8) for k, p in enumerate(plain)]
    job = FolderJob(Compared((1, 2)), guide=write(tmp_path / "plain", plain))
    found = folder_consistency(write(tmp_path / "paint", flickering), tmp_path / "out", job)
    assert row(found, 1)["rmse"] == pytest.approx(30 / 255, rel=0.2)
    assert row(found, 2)["rmse"] < 0.3 * row(found, 1)["rmse"]  # two frames apart, nothing flickers
    assert results.OWN not in found["notes"]


def test_frames_are_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    pictures = shifted(4)
    folder = tmp_path / "frames"
    for number, picture in zip((8, 9, 10, 11), pictures):  # as words, 10 and 11 come first
        write(folder, [picture], f"v2_{number}_final.png")
    frames = read_folder(folder)
    assert frames.numbers == (8, 9, 10, 11) and frames.files[0].name == "v2_8_final.png"
    given = [flows(tmp_path / "flows", 12, name="v2_{}_final.npy"), flows(tmp_path / "others", 4)]
    disordered = write(tmp_path / "disordered", [pictures[k] for k in (0, 2, 1, 3)])
    errors = [
        row(folder_consistency(f, tmp_path / f"out{k}", FolderJob(Compared((1,)), motion=given[k])), 1)["rmse"]
        for k, f in enumerate((folder, disordered))
    ]
    assert errors[0] == pytest.approx(0, abs=1e-6) and errors[1] > 0.05


def test_a_gap_in_the_numbers_is_no_neighbour(tmp_path: Path) -> None:
    folder = write(tmp_path / "frames", shifted(6))
    (folder / "frame03.png").unlink()
    (folder / "notes.txt").write_text("")
    frames = read_folder(folder)
    assert frames.pairs((1, 2)) == [(1, 0, 1), (1, 1, 2), (1, 4, 5), (2, 0, 2), (2, 2, 4)]
    assert any("gap, between frame02.png and frame04.png" in note for note in frames.notes)
    assert any("1 other file was left out: notes.txt" in note for note in frames.notes)
    assert frames.pairs((2,), every=2) == [(2, 0, 2), (2, 2, 4)]


def test_every_tenth_frame_counts_as_neighbours(tmp_path: Path) -> None:
    for number, picture in zip((100, 110, 120), shifted(3)):
        write(tmp_path / "frames", [picture], f"{number}.png")
    assert read_folder(tmp_path / "frames").pairs((1, 2)) == [(1, 100, 110), (1, 110, 120), (2, 100, 120)]


def test_names_without_one_number_are_taken_as_they_sort(tmp_path: Path) -> None:
    folder = tmp_path / "frames"
    for name in ("b.png", "a10.png", "a9.png"):
        write(folder, [pattern()], name)
    frames = read_folder(folder)
    assert [path.name for path in frames.files] == ["a9.png", "a10.png", "b.png"]
    assert any("order of their names" in note for note in frames.notes)


def test_what_was_hidden_is_not_compared(tmp_path: Path) -> None:
    """A square moves over a background that stands still: what it uncovers was never seen before."""
    behind, square = pattern(seed=1), pattern(seed=2)[:16, :16]
    pictures = []
    for k in range(2):
        picture = behind.copy()
        picture[16:32, 8 + 6 * k : 24 + 6 * k] = square
        pictures.append(picture)
    flow = np.zeros((SIZE, SIZE, 2), np.float32)
    flow[16:32, 8:24, 0] = 6
    (tmp_path / "flows").mkdir()
    np.save(tmp_path / "flows" / "frame00.npy", flow)
    frames = read_folder(write(tmp_path / "frames", pictures))
    source = given_motion(frames, tmp_path / "flows")
    seen = np.ones((SIZE, SIZE), bool)
    warp = source.between(0, 1).warp(seen, seen)
    assert not warp.mask[17:31, 8:14].any()  # uncovered
    # Of the square, only what cannot be told from the background that it hides may be missing.
    assert warp.mask[17:31, 16:29].mean() > 0.8 and warp.mask[:, 34:46].all()
    found = folder_consistency(frames.folder, tmp_path / "out", FolderJob(Compared((1,)), motion=tmp_path / "flows"))
    assert row(found, 1)["mse"] < 1e-5


def test_the_background_does_not_count_in_our_protocol_and_does_in_the_paper_s(tmp_path: Path) -> None:
    """A flickering square on a plain background: ours is independent of the size of the background."""
    mse: dict[int, list[float]] = {}
    for size in (48, 96):
        pictures = []
        for k in range(2):
            picture = np.full((size, size, 3), 255, np.uint8)
            picture[8:40, 8:40] = pattern()[:32, :32] // 2 + 40 * k
            pictures.append(picture)
        folder, given = write(tmp_path / f"{size}", pictures), tmp_path / f"flow{size}"
        given.mkdir()
        np.save(given / "frame00.npy", np.zeros((size, size, 2)))
        found = folder_consistency(folder, tmp_path / f"out{size}", FolderJob(Compared((1,)), motion=given))
        assert any("background" in note and "255, 255, 255" in note for note in found["notes"])
        measured = row(found, 1)
        mse[size] = [measured["mse"], measured["paper mse"]]
        assert measured["followed"] > 0.8
    assert mse[48][0] == pytest.approx(mse[96][0]) == pytest.approx((40 / 255) ** 2, rel=1e-3)
    assert mse[96][1] == pytest.approx(mse[48][1] / 4)


def test_transparent_frames_are_compared_straight(tmp_path: Path) -> None:
    """Opacity that changes is not paint that changes."""
    pictures = []
    for alpha in (120, 220):
        pictures.append(np.dstack([pattern(), np.full((SIZE, SIZE), alpha, np.uint8)]))
    given = tmp_path / "flow"
    given.mkdir()
    np.save(given / "frame00.npy", np.zeros((SIZE, SIZE, 2)))
    measured = row(
        folder_consistency(write(tmp_path / "f", pictures), tmp_path / "out", FolderJob(Compared((1,)), motion=given)),
        1,
    )
    assert measured["mse"] == pytest.approx(0, abs=1e-9)
    assert measured["paper mse"] > 0.001


def test_a_turning_ball_agrees_along_the_flow_of_its_depth(tmp_path: Path) -> None:
    """Paint that sticks to a ball, with depths and cameras from files; the same paint on the screen does not agree."""
    cameras = list(sphere_cameras(300, (0.0, 0.0, 0.0), 4.0, np.radians(25), SIZE))
    apart = [np.linalg.norm(c.position - cameras[0].position) for c in cameras[1:]]
    pair = [cameras[0], cameras[1 + int(np.argmin(apart))]]
    pictures: dict[str, list[np.ndarray]] = {"surface": [], "screen": []}
    (tmp_path / "depth").mkdir()
    for k, camera in enumerate(pair):
        origins, directions = camera.rays()
        along = -(origins * directions).sum(-1)
        inside = 0.75**2 - ((origins + along[..., None] * directions) ** 2).sum(-1)
        depth = np.where(inside > 0, along - np.sqrt(np.maximum(inside, 0)), np.inf)
        np.save(tmp_path / "depth" / f"frame{k:02d}.npy", depth.astype(np.float32))
        point = origins + directions * np.where(inside > 0, depth, 0)[..., None]
        at = {"surface": point, "screen": np.repeat(np.indices((SIZE, SIZE))[0][..., None] / 12.0, 3, -1)}
        for name, place in at.items():
            picture = np.dstack([0.5 + 0.4 * np.sin(5 * place + 2 * k * (name == "screen")), inside > 0])
            pictures[name].append(to_bytes(picture))
    frames = [
        {"file_path": f"frame{k:02d}", "transform_matrix": c.camera_to_world.tolist()} for k, c in enumerate(pair)
    ]
    (tmp_path / "depth" / "transforms.json").write_text(json.dumps({**intrinsics_of(pair[0]), "frames": frames}))
    job = FolderJob(Compared((1,)), motion=tmp_path / "depth")
    found = {name: row(folder_consistency(write(tmp_path / name, p), tmp_path / f"out-{name}", job), 1)
             for name, p in pictures.items()}  # fmt: skip
    assert found["surface"]["flow"] == "depth" and found["surface"]["followed"] > 0.3
    assert found["surface"]["rmse_part"] < 0.2 < 0.5 < found["screen"]["rmse_part"]


def test_of_unrelated_frames_it_is_said_that_the_flow_explains_nothing(tmp_path: Path) -> None:
    unrelated = [np.random.default_rng(k).integers(0, 256, (64, 64, 3), dtype=np.uint8) for k in range(2)]
    found = folder_consistency(write(tmp_path / "unrelated", unrelated), tmp_path / "out", NEAR)
    assert row(found, 1)["followed"] < LEAST_FOLLOWED
    assert any("the flow explains nothing in 1 of 1 pairs (frame00.png and frame01.png)" in n for n in found["notes"])
    assert sum("explains nothing" in note for note in found["notes"]) == 1
    related = folder_consistency(write(tmp_path / "related", shifted(2)), tmp_path / "out2", NEAR)
    assert not any("explains nothing" in note for note in related["notes"])


def test_two_frames_have_a_short_range_only(tmp_path: Path) -> None:
    found = folder_consistency(write(tmp_path / "two", shifted(2)), tmp_path / "out", FolderJob())
    assert [r["interval"] for r in found["rows"]] == [1]
    assert "There are no pairs 10 apart: there are only 2 frames." in found["notes"]


def test_of_empty_frames_it_says_that_there_is_nothing_to_measure(tmp_path: Path) -> None:
    white = [np.full((SIZE, SIZE, 3), 255, np.uint8)] * 2
    found = folder_consistency(write(tmp_path / "white", white), tmp_path / "out", NEAR)
    assert row(found, 1)["mse"] is None
    assert any("nothing to measure" in note for note in found["notes"])


def test_without_weights_it_says_how_to_get_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(results, "load_lpips", lambda: None)
    found = folder_consistency(write(tmp_path / "two", shifted(2)), tmp_path / "out", NEAR)
    assert row(found, 1)["lpips"] is None and row(found, 1)["paper lpips"] is None
    assert any("svv features --get" in note for note in found["notes"])


def test_what_was_measured_is_not_measured_again_until_a_frame_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = write(tmp_path / "frames", shifted(3))
    first = folder_consistency(folder, tmp_path / "out", NEAR)
    text = write_result(tmp_path / "out", first)
    assert "| frames/ tvl1 1 |" in text and (tmp_path / "out" / "consistency.csv").read_text().count("\n") == 2
    from svv_bench.frames import measure, motion

    with monkeypatch.context() as patch:
        patch.setattr(motion, "estimated_flow", None)
        patch.setattr(measure, "figures", None)
        assert folder_consistency(folder, tmp_path / "out", NEAR) == first
    write(folder, [pattern(seed=9)])
    assert folder_consistency(folder, tmp_path / "out", NEAR)["rows"] != first["rows"]


# --- LPIPS and the paper's protocol ------------------------------------------------------------------------------


def test_lpips_within_is_lpips_if_everything_is_compared_and_does_not_see_the_rest(alexnet: Lpips) -> None:
    one, two = pattern(96, 0)[:, :64] / 255.0, pattern(96, 1)[:, :64] / 255.0
    whole = np.ones(one.shape[:2], bool)
    assert lpips_within(alexnet, one, two, whole) == pytest.approx(lpips(alexnet, one, two), rel=1e-5)
    half = whole.copy()
    half[:, 32:] = False
    other = two.copy()
    other[:, 32:] = 0.0
    seen = lpips_within(alexnet, one, two, half)
    assert seen is not None and seen > 0 and seen == lpips_within(alexnet, one, other, half)
    assert lpips_within(alexnet, one, two, ~whole) is None and lpips_within(None, one, two, whole) is None


def test_the_paper_s_figures_leave_out_what_nothing_arrives_at(alexnet: Lpips) -> None:
    one, two = (np.asarray(p) / 255.0 for p in shifted(2, 4))
    flow = np.zeros((SIZE, SIZE, 2))
    flow[..., 0] = 4
    found = paper_figures(alexnet, one, two, flow, np.zeros((SIZE, SIZE)))
    assert found == {"paper mse": pytest.approx(0, abs=1e-12), "paper lpips": pytest.approx(0, abs=1e-6)}
    assert paper_figures(alexnet, one, two, flow * np.nan, np.zeros((SIZE, SIZE)))["paper mse"] is None


# --- other methods -----------------------------------------------------------------------------------------------


def test_methods_paint_the_frames_and_video_is_steadier_than_frame_by_frame(tmp_path: Path) -> None:
    folder = write(tmp_path / "frames", shifted(3))
    Image.fromarray(np.kron(pattern()[:12, :12], np.ones((4, 4, 1), np.uint8))).save(tmp_path / "style.png")
    job = FolderJob(Compared((1,)), style=tmp_path / "style.png", painting=Painting(steps=6, features="embedded"))
    found = folder_consistency(folder, tmp_path / "out", job)
    assert [r["frames"] for r in found["rows"]] == ["frames/", "frame-by-frame", "video", "adain"]
    assert row(found, 1, "video")["rmse"] < 0.8 * row(found, 1, "frame-by-frame")["rmse"]
    for mode in ("frame-by-frame", "video", "adain"):
        pictures = [np.asarray(Image.open(tmp_path / "out" / mode / f"{k:04d}.png").convert("RGB")) for k in range(3)]
        assert np.abs(pictures[0].astype(int) - shifted(3)[0]).mean() > 8, mode
    assert (tmp_path / "out" / "consistency.png").exists()
