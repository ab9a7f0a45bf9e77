"""The pictures of "Show several variables": a storm of three variables in one scene, and three members side by side.

``python -m docs.variables`` in the checkout writes ``docs/images/variables.jpg`` and ``docs/images/members.jpg``.
Trained and painted scenes are kept in ``build/variables``, so that it can be stopped and repeated: about ten minutes of
CPU time.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import gaussian_filter
from vtkmodules.vtkCommonDataModel import vtkImageData

from docs.sheets import IMAGES, WHITE, halved, labelled
from svv.core.geometry.cameras import Camera
from svv.dvr.draw.views import make_views
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.grids import from_array
from svv.fields.scene.joined import joined
from svv.fields.scene.scene import Scene
from svv.options.making import PaintOptions
from svv.styles.gallery import gallery_picture
from svv.train.paint.ink import StyleInput
from svv.train.pipeline import stylize_scene, train_scene

KEPT = IMAGES.parents[1] / "build" / "variables"

Array = NDArray[np.float64]

SHOWN = {
    "cloud": (0.34, 0.22, 0.4, (0.75, 0.8, 0.88), "watercolour"),
    "updraft": (0.6, 0.7, 0.95, (0.9, 0.35, 0.15), "impasto"),
    "rain": (0.6, 0.7, 0.6, (0.15, 0.4, 0.75), "pastel"),
}
"""Variable -> centre and width of its visible values, opacity, colour, and the gallery's picture that paints it."""

SHEAR = 0.35
"""How far the wind carries the storm's top, relative to its height."""

MIDDLE = -0.08
"""Height of the pictures' middle."""

LARGE, SMALL = 900, 300
"""Width and height of the picture of all variables, and of those beside it."""


def storm(voxels: int = 80, shear: float = SHEAR, seed: int = 4) -> dict[str, vtkImageData]:
    """Return three variables of a generated thunderstorm in the cube [-1, 1]^3, each in [0, 1]; y is up.

    A cloud whose anvil the wind shears away, an updraft that winds up inside of it, and shafts of rain below.
    """
    axis = np.linspace(-1.0, 1.0, voxels)
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    billows = gaussian_filter(np.random.default_rng(seed).standard_normal((voxels,) * 3), 0.04 * voxels)
    billows /= billows.std()
    lean = shear * (y + 0.2)
    u = x - lean
    # Half width of the tower, which spreads into an anvil under the tropopause.
    tower = 0.30 + 0.06 * np.cos(9.0 * y) + 0.42 * np.exp(-(((y - 0.62) / 0.13) ** 2))
    along = np.where(u > 0.0, u / (1.0 + 1.1 * np.exp(-(((y - 0.62) / 0.15) ** 2))), u)
    cloud = (tower + 0.085 * billows - np.hypot(along, z)) / 0.16
    cloud = np.minimum(cloud, np.minimum((y + 0.22) / 0.1, (0.82 - y) / 0.1))
    updraft = np.zeros_like(x)
    for turn in (0.0, np.pi):
        angle = 5.2 * (y + 0.7) + turn
        reach = 0.16 + 0.05 * y
        away = np.hypot(u - reach * np.cos(angle), z - reach * np.sin(angle))
        updraft = np.maximum(updraft, (0.085 - away) / 0.07 + 0.5)
    updraft = np.minimum(updraft, np.minimum((y + 0.85) / 0.1, (0.66 - y) / 0.1))
    rain = np.zeros_like(x)
    place = np.random.default_rng(seed + 1)
    for _ in range(34):
        r, a = 0.5 * np.sqrt(place.random()) + 0.08, 2.0 * np.pi * place.random()
        foot = place.uniform(-0.95, -0.8)
        middle = r * np.cos(a) - 0.25 + 0.28 * (y + 0.3), r * np.sin(a)
        away = np.hypot(x - middle[0], z - middle[1])
        shaft = np.minimum((0.036 - away) / 0.05 + 0.5, np.minimum((y - foot) / 0.06, (-0.24 - y) / 0.06))
        rain = np.maximum(rain, shaft)
    spacing = 2.0 / (voxels - 1)
    return {
        name: from_array(np.clip(0.5 * values + 0.25, 0.0, 1.0).astype(np.float32), (spacing,) * 3, (-1.0,) * 3, name)
        for name, values in (("cloud", cloud), ("updraft", updraft), ("rain", rain))
    }


def layer(name: str, kept: str, volume: vtkImageData) -> Scene:
    """Return the painted scene of one variable, made unless it is there."""
    centre, width, opacity, colour, style = SHOWN[name]
    path = KEPT / f"{kept}.svv"
    if not path.exists():
        plain = path.with_suffix(".plain.svv")
        if not plain.exists():
            bump = {"centre": centre, "width": width, "opacity": opacity, "colour": colour}
            views, _ = make_views(volume, TransferFunction.from_bumps([bump]), n=36, test=0, size=240, mapper="cpu")
            train_scene(views, "draft", encoding="values")[0].save(plain)
        picture = StyleInput(gallery_picture(style), style)
        stylize_scene(Scene.load(plain), [picture], PaintOptions(preset="draft", manner="strokes"))[0].save(path)
    scene = Scene.load(path)
    return replace(scene, regions=tuple(replace(r, name=name) for r in scene.regions))


def camera_of(scene: Scene, size: int, turn: int = 100) -> Camera:
    """Return the camera from which all pictures are taken."""
    seen = scene.rig.orbit(181, size)[turn]
    pose = seen.camera_to_world.copy()
    pose[1, 3] += MIDDLE - scene.occupancy.box.to_world(0.5 * np.asarray([scene.occupancy.box.extent]))[0, 1]
    return Camera(pose, 0.7 * seen.fov_x, size, size)


def drawn(scene: Scene, camera: Camera) -> Array:
    """Render a scene over white, twice as large, and halve it. (height, width, 3)"""
    large = camera.resized(2 * camera.width, 2 * camera.height)
    return halved(np.asarray(scene.render(large, None, WHITE).rgba[..., :3], np.float64))


def write(name: str, page: Array) -> None:
    """Write a picture to the documentation's images."""
    pixels = Image.fromarray(np.rint(255 * np.clip(page, 0.0, 1.0)).astype(np.uint8))
    pixels.save(IMAGES / name, quality=90, subsampling=0, optimize=True, progressive=True)


def variables() -> None:
    """All three variables together, and each alone."""
    volumes = storm()
    whole = joined([layer(name, name, volumes[name]) for name in SHOWN])
    camera = camera_of(whole, LARGE)
    of = [[k for k, r in enumerate(whole.regions) if r.layer == number] for number in range(len(SHOWN))]
    alone = [drawn(whole.isolated(*numbers), camera.resized(SMALL, SMALL)) for numbers in of]
    write("variables.jpg", np.concatenate([drawn(whole, camera), np.concatenate(alone)], axis=1))


def members() -> None:
    """Cloud and updraft of three members, which differ in their wind shear, in one look and from one camera."""
    pictures, shears = [], (0.0, 0.35, 0.7)
    camera: Camera | None = None
    for number, shear in enumerate(shears):
        volumes, kept = storm(shear=shear), "" if shear == SHEAR else f"member{number}-"
        whole = joined([layer(name, kept + name, volumes[name]) for name in ("cloud", "updraft")])
        camera = camera or camera_of(whole, 400)
        pictures.append(drawn(whole, camera))
    labels = labelled([f"wind shear {shear:g}" for shear in shears], 400)
    write("members.jpg", np.concatenate([labels, np.concatenate(pictures, axis=1)]))


if __name__ == "__main__":
    KEPT.mkdir(parents=True, exist_ok=True)
    variables()
    members()
