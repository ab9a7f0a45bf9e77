"""Writes a scene as one HTML file, which a browser draws without a server, a network or further files.

It has the files in ``viewer``, the scene's settings as JSON, its fields (:mod:`svv.render.web.fields`) as compressed
text, and a picture and a small movie for browsers that cannot draw it. Each function of a joined scene is a layer.
"""

from __future__ import annotations

import base64
import io
import re
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image

from svv._version import __version__
from svv.core.colour.colour import WHITE, over
from svv.core.colour.colour_vision import MATRICES
from svv.core.colour.light import COEFFICIENTS, NORMAL_SOFTNESS, RIM_COSINE, UPPER_LEFT
from svv.core.colour.matcaps import BEHIND, INSET
from svv.core.colour.oklab import FROM_CONES, FROM_LAB, TO_CONES, TO_LAB
from svv.core.geometry.cameras import Camera, CameraRig
from svv.core.geometry.cuts import Cut
from svv.core.images import edges, outlines
from svv.core.interval_text import interval_text
from svv.errors import BadInput, Progress, part, silent
from svv.fields.radiance.phong import EXTINCTION_POWER
from svv.fields.scene import sections, shadows
from svv.fields.scene.joined import members
from svv.fields.scene.matcap_pictures import picture_of
from svv.fields.scene.matter import FINEST, resolution_of
from svv.fields.scene.model import in_words
from svv.fields.scene.scene import Scene
from svv.fields.scene.sections import (
    DEEP,
    HATCH_INK,
    HATCH_SOFTNESS,
    HATCH_WIDTH,
    HATCHES,
    flat_colours,
    is_sectioned,
)
from svv.fields.scene.shadow_kernels import EVEN
from svv.fields.scene.stroke_opacity import strokes_of
from svv.io.files.atomic import atomic_path, check_writable, to_json
from svv.io.files.temporary import work_folder
from svv.io.pictures.output import to_bytes, write_mp4
from svv.io.pictures.picture_data import as_text
from svv.options.pages import PageOptions
from svv.render.web.doubts import doubt_of
from svv.render.web.fields import Field, fields_of
from svv.render.web.html import filled, viewer_file
from svv.render.web.values import interval_of, values_of

SCRIPTS = (
    "decode.js", "reduce.js", "colours.js", "state.js", "cuts.js", "camera.js", "textures.js", "draw.js", "doubt.js",
    "shadows.js", "lines.js", "values.js", "show.js", "panel.js", "film.js", "hands.js", "main.js",
)  # fmt: skip
"""The viewer's program, in order."""

SHADERS = ("march", "doubted")
"""Programs for the graphics, which the viewer's has as constants of these names."""

COMPRESSION = 7
"""Of zlib: 9 takes five times as long for 3 % less."""

MOST_ADDED = 0.2
"""Part of a page's size up to which the volume's values are always in it."""

MATCAP_SIDE = 96
"""Side in pixels of the MatCaps of a page."""

LINES = {
    edges: (
        "VIEW", "CHANGE_DEVIATION", "SMOOTHING_DEVIATION", "LEAST_DEVIATION", "SAMPLING_VARIANCE", "DEPTH_JUMP",
        "DEPTH_JUMP_PIXELS", "WEAK_CHANGE", "STRONG_CHANGE", "FOLD_BOUNDS", "FOLD_DEVIATION", "FOLD_BOX",
        "BAND_DEVIATION", "OPAQUE_ALPHAS", "EVENING_DEVIATION", "WHOLE_BOUNDS", "STRIDE", "TURN_COSINES",
        "PARTED_REACH",
    ),
    outlines: ("WIDEST", "CREASE_WIDTH", "PRESSURE_SHARE", "LEAST_COVERAGE"),
    sections: ("BESIDE", "LEAST_SHARE", "FULL_SHARE", "DIPS"),
}  # fmt: skip
"""Constants of ink that a page draws as the renderer does (``lines.js``)."""

FRONT_SIZE, FRONT_QUALITY = 720, 88
"""Side in pixels and JPEG quality of the picture from the front."""

MOST_CUT = 31
"""Most regions of a scene with cuts of some of them: a page holds these as bits of a number."""

MOST_PLANES = 6
"""Most planes of a cut on a page, as many as a box has (``cuts.js``)."""

MOVIE_FRAMES, MOVIE_FPS, MOVIE_SIZE, MOVIE_CRF = 30, 7.5, 240, 30
"""Frames, frames per second, side in pixels and rate factor of the orbit for browsers that cannot draw the scene."""

CLOSER_SIZE, LEAST_SHOWN, MARGIN = 64, 0.05, 1.1
"""Side in pixels of the views that tell how large the scene appears, the alpha that counts, and the margin around."""


def to_nobody(sentence: str) -> None:
    """Tell nobody."""


def write_html(
    path: Path, scene: Scene, title: str, background: Sequence[float] = WHITE, progress: Progress = silent,
    options: PageOptions = PageOptions(), tell: Callable[[str], None] = to_nobody,
) -> int:  # fmt: skip
    """Write a scene as one HTML file that shows it from all sides and edits it.

    Args:
        path: The file.
        scene: Scene to show, with its edits and paintings.
        title: Heading of the page.
        background: RGB in [0, 1] behind the scene; can be changed in the page.
        progress: Called while the scene is prepared.
        options: What else the page holds.
        tell: Called with how large the volume's values are, if the scene keeps them, and whether the page has them.

    Returns:
        The size of the file in bytes.

    Raises:
        BadInput: The scene has no palette network or no cameras, or the file cannot be written.

    >>> from pathlib import Path
    >>> svv.write_html(Path("balls.html"), scene, "Two balls") > 10_000
    True
    """
    check_writable(path)
    page = html_of(scene, title, path.stem, background, progress, options, tell)
    with atomic_path(path) as temporary:
        temporary.write_bytes(page)
    return len(page)


def html_of(
    scene: Scene, title: str, name: str, background: Sequence[float] = WHITE, progress: Progress = silent,
    options: PageOptions = PageOptions(), tell: Callable[[str], None] = to_nobody,
) -> bytes:  # fmt: skip
    """Return the page that :func:`write_html` writes, in UTF-8; pictures that it saves are called ``name``.

    Raises BadInput if the scene has no palette network, occlusion that no page can show, or too many regions for its
    cuts.
    """
    if scene.palette_network is None:
        raise BadInput("The scene has no regions because it holds no palette network; train it again.")
    _check_shade(scene)
    _check_cuts(scene)
    scene = scene.on(torch.device("cpu"))
    rig = _closer(replace(scene, cuts=()))
    stills = _stills(scene, rig, background, part(progress, 0.0, 0.3))
    layers, packed = _layers(scene, part(progress, 0.3, 0.9))
    progress(0.9, "compressing")
    doubt, grids = doubt_of(scene)
    header = _header(scene, rig) | {"layers": layers, "doubt": doubt, "file": name, "background": list(background)}
    packed += grids
    arrays = base64.b64encode(zlib.compress(b"".join(array.tobytes() for array in packed), COMPRESSION)).decode()
    told, content = values_of(scene)
    values, words = base64.b64encode(content).decode(), in_words(scene)
    header["values"] = [None] * len(told)
    header["units"] = {"length": options.unit or "", "value": options.value_unit or ""}
    page = _page(header, arrays, stills, title, words)
    if values:
        size, kept = f"{len(values) / 1e6:.2g} MB", options.values or len(values) <= MOST_ADDED * len(page)
        tell(f"the volume's values are {size} of it" if kept else f"the volume's values would add {size} (--values)")
        page = _page(header | {"values": told}, arrays, stills, title, words, values) if kept else page
    progress(1.0, "")
    return page


def _check_shade(scene: Scene) -> None:
    """Raise BadInput if a page, whose colours hold occlusion, would look otherwise than the scene."""
    painted = "styled" in scene.networks  # opacity follows strokes only where there are some
    for number, region in enumerate(scene.regions):
        follows = painted and region.stroke_opacity != 0.0
        if region.occlusion == 0.0 or (region.matcap is None and not follows):
            continue
        what, take = (
            ("opacity that follows its strokes", f"--region {number} --stroke-opacity 0")
            if follows
            else ("a MatCap", f"--matcap {number}=none")
        )
        raise BadInput(
            f"Region {number} has ambient occlusion and {what}, and no page can show both: take one of them off, with "
            f"svv edit --region {number} --occlusion 0 or svv edit {take}."
        )


def _check_cuts(scene: Scene) -> None:
    """Raise BadInput if a page has no room for the cuts."""
    if any(len(cut.planes) > MOST_PLANES for cut in scene.cuts):
        raise BadInput(
            f"A page shows cuts of at most {MOST_PLANES} planes: take the others away (svv edit --uncut), or write "
            "pictures or a movie of the scene."
        )
    if len(scene.regions) > MOST_CUT and (any(cut.regions for cut in scene.cuts) or is_sectioned(scene)):
        raise BadInput(
            f"A page shows cuts of some regions and sections in scenes of at most {MOST_CUT} regions, not "
            f"{len(scene.regions)}: take the cuts away (svv edit --uncut), or write pictures or a movie of the scene."
        )


def _cuts(scene: Scene) -> list[dict[str, object]]:
    """Return the scene's cuts, with the regions that they open as bits in the order of the page."""
    order = numbers_of(scene)
    regions = [scene.regions[number] for number in order]

    def bits(cut: Cut) -> int:
        own = [number in cut.regions or r.part_of in cut.regions for number, r in zip(order, regions, strict=True)]
        return sum(1 << k for k, opened in enumerate(own) if opened)

    return [
        vars(cut) | {"radius": cut.radius or 0.0, "regions": bits(cut), "text": cut.to_text()} for cut in scene.cuts
    ]


def _page(
    header: dict[str, Any], arrays: str, stills: dict[str, str], title: str, words: str, values: str = ""
) -> bytes:
    def read(name: str) -> str:
        return re.sub(r"^ *//.*\n", "", viewer_file(name), flags=re.MULTILINE)  # comments are for the sources

    shaders = [f"const {name.upper()} = {_script_json(read(f'{name}.glsl'))};" for name in SHADERS]
    return filled(
        read("page.html"), title=title, words=words, text=_describe_contents(header), style=read("style.css"),
        version=__version__, header=_script_json(header), arrays=arrays, values=values, **stills,
        script="\n".join([*shaders, *(read(name) for name in SCRIPTS)]),
    ).encode()  # fmt: skip


def _script_json(data: object) -> str:
    """Return JSON that may stand inside a script element: no name in it can end the element or open another."""
    return to_json(data).replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def _describe_contents(header: dict[str, Any]) -> str:
    regions, paintings = len(header["regions"]), len(header["paintings"])
    text = f"{regions} region{'s' * (regions != 1)}"
    if len(header["layers"]) > 1:
        text += f" of {len(header['layers'])} transfer functions"
    return text + (f", {paintings} painting{'s' * (paintings != 1)}" if paintings else "")


def _closer(scene: Scene) -> CameraRig:
    """Return the scene's camera rig with an angle of view that it fills, however it is turned."""
    rig, reach, small = scene.rig, 0.0, scene.while_moving()
    for camera in rig.sphere(12, CLOSER_SIZE):
        row, column = np.nonzero(small.render(camera).rgba[..., 3] > LEAST_SHOWN)
        away = np.hypot(row + 0.5 - CLOSER_SIZE / 2, column + 0.5 - CLOSER_SIZE / 2)
        reach = max(reach, float(away.max(initial=0.0)) / (CLOSER_SIZE / 2))
    part = min(max(MARGIN * reach, 0.1), 1.0) if reach else 1.0
    fov = 2.0 * np.arctan(part * np.tan(rig.fov_x / 2.0))
    return replace(rig, fov_x=float(fov), span_x=None if rig.span_x is None else part * rig.span_x)


def _header(scene: Scene, rig: CameraRig) -> dict[str, object]:
    """Return everything but the layers, as plain values."""
    bounds = np.array([member.occupancy.box.bounds for member in members(scene)])
    room = rig.radius - 0.5 * float(np.linalg.norm(bounds[:, 1].max(axis=0) - bounds[:, 0].min(axis=0)))
    names, matcaps = paintings_of(scene), [None, *_names_of_matcaps(scene)]
    shown = names[:1] if scene.layers else [name for name in names if name == scene.variant]
    return {
        "camera": {
            "centre": rig.centre,
            "radius": rig.radius,
            "fov": rig.fov_x,
            "span": rig.span_x,
            # up to which the camera comes closer: it keeps a tenth of the room between it and the boxes
            "nearest": rig.radius / max(rig.radius - 0.9 * room, 0.1 * rig.radius),
        },
        "normal_softness": NORMAL_SOFTNESS,
        "rim_cosine": RIM_COSINE,
        "lamp": vars(scene.lamp),
        "shadows": _shadows(scene),
        "matcaps": _matcaps(scene),
        "visions": MATRICES,
        "bounds": scene.bounds.tolist(),
        "cuts": _cuts(scene),
        "hatches": {
            "count": HATCHES,
            "width": HATCH_WIDTH,
            "softness": HATCH_SOFTNESS,
            "ink": HATCH_INK,
            "deep": DEEP,
        },
        "lines": {name: getattr(module, name) for module, names in LINES.items() for name in names},
        "regions": [
            {**told, "number": number, "matcap": matcaps.index(scene.regions[number].matcap)}  # from 1, 0 for none
            for told, number in zip(
                (told for member in members(scene) for told in _regions(member)), numbers_of(scene), strict=True
            )
        ],
        "painting": names.index(shown[0]) if shown else None,
        "paintings": [_painting(scene if scene.layers else scene.with_variant(name), name) for name in names],
    }


def _layers(scene: Scene, progress: Progress) -> tuple[list[dict[str, object]], list[NDArray[np.uint8]]]:
    """Return what is told of each layer, as plain values, and the arrays of all, one after the other.

    Arrays are a layer's occupied cells, as bits, and its codes, as differences between a channel's neighbours.
    """
    every, told, packed, first = members(scene), [], [], 0
    for number, member in enumerate(every):
        own = part(progress, number / len(every), (number + 1) / len(every))
        # All are looked at from where the views of the whole stand.
        fields, light = fields_of(replace(member, camera_rig=scene.rig), own)
        told.append(_layer(member, first, fields) | {"light": light})
        packed.append(np.packbits(member.occupancy.occupied > 0))
        packed += [np.diff(channel, prepend=np.uint8(0)) for field in fields for channel in field.codes]
        first += len(member.regions)
    return told, packed


def _layer(scene: Scene, first: int, fields: Sequence[Field]) -> dict[str, object]:
    """Return what is told of a layer whose first region has the number ``first`` in the whole."""
    occupancy, how = scene.occupancy, scene.marching_for_images
    box = occupancy.box
    return {
        "box": {"low": box.low, "size": box.size, "extent": box.extent},
        "cells": occupancy.cells,
        "shape": occupancy.occupied.shape,
        "step": how.step,
        "joined": how.least_weight,
        "stop": how.stop,
        "lighting": scene.settings.lighting,
        "headlight": scene.settings.headlight,
        "first": first,
        "count": len(scene.regions),
        "fields": [{k: v for k, v in vars(field).items() if k != "codes"} for field in fields],
    }


def _regions(scene: Scene) -> list[dict[str, object]]:
    reflects = scene.coefficients()
    told: list[dict[str, object]] = []
    for number, r in enumerate(scene.regions):
        values = f"{r.share:.0%}" if r.values is None else interval_text(*r.values)
        told.append({
            "name": r.name, "colour": r.colour, "edited": r.edited_colour, "opacity": r.opacity,
            "hidden": r.hidden, "values": values, "lighting": r.lighting, "strength": r.strength,
            "interval": interval_of(r.values),
            "mean_light": r.mean_light, "section": r.section, "oklab": OKLAB if r.recolour_in == "oklab" else None,
            "outline": r.outline, "outline_width": r.outline_width, "outline_colour": r.outline_colour,
            "section_line": r.section_line,
            "reflects": [0.0] * len(COEFFICIENTS) if reflects is None else reflects[number].tolist(),
        })  # fmt: skip
    return told


def _shadows(scene: Scene) -> dict[str, object] | None:
    """Return how a page computes cast shadows; None if the scene can have none."""
    every = members(scene)
    if any(member.base.density is None for member in every):
        return None
    return {
        "resolutions": [resolution_of(member) for member in every],
        "near": shadows.NEAR,
        "far": shadows.FAR,
        "clear_depth": shadows.CLEAR_DEPTH,
        "least_clear": shadows.LEAST_CLEAR,
        "deep": shadows.DEEP,
        "even": EVEN,
        "around": shadows.AROUND,
        "directions": shadows.DIRECTIONS,
        "finest": FINEST,
        "upper_left": UPPER_LEFT,
    }


OKLAB = {"to_cones": TO_CONES, "to_lab": TO_LAB, "from_lab": FROM_LAB, "from_cones": FROM_CONES}
"""Matrices with which a page recolours a region in Oklab."""


def _matcaps(scene: Scene) -> dict[str, object]:
    """Return the pictures of the regions' MatCaps, as the texels of a texture, and how they are looked up."""
    names = _names_of_matcaps(scene)
    pictures = [
        np.asarray(Image.fromarray(to_bytes(picture_of(name).numpy())).resize((MATCAP_SIDE,) * 2).convert("RGBA"))
        for name in names
    ]
    texels = base64.b64encode(b"".join(picture.tobytes() for picture in pictures)).decode()
    how = {"behind": BEHIND, "inset": INSET, "power": EXTINCTION_POWER}
    return {"count": len(names), "side": MATCAP_SIDE, "texels": texels, **how}


def _names_of_matcaps(scene: Scene) -> list[str]:
    return list(dict.fromkeys(region.matcap for region in scene.regions if region.matcap is not None))


def numbers_of(scene: Scene) -> list[int]:
    """Return the numbers of a scene's regions in the order of a page, which lists those of one function together."""
    return sorted(range(len(scene.regions)), key=lambda number: scene.regions[number].layer)


def paintings_of(scene: Scene) -> list[str]:
    """Return the names of the paintings that a page offers; those of a joined scene's members are one."""
    if not scene.layers:
        return list(scene.variants)
    names = dict.fromkeys(member.variant for member in members(scene) if member.variant is not None)
    return [" + ".join(names)] if names else []


def _painting(scene: Scene, name: str) -> dict[str, object]:
    """Return the name, the regions' styles and the effects of the painting that a scene shows."""
    regions = [scene.regions[number] for number in numbers_of(scene)]
    return {
        "name": name,
        "styles": [r.style for r in regions],
        "paint_light": [r.paint_light for r in regions],
        "strokes": _strokes(scene),
        "flat": _flat(scene) if is_sectioned(scene) else [None] * len(regions),
    }


def _flat(scene: Scene) -> list[list[float]]:
    """Return the colour of each region's paint in sections."""
    rows: list[list[float]] = []
    for member in members(scene):
        whole = replace(member, regions=tuple(replace(r, strength=1.0) for r in member.regions))
        rows += flat_colours(whole, "styled").tolist()
    return rows


def _strokes(scene: Scene) -> list[list[float]]:
    """Return how each region's extinction depends on its strokes: g, k, y, b."""
    rows: list[list[float]] = []
    for member in members(scene):
        own = strokes_of(member)
        rows += [[0.0] * 4] * len(member.regions) if own is None else own.tolist()
    return rows


def _stills(scene: Scene, rig: CameraRig, background: Sequence[float], progress: Progress) -> dict[str, str]:
    """Return a picture from the ``front`` and a ``movie`` of the orbit, as data URIs.

    Paint in the movie is that of the page, on a lattice: strokes by themselves would take most of the page's time.
    """
    buffer, moving = io.BytesIO(), scene.while_moving()
    (first,) = rig.orbit(181, FRONT_SIZE, frames=[90])
    orbit = rig.orbit(MOVIE_FRAMES, MOVIE_SIZE)

    def seen(shown: Scene, camera: Camera) -> NDArray[np.uint8]:
        return to_bytes(over(shown.render(camera).rgba, background))

    def frames() -> Iterator[NDArray[np.uint8]]:
        for number, camera in enumerate(orbit):
            progress(number / len(orbit), "orbit")
            yield seen(moving, camera)

    Image.fromarray(seen(scene, first)).save(buffer, format="JPEG", quality=FRONT_QUALITY)
    with work_folder() as folder:
        path = folder / "orbit.mp4"
        write_mp4(path, frames(), MOVIE_FPS, MOVIE_CRF)
        movie = path.read_bytes()
    return {"front": as_text(buffer.getvalue()), "movie": f"data:video/mp4;base64,{base64.b64encode(movie).decode()}"}
