"""Compare a part that a click splits off with the same piece cut out of the volume itself.

usage: parts.py VOLUME TF.json SCENE.svv COLUMN,ROW [LEVEL [FRAME]]

The pixel is one of a picture of 800 x 800 of a frame of the orbit (90); the level is that of the split. The piece in
the volume is found by the same rule among its voxels, whose values are then set to the smallest one, and 8 views of the
rest are drawn.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import distance_transform_cdt

from svv.core.colour.colour import over
from svv.core.geometry.cameras import Camera
from svv.core.geometry.components import large, least_opacity, nearest_piece, pieces
from svv.core.images.metrics import psnr
from svv.dvr.draw.views import make_views
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.grids import as_volume, from_array, index_to_world, to_array
from svv.dvr.read.volumes import read_volume
from svv.fields.scene.scene import Scene
from svv.io.pictures.output import to_bytes
from svv.io.views.viewset import ViewSet
from svv.options.editing import SPLIT_LEVEL
from svv.render.frames import orbit

VIEWS, SIZE = 8, 400


def main() -> None:
    file, function, path, pixel = sys.argv[1:5]
    column, row = map(float, pixel.split(","))
    scene = Scene.load(path)
    level = float(sys.argv[5]) if len(sys.argv) > 5 else SPLIT_LEVEL
    camera = orbit(scene, 181, 800, 800)[int(sys.argv[6]) if len(sys.argv) > 6 else 90]
    point = scene.point_at(camera, (column, row))
    began = time.process_time()
    parts = scene.split_at(point, level)
    seconds, number = time.process_time() - began, len(parts.regions) - 1
    region = parts.regions[number].part_of
    assert region is not None
    volume, table = as_volume(read_volume(file)), TransferFunction.read(function)
    values, to_world = to_array(volume).T, index_to_world(volume)  # (nx, ny, nz)
    own = np.any([(values > low) & (values < high) for low, high in scene.regions[region].ranges], axis=0)
    opacity = np.where(own, table.opacity_at(values), 0.0).astype(np.float32)
    piece = piece_of(own, opacity, (np.linalg.inv(to_world) @ [*point, 1.0])[:3], level)
    print(f"{file}: region {number} is {parts.regions[number].share / scene.regions[region].share:.0%} of {region}")
    print(f"split: {seconds:.2f} CPU s, file {Path(path).stat().st_size} -> {size_of(parts)} bytes")
    print(
        f"voxels, by opacity, on the right side: {agreement(parts, number, region, own, opacity, piece, to_world):.2%}"
    )
    pictures = []
    for name, shown, cut in (
        ("whole", scene, values),
        ("rest", parts.hidden(number), np.where(piece, values.min(), values)),
    ):
        image = from_array(cut.T, volume.GetSpacing(), volume.GetOrigin())
        image.SetDirectionMatrix(volume.GetDirectionMatrix())
        test = make_views(image, table, n=3, test=VIEWS, size=SIZE, mapper="cpu")[1]
        assert test is not None
        print(f"{name}: {np.mean([psnr(*pair) for pair in pairs(shown, test)]):.2f} dB over white")
        pictures.append(list(pairs(shown, test))[VIEWS // 2])
    panels = [*(to_bytes(p) for pair in pictures for p in pair)]
    Image.fromarray(np.concatenate(panels, axis=1)).save("parts.png")
    print(f"a picture costs {cost(parts, camera) / cost(scene, camera):.3f} times as much with the part")


def piece_of(
    own: NDArray[np.bool_], opacity: NDArray[np.float32], place: NDArray[np.float64], level: float
) -> NDArray[np.bool_]:
    """Return the region's voxels that are nearer to the piece at a place than to others."""
    labels, sizes = pieces(own & (opacity >= least_opacity(opacity[own], level)))
    asked, _ = nearest_piece(labels, place + 0.5)
    others = large(sizes, asked)
    others[asked] = False
    far = [distance_transform_cdt(~chosen, "chessboard") for chosen in (labels == asked, others[labels])]
    return np.asarray(own & (far[0] < far[1]))


def agreement(
    parts: Scene, number: int, region: int, own: NDArray[np.bool_], opacity: NDArray[np.float32],
    piece: NDArray[np.bool_], to_world: NDArray[np.float64],
) -> float:  # fmt: skip
    """Return the fraction of the region's voxels, by opacity, that are on the same side of the split in both."""
    where = np.argwhere(own)
    place = parts.occupancy.box.to_box(where @ to_world[:3, :3].T + to_world[:3, 3])
    here = parts.regions_at(torch.from_numpy(place.clip(0.0).astype(np.float32)))
    assert here is not None
    same = (here[:, region].numpy() == number) == piece[own]
    return float((opacity[own] * same).sum() / opacity[own].sum())


def pairs(scene: Scene, views: ViewSet) -> list[tuple[NDArray[np.float32], NDArray[np.float32]]]:
    """Return our picture and the volume's of each view, over white, in [0, 1]."""
    shown: Sequence[Camera] = views.cameras
    truth = views.images.astype(np.float32) / 255.0
    return [(over(scene.render(c).rgba).astype(np.float32), over(t)) for c, t in zip(shown, truth, strict=True)]


def size_of(scene: Scene) -> int:
    path = Path("parts.svv")
    scene.save(path)
    return path.stat().st_size


def cost(scene: Scene, camera: Camera) -> float:
    """Return the least CPU time of a picture, of five."""
    spent = []
    for _ in range(5):
        began = time.process_time()
        scene.render(camera)
        spent.append(time.process_time() - began)
    return min(spent)


if __name__ == "__main__":
    main()
