"""Ablations: parts that the paper considers necessary and parts that we added, left out one at a time.

In paint that is laid in pieces of a picture: the guides by which they are chosen, the solved contrast, larger strokes
in fog, and lighting. In the palette network: the refinement of the palette's colours, and the weight of the offsets
(lambda_delta). Every variant has a folder; finished variants are not repeated.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from svv.errors import BadInput, Progress, part, silent
from svv.fields.scene.scene import Scene
from svv.io.files.atomic import make_folder
from svv.io.files.keyed_results import digest
from svv.io.pictures.style_picture import read_style
from svv.io.views.viewset import ViewSet
from svv.options.editing import PAINT_LIGHT
from svv.train.paint.pieces import PieceSettings
from svv.train.pipeline import stylize_scene
from svv.train.run.config import MatchSettings
from svv_bench.ablation.palette import PALETTE_COLUMNS, PALETTE_NOTE, PALETTES, ablate_palette
from svv_bench.keys import key_of_measure
from svv_bench.results import record
from svv_bench.styles.consistency import draw_frames, measure_frames
from svv_bench.styles.likeness import caption
from svv_bench.styles.modes import PaintedAsShown, flat_means, kept_scene, likeness
from svv_bench.styles.path import FINE, OrbitPath, Protocol, finely
from svv_bench.styles.table import JUDGED, contact_sheet, figures, markdown, write_tables

Row = dict[str, Any]


@dataclass(frozen=True)
class StyleVariant:
    """A change of the stylization."""

    pieces: Callable[[PieceSettings], PieceSettings] = lambda s: s
    lit: bool = True
    """Whether its frames are rendered with lighting."""


STYLES: dict[str, dict[str, StyleVariant]] = {
    "form": {
        "strokes along the form": StyleVariant(),
        "strokes upright": StyleVariant(lambda s: replace(s, guides=replace(s.guides, along_form=False))),
    },
    "tone": {
        "light strokes where it is light": StyleVariant(),
        "strokes regardless of light": StyleVariant(lambda s: replace(s, guides=replace(s.guides, tone=0.0))),
    },
    "contrast": {
        "contrast as in the style": StyleVariant(),
        "contrast as it comes": StyleVariant(lambda s: replace(s, contrast=False)),
    },
    "depth": {
        "larger strokes in fog": StyleVariant(),
        "strokes of one size": StyleVariant(lambda s: replace(s, largest=1.0)),
    },
    "lighting": {"with lighting": StyleVariant(), "without lighting": StyleVariant(lit=False)},
}
NAMES = (*STYLES, *PALETTES)
"""Names of all ablations."""

STYLE_COLUMNS = {name: name for name in (*JUDGED, "content", "seconds") if name != "patches 1/2"}
"""Figure -> title of its column in the table."""

STYLE_NOTE = (
    "FLIP and RMSE between frames the given number apart, after warping along the flow of the depth; 'part': relative "
    "to the frame's deviation from its mean colour. Distances of patches and colours to the first style, best at 0; "
    "contrast of fine detail relative to the style's, best at 1; content: similarity to the unstyled frames, at most "
    "1; changed: size of the change of colours."
)


@dataclass(frozen=True)
class Ablation(PaintedAsShown):
    """A job of ablations: their names, the scene and the settings."""

    scene: Path
    styles: tuple[Path, ...]
    """Style pictures: one for all regions, or several that the regions take in turn."""
    views: Path | None
    """Folder of the scene's views."""
    only: tuple[str, ...] | None
    """Names of the ablations, of :data:`NAMES`; None for all whose inputs are given."""
    protocol: Protocol
    preset: str = "balanced"
    seed: int = 0

    def __post_init__(self) -> None:
        for name in self.only or ():
            if name not in NAMES:
                raise BadInput(f"There is no ablation '{name}'; choose from {', '.join(NAMES)}.")
            if name in STYLES and not self.styles:
                raise BadInput(f"The ablation '{name}' needs a style picture: give --style.")
            if name in PALETTES and self.views is None:
                raise BadInput(f"The ablation '{name}' needs the scene's views: give --views.")
        if any(name in STYLES for name in self.names) and isinstance(self.chosen.stylize, MatchSettings):
            raise BadInput("Ablations of the stylization need a preset other than 'paper', which lays no pieces.")
        if not self.names:
            raise BadInput("Give --style for ablations of the stylization, --views for those of the palette network.")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the ablations of this job."""
        there = ((STYLES, bool(self.styles)), (PALETTES, self.views is not None))
        able = [name for group, can in there if can for name in group]
        return tuple(name for name in able if self.only is None or name in self.only)


def run_ablation(job: Ablation, out: Path, progress: Progress = silent) -> str:
    """Run all variants that are not finished yet.

    Args:
        job: The ablations.
        out: Folder of the results.
        progress: Called several times per second; the work stops if it raises, and the same call resumes it.

    Returns:
        The tables as Markdown, also in ``ablations.md``; ``ablations.csv`` and ``.json`` have all figures.

    Raises:
        BadInput: A file is missing or damaged, or the folder cannot be written to.
    """
    scene, make = Scene.load(job.scene), make_folder(out)
    views = None if job.views is None else _read_views(job.views)
    pictures = [read_style(path) for path in job.styles]
    rows: list[Row] = []
    for number, name in enumerate(job.names):
        each = part(progress, number / len(job.names), (number + 1) / len(job.names))
        if name in STYLES:
            rows += _style_ablation(job, name, scene, pictures, make, each)
        else:
            assert views is not None
            rows += ablate_palette(job.scene, name, scene, views, job.preset, job.seed, make, each)
    progress(1.0, f"{len(rows)} variants")
    text = "\n".join(_table(job, name, [r for r in rows if r["ablation"] == name]) for name in job.names)
    write_tables(out, "ablations", rows, text)
    return text


def _table(job: Ablation, name: str, rows: Sequence[Row]) -> str:
    metrics = {"flip": "FLIP", "rmse": "RMSE", "rmse_part": "RMSE, part"}
    apart = {f"depth {n} {k}": f"{title}, {n} apart" for n in job.protocol.intervals for k, title in metrics.items()}
    columns, note = ({**apart, **STYLE_COLUMNS}, STYLE_NOTE) if name in STYLES else (PALETTE_COLUMNS, PALETTE_NOTE)
    shown = [{"variant": row["variant"], **{title: _text(key, row) for key, title in columns.items()}} for row in rows]
    record(
        figures("painting/ablation" if name in STYLES else "palette/ablation", shown, "variant", list(columns.values()))
    )
    return f"## {name}\n\n{markdown(shown, 'variant', list(columns.values()))}\n\n{note}\n"


def _text(key: str, row: Row) -> Any:
    """Format a figure for the table; variants differ by hundredths of a decibel."""
    if key in ("psnr", "psnr_foreground") and row[key] is not None:
        return f"{row[key]:.2f}"
    return row.get(key)


def _style_ablation(
    job: Ablation, name: str, scene: Scene, pictures: Sequence[Any], out: Path, progress: Progress
) -> list[Row]:
    identity = {"scene": digest(job.scene), "styles": [digest(p) for p in pictures], "seed": job.seed}
    seen = key_of_measure(identity["scene"], asdict(job.protocol))
    path = OrbitPath(scene, job.protocol, out / "geometry", seen, part(progress, 0.0, 0.05))
    rows, folders, variants = [], {}, STYLES[name]
    for number, (label, variant) in enumerate(variants.items()):
        each = part(progress, 0.05 + 0.95 * number / len(variants), 0.05 + 0.95 * (number + 1) / len(variants))
        pieces = variant.pieces(job.pieces)
        key = key_of_measure({**identity, "stylize": asdict(job.chosen.stylize), "pieces": asdict(pieces)})

        def make(saved: Path, pieces: PieceSettings = pieces, each: Progress = each) -> tuple[Scene, dict[str, float]]:
            made, report = stylize_scene(
                scene, pictures, job.chosen, part(each, 0.0, 0.7), saved, pieces=pieces, seed=job.seed, manner="pieces"
            )
            return made, {k: v for k, v in report["seconds"].items() if k != "total"}

        made, seconds = kept_scene(out / "scenes" / key, key, make)  # equal variants share one scene
        if not variant.lit:
            made = replace(made, regions=tuple(replace(r, lighting=0.0) for r in made.regions))
        folder = out / name / label.replace(" ", "-")
        draw_frames(
            folder, key_of_measure([key, asdict(job.protocol), variant.lit and PAINT_LIGHT, FINE]), job.protocol.frames,
            partial(path.render, finely(made), "styled"), part(each, 0.7, 0.9),
        )  # fmt: skip
        folders[label] = folder
        figures = flat_means(measure_frames(path, folder, part(each, 0.9, 1.0)))
        rows.append({"ablation": name, "variant": label, "seconds": seconds, **figures,
                     **likeness(path, folder, pictures[0])})  # fmt: skip
    captions = {str(row["variant"]): caption(row) for row in rows}
    contact_sheet(out / f"{name}.png", path, {"unstyled": path.folder, **folders}, pictures[0], captions)
    return rows


def _read_views(folder: Path) -> tuple[ViewSet, ViewSet]:
    """Read training and test views from one folder."""
    return ViewSet.read(folder, "train"), ViewSet.read(folder, "test")
