"""Hashes of what results depend on, the same in every process, and the names under which results are kept.

A name has the result's kind, source, settings, and version: ``scene-<source>-<settings>-0.2.0.1.svv``.
"""

from __future__ import annotations

import weakref
from pathlib import Path
from typing import TYPE_CHECKING

from svv._version import __version__
from svv.io.files.keyed_results import GENERATION, digest, digest_of_file
from svv.pv.results.time_steps import Moment

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene
    from svv.io.views.viewset import ViewSet

CIRCUMSTANCES = ("seconds", "key", "look", "data", "time")
"""Keys of the views' metadata on which no picture depends."""

LEARNED = ("box", "cells", "settings", "marching", "images", "camera_rig", "normal_resolutions")
"""Keys of a scene's header that training determines."""

RETUNED = "retuned"
"""Key of a scene's record: hash of the scene (:func:`digest_of_scene`) whose opacities were changed since."""

_views: weakref.WeakKeyDictionary[ViewSet, str] = weakref.WeakKeyDictionary()
_scenes: weakref.WeakKeyDictionary[object, str] = weakref.WeakKeyDictionary()


def name_of(kind: str, source: str, settings: str) -> str:
    """Return the name of ``views``, a ``scene``, ``palette`` or ``painting``, by hashes of source and settings."""
    return f"{kind}-{source}-{settings}-{__version__}.{GENERATION}{'' if kind == 'views' else '.svv'}"


def source_of(now: Moment) -> str:
    """Return a hash of a filter's inputs, without its settings."""
    return digest(now.look, now.data)


def key_of(now: Moment) -> str:
    """Return the hashes of a filter's inputs and settings, on which its result depends apart from the version."""
    return f"{source_of(now)}-{now.settings}"


def key_in(name: str) -> str:
    """Return the key (:func:`key_of`) of the result with this name."""
    return "-".join(name.split("-")[1:3])


def settings_in(name: str, kind: str) -> str:
    """Return the hash of the settings in a name; '' if the name is not of this kind."""
    parts = name.split("-")
    return parts[2] if len(parts) > 3 and parts[0] == kind else ""


def digest_of_mask(path: str | Path) -> str:
    """Return a hash of a mask and of the points stored with it; raise BadInput if they cannot be read."""
    from svv.io.pictures.mask_file import points_file  # imports PIL, which would delay the start of ParaView's window

    points = points_file(Path(path))
    return digest(digest_of_file(path), digest_of_file(points) if points.is_file() else None)


def digest_of_views(views: ViewSet) -> str:
    """Return a hash of images, cameras and the classified volume; names and times do not count."""
    if views not in _views:
        cameras = [list(c.identity) for c in views.cameras]
        meta = {key: value for key, value in views.meta.to_json().items() if key not in CIRCUMSTANCES}
        volume = views.classified
        known = None if volume is None else [
            vars(volume.box), volume.cells, [vars(r) for r in volume.ranges], volume.exponent,
            volume.owner,
        ]  # fmt: skip
        _views[views] = digest(views.images, cameras, meta, known)
    return _views[views]


def digest_of_listed(file: Path) -> str:
    """Return a hash of a file that lists views, and of the files that it names, which are not decoded."""
    from svv.io.views.transforms import file_in, mask_files, present, read_transforms, split_of
    from svv.io.views.viewset import CLASSIFIED

    path, _, listed = read_transforms(file.parent, split_of(file))
    frames, _ = present(path, listed)
    volume = path.parent / CLASSIFIED
    pictures = [file_in(path, frame) for frame in frames]
    return digest([path, *pictures, *(mask_files(path, frames) or ()), *([volume] if volume.is_file() else ())])


def digest_of_scene(scene: Scene) -> str:
    """Return a hash of what was learned: box, palette, and networks except the paintings'.

    Neither edits nor other opacities change it. Parts, which no network learned, count: paintings belong to regions.
    """
    if scene.layers:
        from svv.fields.scene.joined import members  # imports torch, which would delay the start of ParaView's window

        return digest([digest_of_scene(member) for member in members(scene)])
    learned = (
        scene.base if scene.palette_network is None else scene.palette_network
    )  # a scene's edits and paintings share it
    if RETUNED in scene.made:
        _scenes[learned] = str(scene.made[RETUNED])
    if learned not in _scenes:
        header, arrays = scene.to_arrays()
        own = {k: header[k] for k in LEARNED}
        colours = [[r.colour, r.ranges] for r in scene.palette_regions]
        tables = {k: v for k, v in arrays.items() if k.split(".")[0] in ("base", "pcn", "occupied")}
        _scenes[learned] = digest(own, colours, tables)
    split = scene.regions[len(scene.palette_regions) :]
    if scene.parts is None or not split:
        return _scenes[learned]
    return digest(_scenes[learned], scene.parts.digest, [r.part_of for r in split])


def digest_of_edits(scene: Scene) -> str:
    """Return a hash of a scene's edits and paintings: all that :func:`digest_of_scene` omits, except the history."""
    header, arrays = scene.to_arrays()
    paintings = {k: v for k, v in arrays.items() if k.split(".")[0] not in ("base", "pcn", "occupied")}
    return digest({k: header[k] for k in ("regions", "lamp", "cuts", "painting", "variants")}, paintings)
