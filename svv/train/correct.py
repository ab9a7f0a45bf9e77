"""Palette correction by hand: stage 2 is trained again for a new palette, the paper's remedy for similar hues."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from svv.core.colour.correction import Correction, Entry, corrected
from svv.core.colour.hex_codes import to_hex
from svv.core.colour.palette import PaletteSettings
from svv.core.geometry.cameras import CameraRig
from svv.core.volumes.classified import ClassifiedVolume, ValueGrid
from svv.errors import BadInput, Progress, part, silent
from svv.fields.radiance.encodings import SparseLattice
from svv.fields.radiance.networks import PaletteField
from svv.fields.scene.history import History, edits_of, with_edits
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet
from svv.kernels.dispatch import forget_gpu_peak
from svv.measure import measured
from svv.options.making import PaletteOptions
from svv.train.base.sampling import with_fewest
from svv.train.expected_errors import expected_errors
from svv.train.palette.pointed import InCells, pointed
from svv.train.palette.ranges import Labelled, Owners, membership, regions_for
from svv.train.palette.recolour import recolour
from svv.train.palette.regions_from_views import owners_of
from svv.train.palette.unmix import Unmixing
from svv.train.pipeline import key_of
from svv.train.run.checkpoint import Checkpoint
from svv.train.run.config import Preset, RecolourSettings, given, preset
from svv.train.run.loop import Running
from svv.train.run.report import Report, report_on

AGAIN = 50
"""Most steps of stage 2 where it starts from a trained network: only borders of regions change."""

FOLLOWED = 0.8
"""Least part of what was pointed at that a network must give to its new region."""

OPACITIES = ("Points", "ScalarOpacityUnitDistance")
"""Entries of a transfer function on which opacities depend."""

ELSEWHERE = 0.05
"""Largest deviation of the cameras' centre and distance, relative to the distance, from those of the same scene."""


def correct_palette(
    scene: Scene,
    views: ViewSet,
    correction: Correction,
    options: PaletteOptions | Preset | str = PaletteOptions(),
    progress: Progress = silent,
    checkpoint: Path | None = None,
    **changes: object,
) -> tuple[Scene, Report]:
    """Correct the palette of a scene and train its palette colour network again; the base network does not change.

    If the scene knows which values its regions show and the views include the classified volume, regions remain unions
    of transfer function ranges: these are merged and split, and those of a removed region go to their neighbours.
    Otherwise the views decide which colour of the corrected palette each point has
    (:func:`svv.train.palette.regions_from_views.owners_of`). Places that are pointed at change the regions of the
    connected pieces around them (:func:`svv.train.palette.pointed.pointed`).

    Args:
        scene: A scene with a palette network; its device does the work.
        views: Views that it was trained on, or others of the same scene.
        correction: Changes of the palette.
        options: How to train. The name of a preset, or custom settings, mean the default options with these settings.
        progress: Called several times a second; stops the training when it raises.
        checkpoint: File to save to regularly, and to resume from if it exists.
        changes: Fields of the options to change, by name, such as ``time_limit=60``.

    Returns:
        The scene with its new regions, and a report as from :func:`train_scene`, whose ``notes`` say what was done. A
        region that replaces an old one keeps its edits, but there is no history. Paintings and parts are dropped,
        because they belong to the old regions.

    Raises:
        BadInput: There is no palette network, the views are of another scene, or the correction is impossible
        (:func:`svv.core.colour.correction.corrected`).

    >>> corrected, report = svv.correct_palette(scene, views, svv.Correction(merge=((0, 1),)), "draft")
    >>> len(corrected.regions)
    1
    """
    asked, chosen = given(PaletteOptions, options, changes)
    time_limit, seed = asked.time_limit, asked.seed
    if time_limit is not None and not time_limit > 0:
        raise BadInput(f"The time limit must be more than 0 seconds, not {time_limit}.")
    _check(scene, views)
    if not isinstance(options, Preset):
        chosen = preset(asked.preset, scene.settings.encoding)
    if asked.views_only:
        views = replace(views, classified=None)
    volume = views.classified if all(region.values for region in scene.palette_regions) else None
    entries, owners, notes, start = _planned(scene, views, volume, correction, chosen.fitted, seed)
    ranges, palette = () if volume is None else volume.ranges, np.array([entry.colour for entry in entries])
    unmixing = Unmixing(palette, scene.device) if owners is None or owners.shared else None
    values = _values_for(scene, volume, owners)
    how = chosen.recolour if values is None else replace(chosen.recolour, feature_rate=0.0)
    saved = None
    if checkpoint is not None:
        key = {**key_of(views, chosen, time_limit, seed), "scene": scene.made, "palette": [asdict(e) for e in entries],
               "places": (correction.points, correction.same)}  # fmt: skip
        saved = Checkpoint(checkpoint, key)
    forget_gpu_peak(scene.device)
    with measured() as cost:
        running = Running(seed, time_limit, part(progress, 0.0, 0.98), saved, notes)
        run = partial(recolour, views, scene, palette, owners=owners, given=unmixing, values=values)
        network, shares, spent, kept = _trained(run, how, running, owners, start)
        begin = time.monotonic()
        shown = [tuple((ranges[r].low, ranges[r].high) for r in entry.ranges) for entry in entries]
        regions = regions_for(network, shares, shown)
        plain = replace(
            scene, palette_network=network, regions=regions, unsplit=(), history=History(), styled=None, painting=None,
            others=(), parts=None, values=None if values is None else scene.values,
            steps=None if values is None else scene.steps,
        )  # fmt: skip
        reason = "images use the samples that they used before"
        if not kept:
            plain, reason = with_fewest(plain, views)
        expected = expected_errors(plain, views, how.iterations * how.rays, seed)
        progress(1.0, "palette colour network")
    notes += _not_followed(owners, network) + _dropped(scene)
    edits = (edits_of(scene.regions[entry.origin[0]]) if entry.origin else {} for entry in entries)
    result = replace(
        plain, expected=expected, regions=tuple(with_edits(r, e) for r, e in zip(regions, edits, strict=True))
    )
    seconds = {"pcn": spent, "sampling": time.monotonic() - begin}
    report = report_on(result, {**seconds, "total": sum(seconds.values())}, cost, chosen, seed)
    report |= Report(
        encoding=scene.settings.encoding,
        notes=[*notes, reason],
        learned_from="views only" if volume is None else "volume and views",
    )
    return replace(result, made=_made(scene, report)), report


def _made(scene: Scene, report: Report) -> dict[str, Any]:
    """Return how a corrected scene was made: as before, without what was said of the old regions."""
    made = {name: value for name, value in scene.made.items() if name not in ("stylized", "key", "confidence")}
    if "warnings" in made:
        made["warnings"] = [said for said in made["warnings"] if not said.startswith("Region ")]
    return {**made, "corrected": [*scene.made.get("corrected", []), report]}


def _trained(
    run: Callable[..., tuple[PaletteField, NDArray[np.float64], float]], how: RecolourSettings, running: Running,
    owners: Labelled | None, start: PaletteField | None,
) -> tuple[PaletteField, NDArray[np.float64], float, bool]:  # fmt: skip
    """Train from a network, or afresh if that does not follow its new regions; the last result is whether it did."""
    spent = 0.0
    if start is not None and isinstance(owners, InCells):
        few = replace(how, iterations=min(how.iterations, AGAIN))
        network, shares, spent = run(settings=few, running=running, start=start)
        if owners.followed_by(network) >= FOLLOWED:
            return network, shares, spent, True
        running = replace(running, saved=None)  # what is saved is the network that did not follow
    network, shares, again = run(settings=how, running=running)
    return network, shares, spent + again, False


def _not_followed(owners: Labelled | None, network: PaletteField) -> list[str]:
    """Say if a network does not show places as the regions that they are said to be."""
    part = owners.followed_by(network) if isinstance(owners, InCells) else 1.0
    if part >= FOLLOWED:
        return []
    return [
        f"only {part:.0%} of what was pointed at is shown as its new region, from whose colour it differs too much: "
        "point at it as a new region, or set the region's colour first"
    ]


def _planned(
    scene: Scene, views: ViewSet, volume: ClassifiedVolume | None, correction: Correction, fitted: bool, seed: int
) -> tuple[tuple[Entry, ...], Labelled | None, list[str], PaletteField | None]:
    """Return the new palette, the region of each point if it is known, what was done, and a network to start from."""
    if correction.of_places:
        return _by_places(scene, volume, correction)
    ranges = () if volume is None else volume.ranges
    entries, found = corrected(_entries(scene, volume), correction, ranges)
    owners: Labelled | None = None
    if volume is not None:
        owners = Owners(volume, np.array([[r in e.ranges for e in entries] for r in range(len(ranges))]), scene.device)
    elif fitted and isinstance(scene.base.encoding, SparseLattice):
        owners = owners_of(scene, views, np.array([entry.colour for entry in entries]), seed)
    return entries, owners, [*found], None


def _by_places(
    scene: Scene, volume: ClassifiedVolume | None, correction: Correction
) -> tuple[tuple[Entry, ...], Labelled, list[str], PaletteField | None]:
    """Return what :func:`_planned` does, for places that are pointed at; if only borders change, training goes on."""
    if volume is not None:
        raise BadInput(
            "The regions of this scene are ranges of its volume's values, which no place changes: give --views-only to "
            "correct them by places, or svv edit --split-at for a connected part of one."
        )
    if replace(correction, merge=(), points=(), same=()):
        raise BadInput("Point at places first, and add, remove, set or split regions in a second correction.")
    found = pointed(scene, correction.points, correction.same)
    entries, said = tuple(_entries(scene, None)), list(found.said)
    count, groups = len(entries), _joined(len(entries), (*correction.merge, *found.merged))
    if groups:
        entries, merged = corrected(entries, Correction(merge=groups))
        said += merged
    if found.added is not None:
        if len(entries) >= PaletteSettings().max_colours:
            raise BadInput(f"The palette has {len(entries)} colours, the most it can have: merge two regions first.")
        entries = (*entries, Entry(found.added))
        said.append(f"region {len(entries) - 1} ({to_hex(found.added)}) is new")
    now = np.full(count + 1, len(entries) - 1)
    for number, entry in enumerate(entries):
        now[list(entry.origin)] = number
    region = np.where(found.region < 0, -1, now[found.region.clip(min=0)])
    same = len(entries) == count and not groups and scene.values is None
    start = scene.palette_network if same else None
    return entries, InCells(region, found.cells, scene.device, found.moved), said, start


def _joined(count: int, groups: Sequence[tuple[int, ...]]) -> tuple[tuple[int, ...], ...]:
    """Return groups of regions that share none: those of groups that do are one."""
    for group in groups:
        if not all(0 <= number < count for number in group):
            return tuple(groups)  # refused as any merge of a region that does not exist
    pairs = np.array([pair for group in groups for pair in pairwise(group)], np.int64).reshape(-1, 2)
    member = connected_components(coo_matrix((np.ones(len(pairs)), pairs.T), shape=(count, count)), directed=False)[1]
    every = (tuple(np.flatnonzero(member == k).tolist()) for k in range(count))
    return tuple(group for group in every if len(group) > 1)


def _values_for(scene: Scene, volume: ClassifiedVolume | None, owners: Labelled | None) -> ValueGrid | None:
    """Return the values of which the new palette network is a function, too; None if it must learn its features."""
    known = volume is not None and volume.values is not None and volume.box == scene.occupancy.box
    if scene.values is None or not known or owners is None or owners.shared:
        return None
    assert volume is not None and volume.values is not None
    return volume.values.over(scene.values.interval, scene.values.visible)


def _dropped(scene: Scene) -> list[str]:
    """Say what belongs to the old regions and is dropped with them."""
    parts, paintings = len(scene.regions) - len(scene.palette_regions), ", ".join(scene.variants)
    said = [f"{parts} parts of the old regions dropped: split the new ones again"] if parts else []
    return [*said, f"paintings of the old regions dropped: {paintings}"] if paintings else said


def _entries(scene: Scene, volume: ClassifiedVolume | None) -> list[Entry]:
    """Return the present palette, with the ranges of each region if the volume is known."""
    own = scene.palette_regions
    member = np.zeros((0, len(own)), bool) if volume is None else membership(own, volume)
    return [
        Entry(region.colour, region.share, (number,), tuple(int(r) for r in np.flatnonzero(member[:, number])))
        for number, region in enumerate(own)
    ]


def _check(scene: Scene, views: ViewSet) -> None:
    """Raise BadInput if the palette of the scene cannot be corrected with these views."""
    scene.check_alone("Palette correction")
    if scene.palette_network is None:
        raise BadInput("The scene holds no palette network to correct; train it again.")
    rig, ours = CameraRig.of(views.cameras), scene.rig
    far = np.linalg.norm(np.subtract(rig.centre, ours.centre)) + abs(rig.radius - ours.radius)
    if not far <= ELSEWHERE * ours.radius:
        raise BadInput("These views are of another scene: give the views that the scene was trained on.")
    shown, drawn = scene.made.get("source", {}).get("tf"), views.meta.tf
    if shown is not None and drawn is not None and any(shown.get(k) != drawn.get(k) for k in OPACITIES):
        raise BadInput(
            "The scene shows other opacities than these views: correct the palette with the opacities that it was "
            "trained on, or give views of the transfer function as it is now."
        )
