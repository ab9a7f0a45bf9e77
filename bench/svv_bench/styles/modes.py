"""Our stylization compared with other ways, on scenes x styles: consistency, similarity to the style, seconds.

Every combination has a folder ``SCENE-STYLE/MODE`` with its scene (if the mode makes one) and its frames; existing
results are reused.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from svv.core.colour.colour import over
from svv.core.images.metrics import ssim
from svv.errors import BadInput, Progress, part, silent
from svv.fields.scene.scene import Scene
from svv.io.files.atomic import write_json
from svv.io.files.keyed_results import digest, make_keyed_folder
from svv.io.pictures.style_picture import read_style
from svv.options.editing import PAINT_LIGHT
from svv.options.making import MannerName
from svv.render.pictures import read_png
from svv.styles.features import load_features
from svv.train.lpips import load_lpips
from svv.train.match.style_loss import PAPER_LOSS, StyleLossSettings, StyleTarget
from svv.train.paint.ink import StyleInput
from svv.train.paint.pieces import PieceSettings
from svv.train.pipeline import stylize_scene
from svv.train.run.config import MatchSettings, Preset, StylizeSettings, preset
from svv_bench.keys import key_of_measure
from svv_bench.results import record
from svv_bench.styles.consistency import draw_frames, means, measure_frames, straight
from svv_bench.styles.likeness import FIGURES, caption, judge_of, painted_figures
from svv_bench.styles.paper import seen_means
from svv_bench.styles.path import FINE, LEAST_ALPHA, METRICS, OrbitPath, Protocol, finely
from svv_bench.styles.rival_frames import FORMS, Before, frame_after, frame_alone, frame_of_statistics
from svv_bench.styles.rivals import arf_like, snerf_like
from svv_bench.styles.table import (
    JUDGED,
    averaged,
    both_protocols,
    consistency_columns,
    contact_sheet,
    figures,
    markdown,
    victories,
    write_tables,
)

MODES = {
    "unstyled": "the palette network's colours, with light",
    "ours": "each region separately, in strokes or pieces as suits the style, lighting",
    "ours-unlit": "the same scene, shown without light",
    "pieces": "each region separately, in pieces whatever the style, lighting",
    "arf-like": "one style, whole scene, no palette stage, no lighting",
    "snerf-like": "images stylized one by one and the field refitted to them, alternately",
    "frame-by-frame": "every frame optimised separately",
    "video": "every frame started from the previous one, warped, and kept close to it",
    "adain": "every frame separately, with mean and deviation of each feature set to the style's",
}
"""Name of a mode -> its description."""

FRAMES = ("frame-by-frame", "video", "adain")
"""Modes that stylize frames and make no scene."""

RIVALS = ("arf-like", "snerf-like", *FRAMES)
OURS = ("ours", "ours-unlit")
"""Our modes, with and without light; only the second compares like with like because the rivals have no light."""

SCHEDULE = MatchSettings(style_iterations=84, distil_iterations=300)
"""Settings of the rivals that make a field: minutes, of which more would change little. Frames take as many steps."""

LOOKED_AT = 3
"""Number of frames that are compared with the style."""

Row = dict[str, Any]


class PaintedAsShown:
    """Settings that paint at the size of the compared frames, which gives strokes the same size everywhere."""

    protocol: Protocol
    preset: str

    @property
    def chosen(self) -> Preset:
        """The preset with images as large as the frames, which gives strokes the same size in every mode."""
        own = preset(self.preset)
        return replace(own, stylize=replace(own.stylize, style_size=self.protocol.size))

    @property
    def scale(self) -> float:
        """Factor on sizes, in proportion to the frames."""
        return self.protocol.size / StylizeSettings().style_size

    @property
    def pieces(self) -> PieceSettings:
        """How pictures are laid in pieces."""
        return replace(PieceSettings(), size=round(PieceSettings().size * self.scale))


@dataclass(frozen=True)
class Comparison(PaintedAsShown):
    """Settings with which styles are compared."""

    protocol: Protocol
    modes: tuple[str, ...] = tuple(MODES)
    preset: str = "balanced"
    seed: int = 0
    features: str = "auto"
    paper_loss: bool = False
    """Whether the rivals use plain matching as in the paper, without the losses on colours and variation."""
    schedule: MatchSettings = SCHEDULE
    """Settings of the rivals."""

    def __post_init__(self) -> None:
        for name in self.modes:
            if name not in MODES:
                raise BadInput(f"There is no mode '{name}'; choose from {', '.join(MODES)}.")
        preset(self.preset)

    @property
    def matching(self) -> MatchSettings:
        """The rivals' settings, with images as large as the frames."""
        return replace(self.schedule, style_size=self.protocol.size)

    @property
    def loss(self) -> StyleLossSettings:
        """The rivals' loss, with strokes in proportion to the frames."""
        own = PAPER_LOSS if self.paper_loss else StyleLossSettings()
        return replace(own, style_size=round(own.style_size * self.scale))

    def depends_on(self, mode: str) -> dict[str, Any]:
        """Return the settings on which the paint of a mode depends, for its key."""
        if mode in RIVALS:
            return {"stylize": asdict(self.matching), "loss": asdict(self.loss), "features": self.features}
        return {"stylize": asdict(self.chosen.stylize), "pieces": asdict(self.pieces), "preset": self.preset}


@dataclass(frozen=True)
class Case:
    """A scene and a style."""

    scene: Path
    style: Path

    @property
    def name(self) -> str:
        """Name of its folder."""
        return f"{self.scene.stem}-{self.style.stem}"


def compare_styles(
    scenes: Sequence[Path], styles: Sequence[Path], out: Path, how: Comparison, progress: Progress = silent
) -> list[Row]:
    """Do all unfinished combinations, and return a row for each combination.

    Args:
        scenes: Files of trained scenes.
        styles: Style pictures.
        out: Folder of the results.
        how: Modes and protocol.
        progress: Called several times per second; the work stops if it raises, and the same call resumes it.

    Raises:
        BadInput: A file is missing or is not a scene or picture, or two have the same name.
    """
    cases = [Case(scene, style) for scene in scenes for style in styles]
    if len({case.name for case in cases}) < len(cases):
        raise BadInput("Two of the scenes, or of the styles, have the same name; rename one.")
    pictures = {path: read_style(path) for path in styles}
    loaded = {path: Scene.load(path) for path in scenes}
    rows, count = [], len(cases) * len(how.modes)
    for number, case in enumerate(cases):
        begin = number * len(how.modes)
        work = _CaseWork(case, loaded[case.scene], pictures[case.style], out, how, _titled(progress, case.name))
        for index, mode in enumerate(how.modes):
            each = part(progress, (begin + index) / count, (begin + index + 1) / count)
            rows.append(work.row(mode, _titled(each, f"{case.name}, {mode}")))
        captions = {row["mode"]: caption(row) for row in rows[begin:]}
        contact_sheet(out / f"{case.name}.png", work.path, work.folders, pictures[case.style], captions)
    progress(1.0, f"{count} results")
    return rows


class _CaseWork:
    """The work on all modes of one scene and style."""

    def __init__(
        self, case: Case, scene: Scene, style: NDArray[np.float32], out: Path, how: Comparison, progress: Progress
    ) -> None:
        self.case, self.scene, self.style, self.how = case, scene, style, how
        self.folder, self.folders = out / case.name, {}  # type: Path, dict[str, Path]
        self.hashes = {"scene": digest(case.scene), "style": digest(style)}
        key = key_of_measure({"scene": self.hashes["scene"], "protocol": asdict(how.protocol)})
        geometry = out / f"{case.scene.stem}-geometry"
        self.path = OrbitPath(scene, how.protocol, geometry, key, lambda _, label: progress(0.0, label))

    def row(self, mode: str, progress: Progress) -> Row:
        frames, seconds = self.frames(mode, part(progress, 0.0, 0.7))
        self.folders[mode] = frames
        flat = flat_means(measure_frames(self.path, frames, part(progress, 0.7, 0.97)))
        seen = seen_means(self.path, frames, part(progress, 0.97, 0.99)).items()
        flat |= {f"{flow} {n} {name}": value for (flow, n), row in seen for name, value in row.items()}
        judged = likeness(self.path, frames, self.style)
        return {"scene": self.case.scene.stem, "style": self.case.style.stem, "mode": mode, "seconds": seconds,
                **flat, **judged}  # fmt: skip

    def frames(self, mode: str, progress: Progress) -> tuple[Path, float]:
        """Return the folder of a mode's frames, and the seconds that stylizing took."""
        how, numbers = self.how, self.how.protocol.frames
        form = {"form": FORMS[mode]} if mode in FORMS else {}
        parts = {"mode": mode, **form, **self.hashes, "protocol": asdict(how.protocol), **how.depends_on(mode),
                 "seed": how.seed, "sampling": FINE,
                 **({"paint_light": PAINT_LIGHT} if mode in ("ours", "pieces") else {})}  # fmt: skip
        key, folder = key_of_measure(parts), self.folder / mode
        drawing = part(progress, 0.7, 1.0)
        if mode in FRAMES:
            return self._stylized(mode, folder, key, progress)
        if mode == "unstyled":
            return self.path.folder, 0.0
        if mode == "ours-unlit":
            lit, seconds = self._made("ours", progress)
            made = replace(lit, regions=tuple(replace(r, lighting=0.0) for r in lit.regions))
        else:
            made, seconds = self._made(mode, part(progress, 0.0, 0.7))
        draw_frames(folder, key, numbers, partial(self.path.render, finely(made), "styled"), drawing)
        return folder, seconds

    def _made(self, mode: str, progress: Progress) -> tuple[Scene, float]:
        """Return the scene of a mode and its seconds, read from its folder if it was made before."""
        how = self.how
        key = key_of_measure({"mode": mode, **self.hashes, **how.depends_on(mode), "seed": how.seed})
        return kept_scene(self.folder / f"{mode}-scene", key, lambda saved: self._train(mode, saved, progress))

    def _train(self, mode: str, checkpoint: Path, progress: Progress) -> tuple[Scene, dict[str, float]]:
        how, name = self.how, self.case.style.stem
        if mode in ("ours", "pieces"):
            manner: MannerName = "pieces" if mode == "pieces" else "auto"
            made, report = stylize_scene(
                self.scene, [StyleInput(self.style, name)], how.chosen, progress, checkpoint, pieces=how.pieces,
                mapping=dict.fromkeys(range(len(self.scene.regions)), 0), seed=how.seed, manner=manner,
            )  # fmt: skip
            return made, {k: v for k, v in report["seconds"].items() if k != "total"}
        target = StyleTarget(load_features(how.features), self._picture(), how.loss, how.seed)
        rival = {"arf-like": arf_like, "snerf-like": snerf_like}[mode]
        return rival(self.scene, target, how.matching, how.seed, progress)

    def _stylized(self, mode: str, folder: Path, key: str, progress: Progress) -> tuple[Path, float]:
        note, how = folder / "seconds.json", self.how
        numbers = how.protocol.frames
        made_with = (load_features(how.features), self._picture(), how.loss, how.matching.style_iterations, how.seed)
        # After a gap longer than all compared intervals, a new sequence begins.
        follows = {b: a for a, b in pairwise(numbers) if mode == "video" and b - a <= max(how.protocol.intervals)}

        def make(number: int) -> NDArray[np.float32]:
            before = json.loads(note.read_text(encoding="utf-8")) if note.exists() else {}
            begin = time.monotonic()
            rgba = read_png(self.path.folder / f"{number:04d}.png") / np.float32(255)
            if number in follows:
                warp = self.path.warp("depth", follows[number], number)
                moved = Before(warp.moved(straight(folder, follows[number])), warp.mask)
                result = frame_after(rgba, moved, *made_with)
            else:
                result = (frame_of_statistics if mode == "adain" else frame_alone)(rgba, *made_with)
            write_json(note, {**before, str(number): time.monotonic() - begin})
            return result

        draw_frames(folder, key, numbers, make, progress)
        return folder, float(sum(json.loads(note.read_text(encoding="utf-8")).values()))

    def _picture(self) -> torch.Tensor:
        return torch.from_numpy(self.style).permute(2, 0, 1)


def flat_means(records: Sequence[dict[str, Any]]) -> dict[str, float | None]:
    """Return the means of all pairs, with keys ``FLOW INTERVAL METRIC``."""
    return {f"{r['flow']} {r['interval']} {k}": r[k] for r in means(records) for k in (*METRICS, "share")}


def likeness(path: OrbitPath, frames: Path, style: NDArray[np.float32]) -> dict[str, float]:
    """Return means over some frames of an orbit: distances to a style, and the change from the unstyled picture.

    Args:
        path: The orbit.
        frames: Folder of its frames.
        style: The style picture, in [0, 1]. (h, w, 3)

    Returns:
        :func:`svv_bench.styles.likeness.painted_figures`; ``changed``: root mean square change of colour over the
        visible pixels; ``content``: SSIM of the grey frame and the grey unstyled one.
    """
    network = load_lpips()
    how = key_of_measure({"style": style, "figures": FIGURES, "alexnet": network is not None})
    file = frames / f"judged-{how}.json"
    if file.exists():
        return dict(json.loads(file.read_text(encoding="utf-8")))
    numbers = path.protocol.frames
    judge = judge_of(style, path.protocol.size, network)
    found: list[dict[str, float]] = []
    for number in numbers[:: max(1, len(numbers) // LOOKED_AT)][:LOOKED_AT]:
        shown, before = (read_png(f / f"{number:04d}.png") / np.float32(255) for f in (frames, path.folder))
        seen = before[..., 3] >= LEAST_ALPHA
        if not seen.any():
            continue
        values = painted_figures(shown[..., :3], before[..., 3], judge)
        values["changed"] = float(np.sqrt(np.square(shown[..., :3] - before[..., :3])[seen].mean()))
        grey = [np.repeat(over(x).mean(axis=-1, keepdims=True), 3, axis=-1) for x in (shown, before)]
        values["content"] = ssim(*grey)
        found.append(values)
    names = dict.fromkeys(name for values in found for name in values)
    result = {name: float(np.mean([values[name] for values in found if name in values])) for name in names}
    write_json(file, result)
    return result


def write_comparison(out: Path, rows: Sequence[Row], how: Comparison) -> str:
    """Write ``modes.md``, ``.csv`` and ``.json``; return the Markdown."""
    columns = consistency_columns(how.protocol)
    parts = [
        markdown(averaged(rows, "mode"), "mode", [*columns, *JUDGED, "seconds"]),
        both_protocols(averaged(rows, "mode"), how.protocol),
        *(victories(rows, own, [m for m in RIVALS if m in how.modes], columns) for own in OURS if own in how.modes),
        "\n".join(f"- **{name}**: {MODES[name]}" for name in how.modes),
    ]
    text = "\n\n".join(p for p in parts if p) + "\n"
    write_tables(out, "modes", rows, text)
    record(figures("painting/compare", averaged(rows, "mode"), "mode", [*columns, *JUDGED, "seconds"]))
    return text


def kept_scene(folder: Path, key: str, make: Callable[[Path], tuple[Scene, dict[str, float]]]) -> tuple[Scene, float]:
    """Return a scene that is made once and then kept, and the seconds that making it took.

    Args:
        folder: Folder in which it is kept.
        key: Key of everything that it depends on; a scene with another key is made again.
        make: Function that makes the scene, given a file for a checkpoint; returns it and the seconds of its parts.
    """
    make_keyed_folder(folder, key)
    file, note, saved = folder / "scene.svv", folder / "seconds.json", folder / "checkpoint"
    if not note.exists():
        made, seconds = make(saved)
        made.save(file)
        write_json(note, seconds)  # last, to show that the scene is complete
        saved.unlink(missing_ok=True)
    return Scene.load(file), float(sum(json.loads(note.read_text(encoding="utf-8")).values()))


def _titled(progress: Progress, title: str) -> Progress:
    return lambda fraction, label: progress(fraction, f"{title}: {label}")
