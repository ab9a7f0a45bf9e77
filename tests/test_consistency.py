"""``svv bench consistency``, ``compare`` and ``ablate``: the measures, the modes, resuming, and bad usage."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from svv.cli import app as cli
from svv.core.colour.palette import PaletteSettings, extract_palette
from svv.core.geometry.cameras import sphere_cameras
from svv.errors import BadInput, Cancelled, silent
from svv.fields.scene.scene import Scene
from svv.io.pictures.output import to_bytes
from svv.io.views.viewset import ViewSet
from svv.styles.features import load_features
from svv.train.match.style_loss import StyleLossSettings, StyleTarget
from svv.train.pipeline import train_scene
from svv.train.run.config import PRESETS, MatchSettings, Preset, StylizeSettings
from svv_bench.ablation import painting as ablation
from svv_bench.styles import modes as style_modes
from svv_bench.styles.consistency import consistency, draw_frames, means, measure_frames
from svv_bench.styles.modes import MODES, Comparison, compare_styles
from svv_bench.styles.path import METRICS, OrbitPath, Protocol, Warp
from svv_bench.styles.rival_frames import frame_alone
from svv_bench.styles.rivals import arf_like
from svv_bench.styles.table import averaged, victories
from tests.solid_ball import solid_ball
from tests.two_balls import Balls, two_balls

SIZE = 48
SHORT = Protocol(size=SIZE, every=80, flows=("depth",))


def views_of(n: int) -> ViewSet:
    cameras = sphere_cameras(n, (0.0, 0.0, 0.0), 4.0, np.radians(30), SIZE)
    images = np.stack([two_balls(c)[0] for c in cameras])
    return ViewSet(tuple(cameras), images, tuple(f"r_{k:04d}" for k in range(n)))


STEPS = MatchSettings(distil_iterations=16, distil_rays=1024, style_iterations=6, style_views=12, style_size=SIZE)
DRAFT = PRESETS["draft"]
TINY = Preset(
    "draft",
    replace(DRAFT.field, width=32),
    replace(DRAFT.reconstruct, iterations=40, rays=1024, samples=8192, cells=32),
    replace(DRAFT.recolour, iterations=40, rays=1024),
    StylizeSettings(style_views=12, style_size=SIZE),
)


@pytest.fixture(scope="module", autouse=True)
def tiny() -> Any:
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(PRESETS, "draft", TINY)
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A trained scene, its views and a striped picture."""
    root = tmp_path_factory.mktemp("balls")
    train_scene(views_of(42), "draft")[0].save(root / "balls.svv")
    views_of(12).write(root / "views", "train")
    views_of(5).write(root / "views", "test")
    Image.fromarray(to_bytes(stripes())).save(root / "stripes.png")
    return root


def stripes() -> np.ndarray:
    row, column = np.mgrid[0:SIZE, 0:SIZE]
    wave = 0.5 + 0.5 * np.sin((column + 0.5 * row) * 0.9)
    return np.stack([wave, 0.6 * wave + 0.2, 1 - wave], axis=-1).astype(np.float32)


@pytest.fixture(scope="module")
def scene(folder: Path) -> Scene:
    return Scene.load(folder / "balls.svv")


# --- measures ----------------------------------------------------------------------------------------------------


def test_protocol_pairs() -> None:
    paper = Protocol()
    short = [pair for pair in paper.pairs if pair[0] == 1]
    assert (len(short), len(paper.pairs) - len(short), len(paper.frames)) == (180, 171, 181)
    assert Protocol(every=60, intervals=(10,)).pairs == [(10, 0, 10), (10, 60, 70), (10, 120, 130)]
    with pytest.raises(BadInput, match="10 apart"):
        Protocol(orbit=10)
    with pytest.raises(BadInput, match="every"):
        Protocol(every=0)


def still(mask: np.ndarray) -> Warp:
    return Warp(np.zeros((*mask.shape, 2)), np.zeros(mask.shape), mask)


def test_differences_are_counted_where_the_mask_says() -> None:
    rng = np.random.default_rng(0)
    first = rng.integers(0, 256, (SIZE, SIZE, 3), dtype=np.uint8)
    mask = np.zeros((SIZE, SIZE), bool)
    mask[: SIZE // 2] = True
    second = first.copy()
    second[SIZE // 2 :] = 255 - second[SIZE // 2 :]
    same = still(mask).differences(first, second)
    assert {name: same[name] for name in METRICS} == dict.fromkeys(METRICS, pytest.approx(0, abs=1e-6))
    assert same["share"] == 0.5
    second = np.clip(first.astype(int) + 51, 0, 255).astype(np.uint8)
    error = np.square((second / 255.0 - first / 255.0)[mask]).mean()
    found = still(mask).differences(first, second)
    assert [found["mse"], found["rmse"]] == pytest.approx([error, error**0.5])
    assert 0 < found["flip"] < 1
    assert np.isnan(still(np.zeros_like(mask)).differences(first, second)["rmse"])


def test_parts_do_not_reward_pale_pictures() -> None:
    """Halving the contrast of both pictures halves RMSE and leaves its part; noise is no better than a plain colour."""
    rng = np.random.default_rng(0)
    one, two = rng.random((2, SIZE, SIZE, 3))
    full = still(np.ones((SIZE, SIZE), bool))
    strong = full.differences(to_bytes(one), to_bytes(two))
    pale = full.differences(to_bytes(0.25 + one / 2), to_bytes(0.25 + two / 2))
    assert pale["rmse"] == pytest.approx(strong["rmse"] / 2, rel=0.02)
    assert pale["rmse_part"] == pytest.approx(strong["rmse_part"], rel=0.02)
    assert strong["rmse_part"] == pytest.approx(2**0.5, rel=0.05)  # two independent variances against one
    assert pale["flip"] < strong["flip"]


def test_warping_finely_tells_a_sharp_picture_from_a_restless_one(tmp_path: Path) -> None:
    """A fine pattern in space that stands still: most of its error is the warp's, and averaging leaves little of it."""
    scene, error = Balls(), {}
    for oversample in (1, 2, 4):
        how = replace(SHORT, intervals=(1,), oversample=oversample)
        path = OrbitPath(scene, how, tmp_path / f"geometry{oversample}", f"of {oversample}")

        def drawn(frame: int, path: OrbitPath = path) -> np.ndarray:
            camera = path.cameras[frame]
            origins, directions = camera.rays()
            point = origins + directions * np.nan_to_num(scene.render(camera, "pcn").depth)[..., None]
            return to_bytes(np.repeat(0.5 + 0.5 * np.sin(60.0 * point).prod(-1, keepdims=True), 3, -1))

        error[oversample] = path.warp("depth", 0, 1).differences(drawn(0), drawn(1))["rmse_part"]
    assert error[4] < 0.5 * error[2] < 0.25 * error[1]
    with pytest.raises(BadInput, match="oversample"):
        Protocol(oversample=9)


def test_paint_on_a_surface_agrees_and_paint_on_the_screen_does_not(tmp_path: Path) -> None:
    """A pattern in space is consistent; the same amount of pattern fixed to the pixels is not."""
    scene = Balls()
    path = OrbitPath(scene, SHORT, tmp_path / "geometry", "one")

    def painted(frame: int, on_surface: bool) -> np.ndarray:
        camera = path.cameras[frame]
        seen = scene.render(camera, "pcn")
        origins, directions = camera.rays()
        point = origins + directions * np.nan_to_num(seen.depth)[..., None]
        row, column = np.mgrid[0:SIZE, 0:SIZE]
        wave = point[..., 0] + 0.7 * point[..., 1] if on_surface else 0.06 * (column + 0.7 * row)
        colour = 0.5 + 0.4 * np.sin(5 * wave)[..., None] * np.array([1, 0.5, -1])
        return np.concatenate([colour, seen.rgba[..., 3:]], axis=-1).astype(np.float32)

    rows = {}
    for name in (True, False):
        frames = draw_frames(tmp_path / f"{name}", "one", SHORT.frames, partial(painted, on_surface=name))
        rows[name] = {r["interval"]: r for r in means(measure_frames(path, frames))}
    for interval in SHORT.intervals:
        for metric in ("rmse", "flip", "rmse_part", "flip_part") if interval == 10 else ():
            assert rows[True][interval][metric] < 0.3 * rows[False][interval][metric], metric
        assert rows[True][interval]["rmse"] < 0.05  # of an amplitude of 0.4: what bilinear splatting costs
        assert rows[True][interval]["share"] > 0.02


def test_one_colour_agrees_with_itself_however_opacity_changes(tmp_path: Path) -> None:
    """Opacity is the scene's, the same in every mode: over white it would be most of what frames differ by."""
    scene = Balls()
    path = OrbitPath(scene, SHORT, tmp_path / "geometry", "one")

    def translucent(frame: int) -> np.ndarray:
        alpha = scene.render(path.cameras[frame], "pcn").rgba[..., 3:] * (0.3 + 0.5 * frame / SHORT.orbit)
        return np.concatenate([np.broadcast_to([0.2, 0.4, 0.3], (SIZE, SIZE, 3)), alpha], axis=-1).astype(np.float32)

    for row in means(measure_frames(path, draw_frames(tmp_path / "frames", "one", SHORT.frames, translucent))):
        assert row["share"] > 0.02
        assert [row["rmse"], row["flip"]] == pytest.approx([0, 0], abs=1e-6)


def test_what_is_there_is_not_done_again(tmp_path: Path) -> None:
    scene = Balls()
    first = consistency(scene, "pcn", SHORT, tmp_path, "key")
    frame = tmp_path / "frames" / f"{SHORT.frames[0]:04d}.png"
    changed = frame.stat().st_mtime_ns
    told: list[str] = []
    again = consistency(scene, "pcn", SHORT, tmp_path, "key", lambda _, label: told.append(label))
    assert again == first
    assert frame.stat().st_mtime_ns == changed
    assert not any(label.startswith("depth flow") for label in told)
    consistency(scene, "pcn", SHORT, tmp_path, "another")  # of another scene: all is made anew
    assert frame.stat().st_mtime_ns > changed


def test_a_stopped_measurement_goes_on_to_the_same_figures(tmp_path: Path) -> None:
    scene = Balls()

    def stop(fraction: float, label: str) -> None:
        if fraction > 0.7:
            raise Cancelled

    with pytest.raises(Cancelled):
        consistency(scene, "pcn", SHORT, tmp_path / "stopped", "key", stop)
    assert consistency(scene, "pcn", SHORT, tmp_path / "stopped", "key") == consistency(
        scene, "pcn", SHORT, tmp_path / "whole", "key"
    )


def test_a_folder_of_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "frames").mkdir()
    (tmp_path / "frames" / "thesis.tex").write_text("")
    with pytest.raises(BadInput, match="contains other files"):
        consistency(Balls(), "pcn", SHORT, tmp_path, "key")
    assert (tmp_path / "frames" / "thesis.tex").exists()


# --- modes -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def compared(folder: Path, tiny: None) -> tuple[Path, list[dict[str, Any]]]:
    out = folder / "modes"
    out.mkdir()
    how = Comparison(SHORT, preset="draft", schedule=STEPS)
    return out, compare_styles([folder / "balls.svv"], [folder / "stripes.png"], out, how)


def test_every_mode_paints_and_is_measured(compared: tuple[Path, list[dict[str, Any]]]) -> None:
    out, rows = compared
    found = {row["mode"]: row for row in rows}
    assert list(found) == list(MODES)
    assert (out / "balls-stripes.png").exists()
    assert found["unstyled"]["changed"] == 0
    for mode in (m for m in MODES if m != "unstyled"):
        assert found[mode]["changed"] > 0.1, mode
        assert found[mode]["seconds"] > 0
        assert 0 < found[mode]["lines"] < 5 and "patches 1/1" in found[mode]
        for interval in SHORT.intervals:
            assert np.isfinite([found[mode][f"depth {interval} {name}"] for name in METRICS]).all()
    assert found["video"]["depth 1 rmse"] < 0.9 * found["frame-by-frame"]["depth 1 rmse"]


@pytest.mark.slow
def test_strokes_hold_still_where_frames_alone_do_not(folder: Path, tiny: None, tmp_path: Path) -> None:
    """Of what there is to see, that is: what is calm holds still, too. On a surface, as fog has none to hold them."""
    solid_ball().save(tmp_path / "ball.svv")
    how = Comparison(
        Protocol(size=64, every=90, flows=("depth",)), ("pieces", "frame-by-frame"), "draft", schedule=STEPS
    )
    ours, alone = compare_styles([tmp_path / "ball.svv"], [folder / "stripes.png"], tmp_path / "modes", how)
    assert ours["depth 10 rmse_part"] < 0.6 * alone["depth 10 rmse_part"]
    assert ours["contrast"] > 0.7


def test_compared_again_nothing_is_trained(
    compared: tuple[Path, list[dict[str, Any]]], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, rows = compared

    def fail(*_: Any, **__: Any) -> None:
        raise AssertionError("trained again")

    for name in ("stylize_scene", "arf_like", "snerf_like", "frame_alone", "frame_after", "frame_of_statistics"):
        monkeypatch.setattr(style_modes, name, fail)
    how = Comparison(SHORT, preset="draft", schedule=STEPS)
    assert compare_styles([folder / "balls.svv"], [folder / "stripes.png"], out, how) == rows


def test_the_arf_like_mode_says_one_colour_from_every_side(scene: Scene) -> None:
    picture = torch.from_numpy(stripes()).permute(2, 0, 1)
    target = StyleTarget(load_features("embedded"), picture, StyleLossSettings(style_size=SIZE))
    made, seconds = arf_like(scene, target, STEPS, 0, silent)
    assert all(r.lighting == 0.0 and r.style == "ARF-like" for r in made.regions)
    assert set(seconds) == {"distil", "stylize", "recolour"}
    assert made.styled is not None and made.base is scene.base


def test_a_frame_alone_keeps_its_alpha_and_does_not_depend_on_what_came_before() -> None:
    rgba = two_balls(sphere_cameras(12, (0, 0, 0), 4.0, np.radians(30), SIZE)[5])[0] / np.float32(255)
    style, network = torch.from_numpy(stripes()).permute(2, 0, 1), load_features("embedded")
    loss = StyleLossSettings(style_size=SIZE)
    first, again = (frame_alone(rgba, network, style, loss, 3, 0) for _ in range(2))
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(first[..., 3], rgba[..., 3])
    assert np.abs(first - rgba)[rgba[..., 3] > 0].max() > 0.1
    empty = np.zeros((8, 8, 4), np.float32)
    np.testing.assert_array_equal(frame_alone(empty, network, style, loss, 3, 0), empty)


def test_tables() -> None:
    rows = [
        {"scene": "a", "style": "s", "mode": "ours", "x": 1.0},
        {"scene": "a", "style": "s", "mode": "other", "x": 2.0},
        {"scene": "b", "style": "s", "mode": "ours", "x": 3.0},
        {"scene": "b", "style": "s", "mode": "other", "x": None},
    ]
    assert averaged(rows, "mode") == [{"mode": "ours", "x": 2.0}, {"mode": "other", "x": 2.0}]
    assert "| other | 1/1 |" in victories(rows, "ours", ["other", "absent"], ["x"])


# --- ablations ---------------------------------------------------------------------------------------------------


def test_an_unrefined_palette_keeps_greys_and_similar_hues() -> None:
    rng = np.random.default_rng(0)
    pure = np.array([[0.9, 0.1, 0.1], [0.9, 0.3, 0.1], [0.5, 0.5, 0.5], [0.05, 0.05, 0.05]])
    pixels = pure[rng.integers(0, 4, 4000)] * rng.uniform(0.9, 1, (4000, 1))
    refined, plain = (extract_palette(pixels, np.ones(4000), PaletteSettings(refined=r)) for r in (True, False))
    assert len(plain.colours) > len(refined.colours)
    assert len(plain.colours) <= PaletteSettings().max_colours
    spread = plain.colours.max(axis=1) - plain.colours.min(axis=1)
    assert spread.min() < 0.1  # a grey, which refinement leaves out
    assert plain.share.sum() == pytest.approx(1)


def test_ablations_differ_where_they_say(folder: Path, tmp_path: Path) -> None:
    only = ("lighting", "refinement")
    job = ablation.Ablation(folder / "balls.svv", (folder / "stripes.png",), folder / "views", only, SHORT, "draft")
    text = ablation.run_ablation(job, tmp_path / "out")
    rows = {r["variant"]: r for r in json.loads((tmp_path / "out" / "ablations.json").read_text())}
    assert len(rows) == 4 and all(name in text for name in rows)
    assert {f.name for f in (tmp_path / "out").glob("*.png")} == {f"{name}.png" for name in only}
    # One stylization, shown with and without light, and two palettes.
    assert len(list((tmp_path / "out" / "scenes").iterdir())) == 3
    assert rows["with lighting"]["changed"] != rows["without lighting"]["changed"]
    assert rows["palette not refined"]["regions"] >= rows["refined palette"]["regions"]
    for row in (rows["palette not refined"], rows["refined palette"]):
        shares = [float(share) for share in row["shares"].split(", ")]
        assert len(shares) == row["regions"] and sum(shares) == pytest.approx(100, abs=0.5)
        assert f"| {row['shares']} |" in text and f"| {row['psnr']:.2f} |" in text
    assert "## lighting" in text and "| RMSE, 1 apart |" in text


# --- the commands ------------------------------------------------------------------------------------------------


def call(*arguments: str | Path, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(sys, "argv", ["svv", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    return int(ended.value.code or 0)


def test_the_command(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ("bench", "consistency", folder / "balls.svv", "--orbit", "11", "--size", "48", "--every", "5",
                 "--json", tmp_path / "c.json", "--out", tmp_path / "out")  # fmt: skip
    assert call(*arguments, monkeypatch=monkeypatch) == 0
    content = json.loads((tmp_path / "c.json").read_text())
    assert {(r["flow"], r["interval"]) for r in content["rows"]} == {(f, n) for f in ("depth", "tvl1") for n in (1, 10)}
    assert "| tvl1 10 |" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["bench", "consistency", "{s}", "--flows", "raft"], "--flows has no 'raft'"),
        (["bench", "consistency", "{s}", "--network", "styled"], "no network 'styled'"),
        (["bench", "consistency", "{s}", "--orbit", "5"], "10 apart"),
        (["bench", "compare", "{s}", "--style", "{p}", "--modes", "ours,theirs"], "no mode 'theirs'"),
        (["bench", "compare", "{s}", "{s}", "--style", "{p}"], "same name"),
        (["bench", "ablate", "{s}"], "--style"),
        (["bench", "ablate", "{s}", "--only", "lighting"], "needs a style picture"),
        (["bench", "ablate", "{s}", "--style", "{p}", "--preset", "paper"], "preset other than 'paper'"),
        (["bench", "ablate", "{s}", "--style", "{p}", "--only", "lambda-delta"], "--views"),
        (["bench", "ablate", "{s}", "--style", "{p}", "--only", "luck"], "no ablation 'luck'"),
    ],
)
def test_bad_use(
    arguments: list[str], words: str, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    given = [a.format(s=folder / "balls.svv", p=folder / "stripes.png") for a in arguments]
    assert call(*given, "--out", tmp_path / "out", monkeypatch=monkeypatch) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
