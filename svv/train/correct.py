"""A palette corrected by hand: stage 2 is trained again for it, on the base network that is there.

The paper's cure for regions of similar hue (StyleRF-VolVis, section limitations): the palette that is found joins them,
and somebody who knows better says so.
"""

from __future__ import annotations

import time
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from svv.core.cameras import CameraRig
from svv.core.classified import ClassifiedVolume
from svv.core.correction import Correction, Entry, corrected
from svv.errors import BadInput, Progress, part, silent
from svv.fields.edits import History, edits_of, with_edits
from svv.fields.scene import Scene
from svv.io.viewset import ViewSet
from svv.kernels.dispatch import forget_gpu_peak
from svv.measure import measured
from svv.options.making import PaletteOptions
from svv.train.checkpoint import Checkpoint
from svv.train.config import Preset, given, preset
from svv.train.loop import Running
from svv.train.pipeline import key_of
from svv.train.ranges import Owners, membership, regions_for
from svv.train.recolour import recolour
from svv.train.report import report_on
from svv.train.sampling import with_fewest_samples
from svv.train.unmix import Unmixing

ELSEWHERE = 0.05
"""Views whose cameras stand around another place or at another distance, by more than this part of it, are of another
scene."""


def correct_palette(
    scene: Scene,
    views: ViewSet,
    correction: Correction,
    options: PaletteOptions | Preset | str = PaletteOptions(),
    progress: Progress = silent,
    checkpoint: Path | None = None,
    **changes: Any,
) -> tuple[Scene, dict[str, Any]]:
    """Correct the palette of a scene and train its palette colour network again; the base network stays.

    Where the scene knows which values its regions show and the views carry the classified volume, regions stay made of
    ranges of the transfer function: they are merged and taken apart, and a removed region's go to their neighbours.
    Else the corrected palette is taken as given, and the views decide which point is of which colour.

    Args:
        scene: With a palette network; its device is where the work is done.
        views: Those it was trained on, or others of the same scene.
        correction: What to do.
        options: How to train. The name of a preset, or settings of your own, stand for the usual options with these.
        progress: Called several times a second; stops the training when it raises.
        checkpoint: File to save to now and then, and to resume from if it exists.
        changes: Fields of the options by name, such as ``time_limit=60``.

    Returns:
        The scene with its new regions: those that took over an old one keep its edits, without a history. Its
        paintings are gone, for they are of the old regions. And a report as of :func:`train_scene`, whose ``notes``
        say what was done.

    Raises:
        BadInput: no palette network, views of another scene, or a correction that cannot be
            (:func:`svv.core.correction.corrected`).
    """
    if scene.palette_network is None:
        raise BadInput("The scene holds no palette network to correct; train it again.")
    asked, chosen = given(PaletteOptions, options, changes)
    time_limit, seed = asked.time_limit, asked.seed
    if time_limit is not None and not time_limit > 0:
        raise BadInput(f"The time limit must be more than 0 seconds, not {time_limit}.")
    _check_views(scene, views)
    if not isinstance(options, Preset):
        chosen = preset(asked.preset, scene.settings.encoding)
    if asked.views_only:
        views = replace(views, classified=None)
    volume = views.classified if all(region.values for region in scene.regions) else None
    ranges = () if volume is None else volume.ranges
    entries, notes = corrected(_entries(scene, volume), correction, ranges)
    palette, owners, unmixing = np.array([entry.colour for entry in entries]), None, None
    if volume is not None:
        owners = Owners(volume, np.array([[r in e.ranges for e in entries] for r in range(len(ranges))]), scene.device)
    if owners is None or owners.shared:
        unmixing = Unmixing(palette, scene.device)
    saved = None
    if checkpoint is not None:
        key = {**key_of(views, chosen, time_limit, seed), "scene": scene.made, "palette": [asdict(e) for e in entries]}
        saved = Checkpoint(checkpoint, key)
    forget_gpu_peak(scene.device)
    with measured() as cost:
        network, shares, spent = recolour(
            views, scene, palette, chosen.recolour,
            Running(seed, time_limit, part(progress, 0.0, 0.98), saved), owners, unmixing,
        )  # fmt: skip
        begin = time.monotonic()
        shown = [tuple((ranges[r].low, ranges[r].high) for r in entry.ranges) for entry in entries]
        regions = regions_for(network, shares, shown)
        plain = replace(scene, palette_network=network, regions=regions, history=History(), styled=None, painting=None,
                        others=())  # fmt: skip
        plain, reason = with_fewest_samples(plain, views.cameras)
        progress(1.0, "palette colour network")
    if scene.variants:
        notes = (*notes, f"paintings of the old regions dropped: {', '.join(scene.variants)}")
    kept = (edits_of(scene.regions[entry.origin[0]]) if entry.origin else {} for entry in entries)
    result = replace(plain, regions=tuple(with_edits(r, e) for r, e in zip(regions, kept, strict=True)))
    seconds = {"pcn": spent, "sampling": time.monotonic() - begin}
    report = report_on(
        result, {**seconds, "total": sum(seconds.values())}, cost, chosen, seed,
        encoding=scene.settings.encoding, notes=[*notes, reason],
    )  # fmt: skip
    made = {name: value for name, value in scene.made.items() if name not in ("stylized", "key")}
    return replace(result, made={**made, "corrected": [*scene.made.get("corrected", []), report]}), report


def _entries(scene: Scene, volume: ClassifiedVolume | None) -> list[Entry]:
    """The palette as it is, with the ranges of each region where the volume is known."""
    member = np.zeros((0, len(scene.regions)), bool) if volume is None else membership(scene.regions, volume)
    return [
        Entry(region.colour, region.share, (number,), tuple(int(r) for r in np.flatnonzero(member[:, number])))
        for number, region in enumerate(scene.regions)
    ]


def _check_views(scene: Scene, views: ViewSet) -> None:
    rig, ours = CameraRig.of(views.cameras), scene.rig
    far = np.linalg.norm(np.subtract(rig.centre, ours.centre)) + abs(rig.radius - ours.radius)
    if not far <= ELSEWHERE * ours.radius:
        raise BadInput("These views are of another scene: give those that it was trained on.")
