"""View sets: their JSON files, their metadata, the classified volume, cameras and lenses."""

from __future__ import annotations

import io
import json
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from PIL import Image

from campaign.mutate import NUMBERS, TEXTS, archive, json_like, npy_header, some_bytes
from campaign.running import Parser
from svv.core.geometry.box import Box
from svv.core.geometry.cameras import CameraRig
from svv.core.volumes.classified import ClassifiedVolume, ValueGrid, ValueRange
from svv.io.views.camera_file import read_camera
from svv.io.views.lenses import rectify
from svv.io.views.transforms import LENGTHS, OTHERS, camera_in, file_in, mask_files, names_of, read_transforms
from svv.io.views.view_meta import ViewMeta, VolumeGrid
from svv.io.views.viewset import CLASSIFIED, ViewSet, read_classified


def pose(distance: float) -> list[list[float]]:
    """Return a camera that looks at the origin from a distance."""
    matrix = np.eye(4)
    matrix[2, 3] = distance
    return matrix.tolist()


META = {
    "volume": "v", "bounds": [[0, 0, 0], [1, 1, 1]], "tf_rescaled": False, "mapper": "cpu", "seconds": 1.5,
    "sample_distance": 0.1, "tf": {"RGBPoints": [0, 0, 0, 0, 1, 1, 1, 1]}, "vtk": "9", "own": {"a": [1, {"b": 2}]},
    "grid": VolumeGrid((2, 2, 2), (1, 1, 1), (0, 0, 0), ((1, 0, 0), (0, 1, 0), (0, 0, 1)), "u1", (0, 1)).to_json(),
    "rig": CameraRig((0.0, 0.0, 0.0), 3.0, 0.5, (8, 8)).to_json(), "shading": None,
}  # fmt: skip
FRAMES = [{"file_path": f"./train/{k}", "transform_matrix": pose(3.0 + k)} for k in range(3)]
SETS: tuple[dict[str, Any], ...] = (
    {"camera_angle_x": 0.6, "w": 8, "h": 8, "svv": META, "frames": FRAMES},
    {
        "fl_x": 9.0, "fl_y": 9.1, "cx": 4.0, "cy": 4.1, "w": 8, "h": 8, "k1": 0.01, "k2": 0.0, "p1": 1e-3, "p2": 0.0,
        "camera_model": "OPENCV", "frames": [{**f, "mask_path": f["file_path"]} for f in FRAMES],
        "train_filenames": ["./train/0", "./train/1", "./train/2"], "test_filenames": [],
    },
    {"camera_model": "ORTHOPHOTO", "span_x": 2.0, "fl_x": 4.0, "frames": FRAMES, "svv_classified": CLASSIFIED},
    {"camera_model": "OPENCV_FISHEYE", "fl_x": 5.0, "w": 8, "h": 8, "k3": 0.1, "k4": 0.1, "frames": FRAMES[:1] * 3},
)  # fmt: skip
CAMERAS = (
    {"camera_to_world": pose(3.0), "fov": 30.0, "width": 8, "height": 8},
    {"camera_to_world": pose(3.0), "span_x": 2.0},
    {"transform_matrix": pose(3.0), "camera_angle_x": 0.5},
    SETS[0],
    SETS[1],
)


def with_paths(seeds: tuple[dict[str, Any], ...]) -> Any:
    """Return a generator of sets in which paths leave the folder, besides everything else."""
    plain = json_like(*seeds)

    def make(random: Random) -> bytes:
        if random.random() < 0.9:
            return plain(random)
        tree = json.loads(json.dumps(random.choice(seeds)))
        random.choice(tree["frames"])[random.choice(("file_path", "mask_path"))] = random.choice(TEXTS)
        return json.dumps(tree).encode()

    return make


def prepared(folder: Path) -> Path:
    """Write the images of a set of three views, and links of all kinds beside them."""
    (folder / "train").mkdir(parents=True, exist_ok=True)
    image = np.zeros((8, 8, 4), np.uint8)
    image[2:6, 2:6] = (200, 100, 50, 255)
    for k in range(3):
        Image.fromarray(image).save(folder / "train" / f"{k}.png")
    for name, target in (("loop", "loop"), ("away", "/etc"), ("zero.png", "/dev/zero"), ("folder.png", "train")):
        if not (folder / name).is_symlink():
            (folder / name).symlink_to(target)
    return folder


def transforms(folder: Path) -> Parser:
    """The JSON file alone, with the cameras of its frames: fast, so that it gets most inputs."""
    prepared(folder)

    def read(content: bytes) -> None:
        (folder / "transforms.json").write_bytes(content)
        path, scene, frames = read_transforms(folder, "train")
        ViewMeta.from_json(scene.get("svv"), "svv")
        for frame in frames[:8]:
            file_in(path, frame)
            camera_in(path, scene, frame, 8, 8)
        mask_files(path, frames)
        names_of(frames)

    return Parser("transforms.json", read, with_paths(SETS))


def sets(folder: Path) -> Parser:
    """Whole sets, with images and undistortion; written over, because that removes the files of the old set."""
    prepared(folder)
    (folder / CLASSIFIED).write_bytes(npz()[0])
    beside = folder.parent / f"{folder.name}-precious.png"
    beside.write_bytes(b"precious")
    plain = with_paths(SETS)

    def make(random: Random) -> bytes:
        if random.random() < 0.95:
            return plain(random)
        tree = json.loads(json.dumps(SETS[0]))
        tree["frames"][0]["file_path"] = random.choice(
            (str(beside.with_suffix("")), f"../{beside.stem}", f"train/../../{beside.stem}", "away/passwd")
        )
        return json.dumps(tree).encode()

    def read(content: bytes) -> None:
        (folder / "transforms_train.json").write_bytes(content)
        try:
            ViewSet.read(folder)
        finally:
            if content[-2:-1] == b"]":  # about half
                from svv.io.views.viewset import _own_files

                if any(folder.resolve() not in file.resolve().parents for file in _own_files(path)):
                    raise AssertionError("a file outside of the folder would be removed")

    path = folder / "transforms_train.json"
    return Parser("view sets", read, make)


def meta(folder: Path) -> Parser:
    """Metadata of views that svv made."""
    from svv.core.json_values import parsed

    def read(content: bytes) -> None:
        try:
            found = parsed(content.decode())
        except ValueError:
            return  # a set that is not JSON has no metadata: see transforms.json
        ViewMeta.from_json(found).to_json()

    return Parser("view metadata", read, json_like(META))


def cameras(folder: Path) -> Parser:
    """Camera files in both forms."""
    path = folder / "camera.json"

    def read(content: bytes) -> None:
        path.write_bytes(content)
        read_camera(path)

    return Parser("camera files", read, json_like(*CAMERAS), rims)


def rims(content: bytes) -> int:
    """Return what undistortion takes: 33 points from the middle to each pixel on the rim of an image, in 64 bits."""
    from svv.core.json_values import parsed

    try:
        told: Any = parsed(content)
        sides = [float(each[key]) for each in (told, *told.get("frames", [])) for key in "wh" if key in each]
    except (ValueError, TypeError, KeyError, AttributeError):
        sides = []
    return 40 * len(content) + 33 * 8 * 4 * 12 * min(1 << 16, int(max((s for s in sides if s < 1e9), default=0)))


def lenses(folder: Path) -> Parser:
    """Intrinsics of any values: the camera, and the image resampled."""
    keys = (*LENGTHS, *OTHERS)
    image = np.full((8, 8, 4), 255, np.uint8)

    def make(random: Random) -> bytes:
        frame: dict[str, Any] = {"fl_x": random.uniform(1, 20), "w": 8, "h": 8, "transform_matrix": pose(2.0)}
        for key in random.sample(keys, random.randrange(1, 5)):
            frame[key] = random.choice((random.uniform(-1, 1), random.uniform(-100, 100), random.choice(NUMBERS)))
        frame["camera_model"] = random.choice(("OPENCV", "OPENCV_FISHEYE", "PINHOLE", "ORTHOPHOTO"))
        return json.dumps(frame).encode()

    def read(content: bytes) -> None:
        from svv.core.json_values import parsed

        try:
            frame: Any = parsed(content.decode())
        except ValueError:
            return  # see transforms.json
        _, lens = camera_in(folder, {}, frame, 8, 8)
        if lens is not None:
            rectify(image, lens)

    return Parser("lenses", read, make)


def npz() -> list[bytes]:
    """Return classified volumes, with and without values."""
    box, cells = Box((0.0, 0.0, 0.0), 1.0, (1.0, 0.5, 1.0)), 4
    shape = (5, 3, 5)
    exponent, owner = np.full(shape, -3.0, np.float16), np.zeros(shape, np.uint8)
    ranges = (ValueRange(0.0, 1.0, (0.1, 0.2, 0.3)),)
    grid = ValueGrid(4, np.ones(shape, np.uint16), (0.0, 1.0), (0.1, 0.9), np.linspace(0, 1, 8))
    found = []
    from svv.io.views.viewset import _write_classified

    for values in (None, grid):
        file = io.BytesIO()
        _write_classified(file, ClassifiedVolume(box, cells, exponent, owner, ranges, values))  # type: ignore[arg-type]
        found.append(file.getvalue())
    return found


PICKLE = b"cos\nsystem\n(S'touch /dev/shm/svv-campaign-pickle-ran'\ntR."
HEADERS = (
    "{'descr': '|O', 'fortran_order': False, 'shape': (1,), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (100000000,), }",
    "{'descr': '<f2', 'fortran_order': True, 'shape': (-1, 3), }",
    "{'descr': [('a', '<f8', (1000000,))], 'fortran_order': False, 'shape': (1,), }",
    "{'descr': '<U100000000', 'fortran_order': False, 'shape': (0,), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (2**40,), }",
    "(" * 300,
    "__import__('os')",
)


def classified(folder: Path) -> Parser:
    """Classified volumes: archives whose arrays are pickles, lie about their shapes, or inflate to much more."""
    import zipfile

    members = []
    for content in npz():
        with zipfile.ZipFile(io.BytesIO(content)) as opened:
            members.append([(name, opened.read(name)) for name in opened.namelist()])
    path = folder / CLASSIFIED
    (folder / "transforms_train.json").write_text(json.dumps(SETS[2]))
    big = npy_header("{'descr': '|u1', 'fortran_order': False, 'shape': (67108864,), }", bytes(1 << 26))

    def make(random: Random) -> bytes:
        chosen = list(random.choice(members))
        number, kind = random.randrange(len(chosen)), random.random()
        name, content = chosen[number]
        if kind < 0.3:
            content = npy_header(random.choice(HEADERS), PICKLE)
        elif kind < 0.301:
            content = big
        elif kind < 0.5:
            content = some_bytes(content, random)
        elif kind < 0.8:
            content = _array(content, random)
        chosen[number] = name, content
        return archive(chosen, random)

    def read(content: bytes) -> None:
        path.write_bytes(content)
        read_classified(folder)
        if Path("/dev/shm/svv-campaign-pickle-ran").exists():
            raise AssertionError("a pickle ran")

    return Parser("classified volumes", read, make, listed)


def listed(content: bytes) -> int:
    """Return twice what the directory of an archive says about its members: they are compared with limits, too."""
    import zipfile

    try:
        with zipfile.ZipFile(io.BytesIO(content)) as opened:
            return 8 * len(content) + 2 * min(sum(m.file_size for m in opened.infolist()), 1032 * len(content))
    except Exception:  # what is no archive declares nothing
        return 8 * len(content)


def _array(content: bytes, random: Random) -> bytes:
    """Return an array with another number in it, or of another shape or type."""
    array = np.load(io.BytesIO(content))
    if random.random() < 0.5 and array.size:
        flat = array.ravel().copy()
        with np.errstate(all="ignore"):
            number = random.choice((0, 1, -1, 2, 3, 255, 1e9, 65504, np.nan, np.inf, 1e-8))
            flat[random.randrange(flat.size)] = np.float64(number).astype(flat.dtype)
        array = flat.reshape(array.shape)
    else:
        array = random.choice(
            (array[None], array.ravel(), array[..., :1] if array.ndim else array, array.astype(np.float32),
             array.astype("U3"), array.astype(complex), array * 0, np.zeros(0), np.zeros((1, 1, 1, 1)))
        )  # fmt: skip
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


ALL = {
    "transforms": transforms, "viewsets": sets, "meta": meta, "cameras": cameras, "lenses": lenses,
    "classified": classified,
}  # fmt: skip
