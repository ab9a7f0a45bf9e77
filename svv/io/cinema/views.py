"""Views from a Cinema database: rows are chosen, cameras placed and checked, and some views kept for the scores."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from svv.core.geometry.cameras import Camera, CameraRig
from svv.errors import BadInput, Progress, part, silent
from svv.io.cinema.pictures import read_pair, read_pictures, transparent
from svv.io.cinema.placing import cameras_by_rows, first_of_each, gap_in, placed_about, rotations_of, spread_out
from svv.io.cinema.shot import BESIDE, Shot, read_shot
from svv.io.cinema.table import OPACITY_FUNCTION, Table, check_files, is_database, read_table, select
from svv.io.cinema.transfer import opacity_function
from svv.io.views.agreement import check_agreement
from svv.io.views.on_screen import ignoring_fixed
from svv.io.views.view_meta import ViewMeta
from svv.io.views.viewset import MIN_TRAIN_VIEWS, ViewSet, write_splits
from svv.options.cinema import DatabaseOptions

MOST_TEST = 16
"""Most views that are kept for the scores by default."""

ONE_IN = 8
"""One view in so many is kept for the scores by default."""


@dataclass(frozen=True)
class Imported:
    """Views of a database."""

    train: ViewSet
    test: ViewSet | None
    """Views for the scores; None if there are too few views to keep any."""
    notes: tuple[str, ...]
    """What was chosen, left out, assumed and found, a sentence each."""

    def write(self, folder: Path, progress: Progress = silent) -> None:
        """Write the views as a folder of views; see :meth:`svv.io.views.viewset.ViewSet.write`."""
        write_splits(folder, self.train, self.test, progress)


def read_database(path: str | Path, options: DatabaseOptions | None = None, progress: Progress = silent) -> Imported:
    """Read a Cinema database; raises BadInput if it is damaged, contradicts its cameras, or an option is wrong."""
    options = options or DatabaseOptions()
    listed = read_table(path)
    whole, lacking = check_files(listed)
    wanted = _wanted(options.select)
    table, notes = select(whole, wanted)
    notes += [] if lacking is None else [lacking]
    rotations = rotations_of(table)
    if rotations is not None:
        kept = first_of_each(rotations[:, :, 2])
        table, rotations = _thinned(table, rotations, kept, options.n + _test_views(options, len(kept)), notes)
    progress(0.02, "Reading the table")
    files = [table.folder / name for name in table.files]
    metas: list[dict[str, object]] = [{} for _ in files]
    assumed = None
    if options.black is None:
        pictures, metas = read_pictures(files, part(progress, 0.02, 0.9))
        images, assumed = transparent(pictures, files, None if options.alpha == "auto" else options.alpha)
    else:
        images = read_pair(files, _partners(table, whole, options.black, wanted), part(progress, 0.02, 0.9))
    size = images.shape[2], images.shape[1]
    shot = _shot(options, table.folder)
    said: list[str] = []
    placed = None if _given(options) else cameras_by_rows(table, metas, size)
    if placed is not None:
        table, images, cameras = _distinct(table, images, placed, options, notes)
        agreement = check_agreement(cameras, images, _names(table.files), table.folder)
    elif rotations is not None:
        cameras, said, agreement = placed_about(table, rotations, shot, images)
    else:
        raise BadInput(f"{table.folder} says nothing about cameras: it has neither phi and theta nor cameras.")
    notes += [] if assumed is None else [assumed]
    fixed = None if options.ignore_fixed else agreement.fixed
    notes += said + [note for note in (agreement.found, agreement.doubt, fixed, gap_in(_axes(cameras))) if note]
    progress(0.95, "Placing cameras")
    return _split(table, images, cameras, options, listed.key(), notes)


def read_views(path: str | Path, split: str = "train", progress: Progress = silent) -> ViewSet:
    """Read a split of a folder of views, or of a Cinema database, its notes in ``meta.assumed``; raises BadInput."""
    path = Path(path)
    if not is_database(path):
        return ViewSet.read(path, split, progress)
    imported = read_database(path, None, progress)
    found = imported.train if split == "train" else imported.test if split == "test" else None
    if found is None:
        raise BadInput(f"{path} has no views for the split {split}; with few views, none are kept from training.")
    return found


def _wanted(choices: Sequence[str]) -> dict[str, str]:
    wanted = {}
    for choice in choices:
        column, sign, value = choice.partition("=")
        if not (column.strip() and sign):
            raise BadInput(f"--select needs COLUMN=VALUE, for example --select time=0.5, not '{choice}'.")
        wanted[column.strip()] = value.strip()
    return wanted


def _given(options: DatabaseOptions) -> bool:
    return any(getattr(options, name) is not None for name in ("cameras", *vars(Shot())))


def _shot(options: DatabaseOptions, folder: Path) -> Shot:
    """Return what options, their file, and the file beside the table say, in this order."""
    if options.view_angle is not None and options.parallel_scale is not None:
        raise BadInput("Give --view-angle for perspective or --parallel-scale for orthographic cameras, not both.")
    shot = Shot(options.focal_point, options.distance, options.view_angle, options.parallel_scale).validate("Options")
    if options.cameras is not None:
        return shot.or_else(read_shot(options.cameras))
    return shot.or_else(read_shot(folder / BESIDE)) if (folder / BESIDE).is_file() else shot


def _thinned(
    table: Table, rotations: NDArray[np.float64], kept: list[int], most: int, notes: list[str]
) -> tuple[Table, NDArray[np.float64]]:
    if len(kept) < len(table):
        notes.append(
            f"{len(table) - len(kept)} of {len(table)} images repeat a direction and are left out: {len(kept)} remain. "
            "ParaView draws a direction twice if the number of thetas is even, the second time upside down."
        )
    if len(kept) > most:
        chosen = spread_out(rotations[kept, :, 2], most)
        notes.append(f"{most} of {len(kept)} directions are used, spread evenly; --n changes their number.")
        kept = [kept[k] for k in chosen]
    return table.take(kept), rotations[kept]


def _distinct(
    table: Table, images: NDArray[np.uint8], cameras: list[Camera], options: DatabaseOptions, notes: list[str]
) -> tuple[Table, NDArray[np.uint8], list[Camera]]:
    """Leave out views that repeat another, and those beyond the number wanted."""
    positions = np.stack([camera.position for camera in cameras])
    scale = float(np.linalg.norm(positions - positions.mean(axis=0), axis=1).max()) or 1.0
    kept = first_of_each(np.hstack([_axes(cameras), positions / scale]))
    rotations = np.stack([camera.camera_to_world[:3, :3] for camera in cameras])
    most = options.n + _test_views(options, len(kept))
    rows = table.take(range(len(table)))
    rows.columns["svv row"] = [str(k) for k in range(len(table))]
    rows, _ = _thinned(rows, rotations, kept, most, notes)
    left = [int(k) for k in rows.columns["svv row"]]
    return table.take(left), images[left], [cameras[k] for k in left]


def _partners(table: Table, whole: Table, black: str, wanted: dict[str, str]) -> list[Path]:
    """Return the files over the other background, one a row."""
    producers = whole.column("producer") or []
    if is_database(black):
        other, _ = check_files(read_table(black))
        other, _ = select(other, {k: v for k, v in wanted.items() if k.lower() != "producer"})
    elif black in producers:
        other, _ = select(whole, {**wanted, "producer": black})
    else:
        listed = ", ".join(dict.fromkeys(producers)) or "none"
        raise BadInput(f"--black {black} is neither a Cinema database nor a producer in it (it has {listed}).")
    keys = [_directions(each) for each in (table, other)]
    places = {key: k for k, key in enumerate(keys[1])}
    lacking = [name for name, key in zip(table.files, keys[0]) if key not in places]
    if lacking:
        raise BadInput(f"{black} has no image over black for {lacking[0]} and {len(lacking) - 1} others.")
    return [other.folder / other.files[places[key]] for key in keys[0]]


def _directions(table: Table) -> list[tuple[float, float]]:
    phi, theta = table.column("phi"), table.column("theta")
    if phi is None or theta is None:
        raise BadInput(f"{table.folder} needs columns phi and theta to find the same view over black.")
    rotations_of(table)  # checks that they are numbers
    return [(round(float(p), 2), round(float(t), 2)) for p, t in zip(phi, theta)]


def _axes(cameras: Sequence[Camera]) -> NDArray[np.float64]:
    return np.stack([camera.camera_to_world[:3, 2] for camera in cameras])


def _test_views(options: DatabaseOptions, count: int) -> int:
    return min(MOST_TEST, count // ONE_IN) if options.test is None else options.test


def _split(
    table: Table, images: NDArray[np.uint8], cameras: list[Camera], options: DatabaseOptions, key: str, notes: list[str]
) -> Imported:
    count = _test_views(options, len(cameras))
    if len(cameras) - count < MIN_TRAIN_VIEWS:
        raise BadInput(
            f"{table.folder} has {len(cameras)} different views; with {count} for the scores, fewer than "
            f"{MIN_TRAIN_VIEWS} remain for training."
        )
    function = table.column(*OPACITY_FUNCTION)
    meta = ViewMeta(
        rig=CameraRig.of(cameras),
        tf=None if function is None else opacity_function(table.folder, function[0]),
        assumed=" ".join(notes) or None,
        other={"cinema": {"database": table.folder.name, "selected": dict(table.chosen), "key": key}},
    )
    names = _names(table.files)
    views = ViewSet(tuple(cameras), images, names, meta)
    if options.ignore_fixed:
        views, said = ignoring_fixed(views)
        views, cameras = replace(views, meta=replace(meta, assumed=" ".join([*notes, said]))), list(views.cameras)
        notes.append(said)
    unseen = spread_out(_axes(cameras), count) if count else []
    train = [k for k in range(len(cameras)) if k not in set(unseen)]
    return Imported(views.take(train), views.take(unseen) if unseen else None, tuple(notes))


def _names(files: Sequence[str]) -> tuple[str, ...]:
    stems = [Path(name).stem for name in files]
    if len(set(stems)) == len(stems):
        return tuple(stems)
    return tuple(str(Path(name).with_suffix("")).replace("/", "_") for name in files)
