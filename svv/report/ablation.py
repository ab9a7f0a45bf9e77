"""The paper's ablations: what it says is needed, left out one at a time.

Of the stylization: colour transfer, lighting, and the background behind the regions' renders. Of the palette network:
the refinement of the palette's colours, and the weight of the offsets (lambda_delta). Every variant is a folder, and
what is there is not done again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from svv.core.palette import PaletteSettings
from svv.errors import BadInput, Progress, part, silent
from svv.fields.scene import Region, Scene
from svv.io.atomic import make_folder, write_json
from svv.io.images import read_style
from svv.io.output import region_picture, write_png
from svv.io.viewset import ViewSet
from svv.report.consistency import draw_frames, measure_frames
from svv.report.orbit_path import FINE, OrbitPath, Protocol, digest, finely
from svv.report.pictures import cropped, over_white, sheet
from svv.report.render import region_colours
from svv.report.stability_measures import matched, overlaps
from svv.report.style_modes import flat_means, kept_scene, likeness
from svv.report.style_table import contact_sheet, markdown, write_tables
from svv.train.config import Preset, RecolourSettings, StylizeSettings, preset
from svv.train.evaluate import evaluate_scene
from svv.train.pipeline import stylize_scene
from svv.train.ranges import hull_of, regions_of
from svv.train.recolour import palette_of, recolour
from svv.train.style_loss import PAPER_LOSS, StyleLossSettings

Row = dict[str, Any]


@dataclass(frozen=True)
class StyleVariant:
    """A change of the stylization."""

    stylize: Callable[[StylizeSettings], StylizeSettings] = lambda s: s
    loss: Callable[[StyleLossSettings], StyleLossSettings] = lambda s: s
    lit: bool = True
    """Whether its frames are shown with light."""


@dataclass(frozen=True)
class PaletteVariant:
    """A change of the palette network."""

    recolour: Callable[[RecolourSettings], RecolourSettings] = lambda s: s
    palette: PaletteSettings | None = None
    """How the palette is read from the views; None: as training does, from the volume where that is known."""


STYLES: dict[str, dict[str, StyleVariant]] = {
    "colour-transfer": {
        "with colour transfer": StyleVariant(),
        "without colour transfer": StyleVariant(stylize=lambda s: replace(s, colour_transfer=False)),
    },
    "lighting": {"with lighting": StyleVariant(), "without lighting": StyleVariant(lit=False)},
    "background": {
        "luminance background": StyleVariant(),
        "black background": StyleVariant(loss=lambda s: replace(s, background=0.0)),
        "white background": StyleVariant(loss=lambda s: replace(s, background=1.0)),
    },
}
PALETTES: dict[str, dict[str, PaletteVariant]] = {
    "refinement": {
        "refined palette": PaletteVariant(palette=PaletteSettings()),
        "palette not refined": PaletteVariant(palette=PaletteSettings(refined=False)),
    },
    "lambda-delta": {
        f"lambda_delta = {value:g}": PaletteVariant(recolour=partial(replace, offset_weight=value))
        for value in (0.0, 0.1, 1.0)
    },
}
NAMES = (*STYLES, *PALETTES)
"""The ablations."""

STYLE_COLUMNS = ("patches 1/1", "colour", "contrast", "content", "changed", "seconds")
PALETTE_COLUMNS = ("regions", "overlap", "psnr", "psnr_foreground", "ssim", "flip", "lpips", "seconds")


@dataclass(frozen=True)
class Ablation:
    """Which ablations, of what."""

    scene: Path
    styles: tuple[Path, ...]
    """Pictures; the first is taken, or as many as there are regions, in turn."""
    views: Path | None
    """The scene's folder of views."""
    only: tuple[str, ...] | None
    """Of :data:`NAMES`; None: all for which there is what they need."""
    protocol: Protocol
    preset: str = "balanced"
    seed: int = 0
    features: str = "auto"
    paper_loss: bool = False

    def __post_init__(self) -> None:
        for name in self.only or ():
            if name not in NAMES:
                raise BadInput(f"There is no ablation '{name}'; choose of {', '.join(NAMES)}.")
            if name in STYLES and not self.styles:
                raise BadInput(f"The ablation '{name}' needs a picture: give --style.")
            if name in PALETTES and self.views is None:
                raise BadInput(f"The ablation '{name}' needs the scene's views: give --views.")
        if not self.names:
            raise BadInput("Give --style for the ablations of the stylization, --views for those of the palette.")

    @property
    def names(self) -> tuple[str, ...]:
        """Those that are done."""
        there = ((STYLES, bool(self.styles)), (PALETTES, self.views is not None))
        able = [name for group, can in there if can for name in group]
        return tuple(name for name in able if self.only is None or name in self.only)

    @property
    def chosen(self) -> Preset:
        """The preset, with stylization images as large as the frames."""
        own = preset(self.preset)
        return replace(own, stylize=replace(own.stylize, style_size=self.protocol.size))

    @property
    def loss(self) -> StyleLossSettings:
        """The loss, with style pictures as large as the frames."""
        return replace(PAPER_LOSS if self.paper_loss else StyleLossSettings(), style_size=self.protocol.size)


def run_ablation(job: Ablation, out: Path, progress: Progress = silent) -> str:
    """Do all variants that are not there yet.

    Args:
        job: Which.
        out: Folder of the results.
        progress: Called several times a second; stops the work when it raises, and the same call goes on.

    Returns:
        The tables as Markdown, which are in ``ablations.md``, too; ``ablations.csv`` and ``.json`` have all figures.

    Raises:
        BadInput: a file that is missing or damaged, or a folder that cannot be written to.
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
            rows += _palette_ablation(job, name, scene, views, make, each)
    progress(1.0, f"{len(rows)} variants")
    text = "\n".join(_table(job, name, [r for r in rows if r["ablation"] == name]) for name in job.names)
    write_tables(out, "ablations", rows, text)
    return text


def _table(job: Ablation, name: str, rows: Sequence[Row]) -> str:
    consistency = [f"depth {n} {k}" for n in job.protocol.intervals for k in ("flip", "rmse", "rmse_part")]
    columns = (*consistency, *STYLE_COLUMNS) if name in STYLES else PALETTE_COLUMNS
    return f"{markdown(rows, 'variant', columns)}\n"


def _style_ablation(
    job: Ablation, name: str, scene: Scene, pictures: Sequence[Any], out: Path, progress: Progress
) -> list[Row]:
    identity = {"scene": digest(job.scene.read_bytes()), "styles": [digest(p.tobytes()) for p in pictures],
                "seed": job.seed, "features": job.features}  # fmt: skip
    seen = digest([identity["scene"], asdict(job.protocol)])
    path = OrbitPath(scene, job.protocol, out / "geometry", seen, part(progress, 0.0, 0.05))
    rows, folders, variants = [], {}, STYLES[name]
    for number, (label, variant) in enumerate(variants.items()):
        each = part(progress, 0.05 + 0.95 * number / len(variants), 0.05 + 0.95 * (number + 1) / len(variants))
        chosen = replace(job.chosen, stylize=variant.stylize(job.chosen.stylize))
        loss = variant.loss(job.loss)
        key = digest({**identity, "stylize": asdict(chosen.stylize), "loss": asdict(loss)})

        def make(
            saved: Path, chosen: Preset = chosen, loss: StyleLossSettings = loss, each: Progress = each
        ) -> tuple[Scene, dict[str, float]]:
            made, report = stylize_scene(
                scene, pictures, None, (), chosen, job.seed, part(each, 0.0, 0.7), saved, None, job.features, loss
            )
            return made, {k: v for k, v in report["seconds"].items() if k != "total"}

        made, seconds = kept_scene(out / "scenes" / key, key, make)  # variants that are the same share it
        if not variant.lit:
            made = replace(made, regions=tuple(replace(r, lighting=0.0) for r in made.regions))
        folder = out / name / label.replace(" ", "-")
        draw_frames(
            folder, digest([key, asdict(job.protocol), variant.lit, FINE]), job.protocol.frames,
            partial(path.render, finely(made), "styled"), part(each, 0.7, 0.9),
        )  # fmt: skip
        folders[label] = folder
        figures = flat_means(measure_frames(path, folder, part(each, 0.9, 1.0)))
        rows.append({"ablation": name, "variant": label, "seconds": seconds, **figures,
                     **likeness(path, folder, pictures[0])})  # fmt: skip
    contact_sheet(out / f"{name}.png", path, {"unstyled": path.folder, **folders}, pictures[0])
    return rows


def _palette_ablation(
    job: Ablation, name: str, scene: Scene, views: tuple[ViewSet, ViewSet], out: Path, progress: Progress
) -> list[Row]:
    train, test = views
    rows, columns, variants = [], [], PALETTES[name]
    truth = [scene.render(camera, "pcn") for camera in test.cameras]
    middle = len(test.cameras) // 2
    for number, (label, variant) in enumerate(variants.items()):
        each = part(progress, number / len(variants), (number + 1) / len(variants))
        settings = variant.recolour(preset(job.preset).recolour)
        key = digest({"scene": digest(job.scene.read_bytes()), "views": digest(train.images.tobytes()),
                      "recolour": asdict(settings), "palette": variant.palette and asdict(variant.palette),
                      "seed": job.seed})  # fmt: skip

        def make(
            saved: Path, settings: RecolourSettings = settings, variant: PaletteVariant = variant, each: Progress = each
        ) -> tuple[Scene, dict[str, float]]:
            made, seconds = _retrained(scene, train, settings, variant.palette, job.seed, part(each, 0.0, 0.8))
            return made, {"pcn": seconds}

        made, seconds = kept_scene(out / "scenes" / key, key, make)
        scores = evaluate_scene(made, test, "pcn", part(each, 0.8, 1.0))
        shown = [made.render(camera, "pcn") for camera in test.cameras]
        maps = [np.stack([s.region for s in some]) for some in (truth, shown)]
        table = overlaps(maps[0], maps[1], len(scene.regions), len(made.regions))
        rows.append({"ablation": name, "variant": label, "seconds": seconds, "regions": len(made.regions),
                     "overlap": float(np.mean(matched(table))),
                     **{k: scores[k] for k in PALETTE_COLUMNS if k in scores}})  # fmt: skip
        write_json(out / "scenes" / key / "scores.json", {**rows[-1], "views": scores["views"], "size": scores["size"]})
        columns.append([over_white(shown[middle].rgba),
                        over_white(region_picture(shown[middle].region, region_colours(made)))])  # fmt: skip
    columns.append([over_white(test.images[middle]),
                    over_white(region_picture(truth[middle].region, region_colours(scene)))])  # fmt: skip
    pictures = cropped([list(row) for row in zip(*columns)])
    write_png(out / f"{name}.png", sheet(pictures, [*variants, "truth, given scene"]))
    return rows


def _retrained(
    scene: Scene,
    views: ViewSet,
    settings: RecolourSettings,
    palette: PaletteSettings | None,
    seed: int,
    progress: Progress,
) -> tuple[Scene, float]:
    """The scene with a palette network trained anew, and the seconds that it took."""
    known = None
    if palette is None and views.classified is not None:
        known = regions_of(views.classified, views, scene, seed)
    found = palette_of(views, scene.occupancy, seed, palette) if known is None else known.palette
    network, shares, seconds = recolour(
        views, scene.base, scene.occupancy, scene.marching, found.colours, scene.settings, settings, seed, None,
        progress, None, None if known is None else known.owners,
    )  # fmt: skip
    ranges = ((),) * len(shares) if known is None else known.ranges
    regions = tuple(
        Region(tuple(colour), float(share), values=hull_of(ranges[i]), ranges=ranges[i])
        for i, (colour, share) in enumerate(zip(network.colours.tolist(), shares, strict=True))
    )
    return replace(scene, palette=network, styled=None, regions=regions), seconds


def _read_views(folder: Path) -> tuple[ViewSet, ViewSet]:
    """Training and test views of one folder."""
    return ViewSet.read(folder, "train"), ViewSet.read(folder, "test")
