"""Files ``transforms.json``: NeRF-synthetic sets, nerfstudio, instant-ngp, COLMAP's converters, and our own.

They differ in which intrinsics they give, for all frames or for each (a frame's own take precedence):

- ``camera_angle_x`` and ``camera_angle_y`` in radians, or ``fl_x``, ``fl_y``, ``cx``, ``cy`` in pixels of an image of
  ``w`` x ``h``, which may have been reduced since;
- ``k1`` ... ``k4``, ``p1``, ``p2``: lens distortion;
- ``camera_model``: a pinhole with distortion, OPENCV_FISHEYE (in instant-ngp ``is_fisheye``), or ORTHOPHOTO, whose
  ``fl_x`` is in pixels per world unit. We also write ``span_x``, the width of the image in world units.

Matrices are OpenGL camera-to-world. If the file has ``applied_transform`` (nerfstudio), they contain it already: the
world is the one after that transform, and so is the scene that is learned.
"""

from __future__ import annotations

import math
import posixpath
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from svv.core.geometry.cameras import MOST_PIXELS, Camera
from svv.core.json_values import parsed
from svv.errors import BadInput
from svv.io.files.atomic import is_file
from svv.io.views.lenses import Lens

SUFFIXES = ("", *(case for suffix in (".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff", ".bmp")
                  for case in (suffix, suffix.upper())))  # fmt: skip
"""Suffixes that ``file_path`` may lack; NeRF-synthetic sets omit ``.png``."""

LENGTHS = ("fl_x", "fl_y", "camera_angle_x", "camera_angle_y", "span_x")
"""Keys of which at least one is needed; those of a frame replace all of the file's."""
OTHERS = ("w", "h", "cx", "cy", "k1", "k2", "k3", "k4", "p1", "p2")
"""Keys of other intrinsics; each of a frame replaces the same one of the file."""

PARALLEL = ("ORTHOPHOTO", "ORTHOGRAPHIC")
"""Values of ``camera_model`` for orthographic cameras; the first is nerfstudio's, which we write."""
MODELS = ("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "PERSPECTIVE", "OPENCV_FISHEYE", *PARALLEL)
"""Values of ``camera_model`` that can be read."""

MOST_MISSING = 0.5
"""Fraction of the listed pictures that may be missing."""

Frame = Mapping[str, Any]


class _Missing(BadInput):
    """A picture is not there."""


def transforms_file(folder: str | Path, split: str) -> Path | None:
    """Return the file that lists the views of a split, or None.

    It is ``transforms_<split>.json``, or ``transforms.json``, whose frames are all for training unless it has lists
    ``train_filenames``, ``val_filenames`` and ``test_filenames`` (nerfstudio). Instead of the folder, a file of it may
    be given: it lists the training views, whatever its name, and the other splits are beside it.
    """
    if Path(folder).suffix.lower() == ".json" and Path(folder).is_file():
        if split == "train" or Path(folder).name == f"transforms_{split}.json":
            return Path(folder) if _lists_frames(Path(folder)) else None
        folder = Path(folder).parent
    own, whole = Path(folder) / f"transforms_{split}.json", Path(folder) / "transforms.json"
    if own.exists() or not whole.exists():
        return own if own.exists() else None
    if split == "train":
        return whole
    try:
        listed = parsed(whole.read_bytes()).get(f"{split}_filenames")
    except (OSError, ValueError, AttributeError):
        return None  # reading the training views says what is wrong with it
    return whole if listed else None


def _lists_frames(path: Path) -> bool:
    """Return whether a JSON file lists frames; one that cannot be read does, so that reading it says what is wrong."""
    try:
        content = parsed(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return path.name.startswith("transforms")
    return isinstance(content, dict) and "frames" in content


def split_of(file: Path) -> str:
    """Return the split that a file ``transforms_<split>.json`` holds; that of ``transforms.json`` is ``train``."""
    return "train" if file.stem == "transforms" else file.stem.removeprefix("transforms_")


def read_transforms(folder: str | Path, split: str) -> tuple[Path, dict[str, object], list[dict[str, object]]]:
    """Return a split's file, its content, and the split's frames; raises BadInput if the file or these are missing."""
    place = Path(folder)
    beside = place.parent if place.is_file() else place
    path = transforms_file(place, split) or beside / f"transforms_{split}.json"
    try:
        scene = parsed(path.read_bytes())
    except FileNotFoundError:
        raise BadInput(
            f"There is no {path}; a folder of views needs one, or a transforms.json (NeRF-synthetic layout)."
        ) from None
    except OSError as error:
        raise BadInput(f"Cannot read {path}: {error.strerror or error}.") from error
    except ValueError as error:
        raise BadInput(f"{path} is not valid JSON ({error}); write the views again.") from error
    frames = scene.get("frames") if isinstance(scene, dict) else None
    if not isinstance(frames, list) or not all(isinstance(frame, dict) for frame in frames):
        raise BadInput(f"{path} has no list of frames; it must follow the NeRF-synthetic layout.")
    if path.name == "transforms.json":
        frames = _of_split(path, scene, frames, split)
    if not frames:
        raise BadInput(f"{path} has no views.")
    return path, scene, frames


def _of_split(path: Path, scene: Frame, frames: list[dict[str, object]], split: str) -> list[dict[str, object]]:
    lists: dict[str, list[str]] = {}
    for name in ("train", "val", "test"):
        listed = scene.get(f"{name}_filenames")
        if listed is not None and not (isinstance(listed, list) and all(isinstance(n, str) for n in listed)):
            raise BadInput(f"{path}: {name}_filenames must be a list of file names.")
        if listed is not None:
            lists[name] = listed
    wanted = lists.get(split)
    if wanted is not None:
        return [frame for frame in frames if frame.get("file_path") in wanted]
    others = {name for listed in lists.values() for name in listed}
    return [frame for frame in frames if str(frame.get("file_path")) not in others]


def present(path: Path, frames: Sequence[dict[str, object]]) -> tuple[list[dict[str, object]], str | None]:
    """Return the frames whose pictures are there, and a sentence on the others, if any.

    Raises BadInput if most pictures are missing, a frame names none or one outside the folder, or two name the same.
    """
    found, missing, first = [], [], None
    seen: dict[Path, str] = {}
    for number, frame in enumerate(frames, start=1):
        name = str(frame.get("file_path"))
        try:
            file = file_in(path, frame)
        except _Missing as error:
            missing.append(name)
            first = first or error
            continue
        if file in seen:
            raise BadInput(
                f"{path} names the picture {name} twice, the second time in frame {number}: give each frame its own "
                "picture, or delete one of the two frames."
            )
        seen[file] = name
        found.append(frame)
    if first is not None and len(missing) > MOST_MISSING * len(frames):
        if len(missing) == 1:
            raise first
        raise BadInput(
            f"{len(missing)} of the {len(frames)} pictures that {path} lists are missing, the first is {missing[0]}: "
            "copy the pictures beside the file, or correct its paths."
        )
    if not missing:
        return found, None
    some = ", ".join(missing[:3]) + (", ..." if len(missing) > 3 else "")
    return found, f"{len(missing)} of the {len(frames)} listed pictures could not be found and are left out: {some}."


def file_in(path: Path, frame: Frame, key: str = "file_path") -> Path:
    """Return the file that a frame names; raises BadInput if it names none or there is none."""
    name = frame.get(key)
    if not isinstance(name, str) or not name:
        raise BadInput(f"{path} has a frame without {key}.")
    for plain in dict.fromkeys((name, name.replace("\\", "/"))):  # converters on Windows write backslashes
        if leaves(plain):
            raise BadInput(
                f"{path} names the image {name}, which is outside its folder: copy the images into the folder, and "
                "name them from there."
            )
        for suffix in SUFFIXES:
            file = path.parent / (plain + suffix)
            if is_file(file):
                return file
    raise _Missing(f"{path} names the image {name}, but there is no such file (with or without .png).")


def leaves(name: str) -> bool:
    """Return whether the name of a file leads out of the folder that it is relative to, by ``..`` or from a root.

    Links are followed wherever they lead: whoever unpacks a set decides about them.
    """
    plain = name.replace("\\", "/")
    return plain.startswith(("/", "~")) or plain[1:2] == ":" or posixpath.normpath(plain).split("/")[0] == ".."


def mask_files(path: Path, frames: Sequence[Frame]) -> list[Path] | None:
    """Return the masks that frames name by ``mask_path``, if any do.

    Raises BadInput if others do not, or one is missing.
    """
    if not any("mask_path" in frame for frame in frames):
        return None
    return [file_in(path, frame, "mask_path") for frame in frames]


def names_of(frames: Sequence[Frame]) -> tuple[str, ...]:
    """Return the file stems, or the whole paths with _ for / if frames in different folders share a stem."""
    paths = [str(frame["file_path"]).removeprefix("./").replace("\\", "/") for frame in frames]
    bare = [p[: p.rfind(".")] if p.lower().endswith(SUFFIXES[1:]) else p for p in paths]
    stems = [p.rsplit("/", 1)[-1] for p in bare]
    if len(set(stems)) == len(stems):
        return tuple(stems)
    return tuple(p.replace("/", "_") for p in bare)


def camera_in(path: Path, scene: Frame, frame: Frame, width: int, height: int) -> tuple[Camera, Lens | None]:
    """Return the camera of a frame, and the lens of its image if that is not the camera's own and must be rectified.

    The image has a size in pixels; ``scene`` is the whole content of the file. Raises BadInput if something is missing
    or out of range, or the camera model is not supported.
    """
    where = f"{path}, frame {frame.get('file_path')}"
    try:
        matrix = np.array(frame.get("transform_matrix"), dtype=np.float64)
        if matrix.shape == (3, 4):
            matrix = np.vstack([matrix, (0.0, 0.0, 0.0, 1.0)])
        own = frame if any(key in frame for key in LENGTHS) else scene
        given = {key: own[key] for key in LENGTHS if key in own}
        given |= {key: value for key, value in {**scene, **frame}.items() if key in OTHERS}
        numbers = {key: float(value) for key, value in given.items()}
        if not any(key in numbers for key in LENGTHS):
            raise TypeError
    except (TypeError, ValueError, OverflowError):
        raise BadInput(
            f"{where}: camera_angle_x must be a number of radians (or fl_x one of pixels), the other intrinsics "
            "numbers, and transform_matrix a 4x4 matrix of numbers."
        ) from None
    try:
        model = str(frame.get("camera_model", scene.get("camera_model", "OPENCV"))).upper()
        if model not in MODELS:
            raise BadInput(
                f"camera_model {model} is not supported, only {', '.join(MODELS)}; undistort the images first."
            )
        fisheye = model == "OPENCV_FISHEYE" or bool(frame.get("is_fisheye", scene.get("is_fisheye", False)))
        lens = _lens(numbers, width, height, fisheye)
        centre = lens.centre if "cx" in numbers or "cy" in numbers else None
        if model in PARALLEL:
            return Camera.orthographic(matrix, _span(numbers, width), width, height, centre), None
        if set(numbers).isdisjoint(LENGTHS[:-1]):
            raise BadInput("span_x needs camera_model ORTHOPHOTO; a perspective camera needs camera_angle_x or fl_x.")
        if lens.is_pinhole:
            by_angle = "fl_x" not in numbers and "camera_angle_x" in numbers
            fov = numbers["camera_angle_x"] if by_angle else _angle(width, lens.focal[0])
            return Camera(matrix, fov, width, height, None, centre), None
        return Camera(matrix, _angle(width, lens.rectified), width, height, None, centre), lens
    except BadInput as error:
        raise BadInput(f"{where}: {error}") from None
    except (ZeroDivisionError, OverflowError):
        raise BadInput(f"{where}: an angle or a focal length is too small or too large.") from None


def intrinsics_of(camera: Camera) -> dict[str, object]:
    """Return a camera's keys in a file: angle, or model and width; other programs take an angle or a focal length."""
    if camera.span_x is None:
        return {"camera_angle_x": camera.fov_x}
    focal = camera.focal
    return {"camera_model": PARALLEL[0], "span_x": camera.span_x, "fl_x": focal, "fl_y": focal}


def _span(numbers: Mapping[str, float], width: int) -> float:
    """Return the width of an orthographic image in world units."""
    if "span_x" in numbers:
        return numbers["span_x"]
    if "fl_x" not in numbers or not numbers["fl_x"] > 0:
        raise BadInput("an orthographic camera needs span_x, the width of its image in world units, or fl_x > 0.")
    return numbers.get("w", width) / numbers["fl_x"]


def _angle(width: int, focal: float) -> float:
    return 2.0 * math.atan(0.5 * width / focal)


def _lens(numbers: Mapping[str, float], width: int, height: int, fisheye: bool) -> Lens:
    """Return the intrinsics of an image of the given size, which may be smaller than the file says."""
    for key in ("w", "h"):
        if not 1 <= numbers.get(key, 1) <= MOST_PIXELS:
            raise BadInput(f"{key} must be a number of pixels from 1 to {MOST_PIXELS}, not {numbers[key]:g}.")
    for key, size in (("width", width), ("height", height)):
        if not 1 <= size <= MOST_PIXELS:
            raise BadInput(f"an image can be 1 to {MOST_PIXELS} pixels in {key}, not {size}.")
    for key in ("camera_angle_x", "camera_angle_y"):
        value = numbers.get(key, 1)
        if not 0 < value < math.pi:
            meant = f": if these are degrees, write {math.radians(value):.6g}" if math.pi < value < 180 else ""
            raise BadInput(f"{key} must lie between 0 and pi radians, not {value:g}{meant}.")
    across, down = width / numbers.get("w", width), height / numbers.get("h", height)
    if abs(across / down - 1.0) > 0.02 and any(key in numbers for key in ("fl_x", "cx", "cy")):
        turned = (numbers.get("w"), numbers.get("h")) == (height, width)
        raise BadInput(
            f"the image has {width} x {height} pixels, but w and h say {numbers.get('w', width):g} x "
            f"{numbers.get('h', height):g}"
            + ": it is stored turned by 90 degrees, perhaps with an EXIF orientation; turn its pixels" * turned + "."
        )  # fmt: skip
    if "fl_x" in numbers:
        focal = across * numbers["fl_x"]
    elif "camera_angle_x" in numbers:
        focal = 0.5 * width / math.tan(0.5 * numbers["camera_angle_x"])
    elif "camera_angle_y" in numbers:
        focal = 0.5 * height / math.tan(0.5 * numbers["camera_angle_y"])
    else:
        focal = down * numbers["fl_y"] if "fl_y" in numbers else 1.0  # of no use if span_x takes its place
    other = focal
    if "fl_y" in numbers and "fl_x" in numbers:
        other = down * numbers["fl_y"]
    elif "camera_angle_y" in numbers and "fl_x" not in numbers:
        other = 0.5 * height / math.tan(0.5 * numbers["camera_angle_y"])
    column = across * numbers["cx"] if "cx" in numbers else 0.5 * width
    row = down * numbers["cy"] if "cy" in numbers else 0.5 * height
    k1, k2, k3, k4, p1, p2 = (numbers.get(key, 0.0) for key in ("k1", "k2", "k3", "k4", "p1", "p2"))
    return Lens(width, height, (focal, other), (column, row), (k1, k2, k3, k4), (p1, p2), fisheye)
