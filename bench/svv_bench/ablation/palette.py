"""Ablations of the palette network: refinement of the palette, and weight of the offsets (lambda_delta).

See :mod:`svv_bench.ablation.painting`. Only the palette network is trained again, on the frozen density of the given
scene, and is measured on the test views.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from svv.core.colour.palette import PaletteSettings
from svv.errors import Progress, part
from svv.fields.radiance.rendering import composite, march
from svv.fields.scene.scene import Scene
from svv.io.files.atomic import write_json
from svv.io.pictures.output import region_picture, write_png
from svv.io.views.viewset import ViewSet
from svv.job.steps import turned
from svv.render.frames import region_colours
from svv.render.pictures import Picture, cropped, over_white, sheet
from svv.train.evaluate import evaluate_scene
from svv.train.palette.ranges import regions_for, regions_of
from svv.train.palette.recolour import palette_of, recolour
from svv.train.run.batches import RayPool
from svv.train.run.config import RecolourSettings, preset
from svv.train.run.loop import Running
from svv_bench.keys import key_of_measure
from svv_bench.stability.measures import matched, overlaps
from svv_bench.styles.modes import kept_scene

Row = dict[str, Any]
Array = NDArray[Any]

OFFSET_RAYS = 16384
"""Number of random rays over which the size of offsets is measured."""


@dataclass(frozen=True)
class PaletteVariant:
    """A change of the palette network."""

    recolour: Callable[[RecolourSettings], RecolourSettings] = lambda s: s
    palette: PaletteSettings | None = None
    """How the palette is extracted from the views; None extracts it as training does, from the volume if known."""


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

PALETTE_COLUMNS = {
    "regions": "regions", "shares": "their shares, %", "overlap": "overlap", "offsets": "offsets", "psnr": "PSNR, dB",
    "psnr_foreground": "foreground, dB", "ssim": "SSIM", "flip": "FLIP", "lpips": "LPIPS", "seconds": "seconds",
}  # fmt: skip
"""Figure -> title of its column in the table."""

PALETTE_NOTE = (
    "Shares: of the visible light. Overlap: intersection over union of the region maps with those of the given scene, "
    "best at 1. Offsets: root mean square difference of colours from those of the palette, in units of full scale. "
    "Scores are means over the test views: higher is better for PSNR and SSIM, lower for FLIP and LPIPS. In the last "
    "row of the picture, the hue of every region is shifted."
)


def ablate_palette(
    file: Path, name: str, scene: Scene, views: tuple[ViewSet, ViewSet], preset_name: str, seed: int, out: Path,
    progress: Progress,
) -> list[Row]:  # fmt: skip
    """Train the unfinished variants of one ablation, score all, and draw their sheet.

    Args:
        file: File of the given scene.
        name: Name of the ablation, of :data:`PALETTES`.
        scene: The given scene, whose base network all variants share.
        views: Training and test views.
        preset_name: Preset that the variants are trained with.
        seed: Seed of their networks and rays.
        out: Folder of the results.
        progress: Called several times per second.

    Returns:
        The figures of the variants, one row per variant.
    """
    train, test = views
    rows, columns, variants = [], [], PALETTES[name]
    truth = [scene.render(camera, "pcn") for camera in test.cameras]
    middle = len(test.cameras) // 2
    for number, (label, variant) in enumerate(variants.items()):
        each = part(progress, number / len(variants), (number + 1) / len(variants))
        settings = variant.recolour(preset(preset_name).recolour)
        key = key_of_measure({"scene": file, "views": train.images,
                      "recolour": asdict(settings), "palette": variant.palette and asdict(variant.palette),
                      "seed": seed})  # fmt: skip

        def make(
            saved: Path, settings: RecolourSettings = settings, variant: PaletteVariant = variant, each: Progress = each
        ) -> tuple[Scene, dict[str, float]]:
            made, seconds = _retrained(scene, train, settings, variant.palette, seed, part(each, 0.0, 0.8))
            return made, {"pcn": seconds}

        made, seconds = kept_scene(out / "scenes" / key, key, make)
        scores = evaluate_scene(made, test, "pcn", part(each, 0.8, 1.0))
        figures = {
            **scores.to_json(),
            "offsets": offset_size(made, test, seed),
            "shares": ", ".join(f"{100 * region.share:.1f}" for region in made.regions),
        }
        shown = [made.render(camera, "pcn") for camera in test.cameras]
        maps = [np.stack([s.region for s in some]) for some in (truth, shown)]
        table = overlaps(maps[0], maps[1], len(scene.regions), len(made.regions))
        rows.append({"ablation": name, "variant": label, "seconds": seconds, "regions": len(made.regions),
                     "overlap": float(np.mean(matched(table))),
                     **{k: figures[k] for k in PALETTE_COLUMNS if k in figures}})  # fmt: skip
        write_json(out / "scenes" / key / "scores.json", {**rows[-1], "views": scores.views, "size": figures["size"]})
        columns.append(_pictures(made, test, middle, shown[middle].rgba, shown[middle].region))
    columns.append(_pictures(scene, test, middle, test.images[middle], truth[middle].region))
    pictures = cropped([list(row) for row in zip(*columns)])
    write_png(out / f"{name}.png", sheet(pictures, [*variants, "truth, given scene"]))
    return rows


def _pictures(scene: Scene, views: ViewSet, view: int, rgba: Array, region: NDArray[np.int16]) -> list[Picture]:
    """Return a view as given, its regions, and the view with the hue of every region shifted."""
    edited = replace(scene, regions=tuple(replace(r, style=None) for r in scene.regions))
    for number, one in enumerate(scene.regions):
        edited = edited.edited(number, turned(one.colour), None, None)
    shown = edited.render(views.cameras[view], "pcn").rgba
    return [over_white(rgba), over_white(region_picture(region, region_colours(scene))), over_white(shown)]


@torch.no_grad()
def offset_size(scene: Scene, views: ViewSet, seed: int) -> float:
    """Measure by how much mixed colours differ from the palette's: root mean square of sum_i w_i delta_i.

    The mean is over channels and over the light of random pixels of the views.

    Returns:
        The difference, for colours in [0, 1]; 0 if every region has only one colour.
    """
    assert scene.palette_network is not None
    batch = RayPool(views, scene.occupancy.box, seed, scene.device).batch(0, OFFSET_RAYS)
    samples = march(batch.rays, scene.occupancy, scene.base.density, scene.marching)
    _, weights, offsets = scene.palette_network.material(samples.position)
    squares = (weights[:, :, None] * offsets).sum(dim=1).square().mean(dim=1, keepdim=True)
    seen, transmittance, _ = composite(samples, scene.base.extinction(samples), squares)
    return float((seen.sum() / (1.0 - transmittance).sum().clamp(min=1e-9)).sqrt())


def _retrained(
    scene: Scene,
    views: ViewSet,
    settings: RecolourSettings,
    palette: PaletteSettings | None,
    seed: int,
    progress: Progress,
) -> tuple[Scene, float]:
    """Return the scene with its palette network trained again, and the training time in seconds."""
    known = None
    if palette is None and views.classified is not None:
        known = regions_of(views.classified, views, scene, seed)
    found = palette_of(views, scene.occupancy, seed, palette) if known is None else known.palette
    network, shares, seconds = recolour(
        views, scene, found.colours, settings, Running(seed, progress=progress), None if known is None else known.owners
    )
    regions = regions_for(network, shares, None if known is None else known.ranges)
    return replace(scene, palette_network=network, styled=None, regions=regions), seconds
