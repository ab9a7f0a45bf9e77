"""What results depend on, as hashes that are the same in every process: names under which results are kept.

A name says what was made, of what, with which settings, and by which version:
``scene-<of what>-<settings>-0.1.0.1.svv``.
"""

from __future__ import annotations

import hashlib
import json
import weakref
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from svv._version import __version__
from svv.errors import BadInput
from svv.io.atomic import to_json
from svv.pv.steps import Moment

if TYPE_CHECKING:
    from svv.fields.scene import Scene
    from svv.io.viewset import ViewSet

GENERATION = 1
"""Raised with every change after which the same input and settings give another result, if the version stays."""

CIRCUMSTANCES = ("seconds", "key", "look", "data", "time")
"""What views say about how they were drawn, and no picture depends on."""

LEARNED = ("box", "cells", "settings", "marching", "images", "camera_rig", "normal_resolutions")
"""What of a scene's header training finds."""

FILES = 64
"""Files whose hashes are remembered."""

_views: weakref.WeakKeyDictionary[ViewSet, str] = weakref.WeakKeyDictionary()
_scenes: weakref.WeakKeyDictionary[Any, str] = weakref.WeakKeyDictionary()
_files: dict[tuple[str, int, int], str] = {}


def digest(*parts: object) -> str:
    """A hash of plain values (numbers, text, and lists and mappings of them): 20 digits."""
    return _hex(json.dumps(json.loads(to_json(parts)), sort_keys=True).encode())


def name_of(kind: str, source: str, settings: str) -> str:
    """The name of a result.

    Args:
        kind: ``views``, or of scenes ``scene``, ``palette`` or ``painting``.
        source: Of what it is made: :func:`digest`.
        settings: With which settings: :func:`digest`.
    """
    return f"{kind}-{source}-{settings}-{__version__}.{GENERATION}{'' if kind == 'views' else '.svv'}"


def source_of(now: Moment) -> str:
    """A hash of what came to a filter, without its settings."""
    return digest(now.look, now.data)


def key_of(now: Moment) -> str:
    """What a result depends on, whatever the version: hashes of what came, and of the settings."""
    return f"{source_of(now)}-{now.settings}"


def key_in(name: str) -> str:
    """That of the result of this name."""
    return "-".join(name.split("-")[1:3])


def settings_in(name: str, kind: str) -> str:
    """The hash of the settings in a name, '' if it is none of this kind."""
    parts = name.split("-")
    return parts[2] if len(parts) > 3 and parts[0] == kind else ""


def digest_of_file(path: str | Path) -> str:
    """A hash of a file's content, found once until the file is another.

    Raises:
        BadInput: it cannot be read.
    """
    try:
        status = Path(path).stat()
        place = str(path), status.st_size, status.st_mtime_ns
        if place not in _files:
            if len(_files) >= FILES:
                _files.clear()
            _files[place] = _hex(Path(path).read_bytes())
    except OSError as error:
        raise BadInput(f"Cannot read {path}: {error.strerror or error}.") from error
    return _files[place]


def digest_of_mask(path: str | Path) -> str:
    """A hash of a mask and of the points that are kept beside it; raises BadInput where they cannot be read."""
    from svv.io.mask_file import points_file  # with PIL, which no plugin needs before its window is there

    points = points_file(Path(path))
    return digest(digest_of_file(path), digest_of_file(points) if points.is_file() else None)


def digest_of_views(views: ViewSet) -> str:
    """A hash of images, cameras and the classified volume; names, and how long it took, do not count."""
    if views not in _views:
        cameras = [[c.camera_to_world, c.fov_x, c.width, c.height] for c in views.cameras]
        meta = {key: value for key, value in views.meta.items() if key not in CIRCUMSTANCES}
        volume = views.classified
        known = None if volume is None else [
            vars(volume.box), volume.cells, [vars(r) for r in volume.ranges], _array(volume.exponent),
            _array(volume.owner),
        ]  # fmt: skip
        _views[views] = digest(_array(views.images), cameras, meta, known)
    return _views[views]


def digest_of_scene(scene: Scene) -> str:
    """A hash of what was learned: networks but those of paintings, box and palette. Edits do not change it."""
    learned = scene.base if scene.palette is None else scene.palette  # a scene's edits and paintings share it
    if learned not in _scenes:
        header, arrays = scene.to_arrays()
        own = {k: header[k] for k in LEARNED}
        colours = [[r.colour, r.ranges] for r in scene.regions]
        tables = {k: _array(v) for k, v in arrays.items() if k.split(".")[0] in ("base", "pcn", "occupied")}
        _scenes[learned] = digest(own, colours, tables)
    return _scenes[learned]


def digest_of_edits(scene: Scene) -> str:
    """A hash of a scene's edits and paintings: of all that :func:`digest_of_scene` leaves out, but its history."""
    header, arrays = scene.to_arrays()
    paintings = {k: _array(v) for k, v in arrays.items() if k.split(".")[0] not in ("base", "pcn", "occupied")}
    return digest({k: header[k] for k in ("regions", "lamp", "painting", "variants")}, paintings)


def _array(values: NDArray[Any]) -> list[object]:
    return [str(values.dtype), values.shape, _hex(np.ascontiguousarray(values).data)]


def _hex(content: bytes | memoryview) -> str:
    return hashlib.blake2b(content, digest_size=10).hexdigest()
