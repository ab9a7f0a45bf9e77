"""StyleRF Place In View in the real ParaView: images of scenes in the 3D view, before and behind other things."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from svv.core.geometry.cameras import Camera
from tests.paraview.test_volume import VIEW, read

OURS = """
from svv.fields.scene.scene import Scene
from svv.pv.scripts import camera_of_view
scene = Scene.load(folder + "/cube.svv")
def ours(name, view):
    camera = camera_of_view(view, *view.ViewSize)
    drawn = scene.render(camera)
    np.savez(folder + f"/{name}.npz", rgba=drawn.rgba, depth=drawn.depth, matrix=camera.camera_to_world,
             fov=camera.fov_x, span=camera.span_x or 0.0)
def placed(view):
    view.UseFXAA = 0
    image = StyleRFRender(Input=OpenDataFile(folder + "/cube.svv"))
    picture = StyleRFPlaceInView(Input=image)
    return image, picture, Show(picture, view)
"""


def over_white(rgba: np.ndarray) -> np.ndarray:
    return rgba[..., :3] * rgba[..., 3:] + 1.0 - rgba[..., 3:]


def to_ball(camera: Camera, centre: tuple[float, float, float], radius: float) -> np.ndarray:
    """Distance of a ball along the ray of each pixel, infinite beside it. (H, W)"""
    origin, direction = camera.rays()
    along = ((np.array(centre) - origin) * direction).sum(2)
    half = radius**2 - (np.square(np.array(centre) - origin).sum(2) - along**2)
    return np.where(half > 0, along - np.sqrt(np.maximum(half, 0.0)), np.inf)


def camera_in(file: Path) -> Camera:
    found = np.load(file)
    return Camera(found["matrix"], float(found["fov"]), 160, 120, float(found["span"]) or None)


BALLS = {"front": (0.4, 0.3, 0.9), "behind": (-0.5, -0.3, -1.2), "through": (0.1, 0.1, 0.15)}
RADIUS = 0.3


def test_what_is_nearer_hides_what_is_farther(inside, tmp_path: Path) -> None:
    said = inside(
        VIEW
        + OURS
        + f"""
view = small_view()
image, picture, display = placed(view)
said["status"] = status(picture)
said["display"] = [str(display.Representation).strip("'"), display.MapScalars, list(display.ColorArrayName)]
def draw(name):
    Render(view)
    SaveScreenshot(folder + f"/{{name}}.png", view, ImageResolution=view.ViewSize)
draw("alone")
ours("ours", view)
said["follows"] = [image.FollowCamera, list(image.ImageSize), len(GetRenderViews())]
ball = Sphere(Radius={RADIUS}, ThetaResolution=200, PhiResolution=200)
ball_display = Show(ball, view)
ball_display.AmbientColor = ball_display.DiffuseColor = [0.0, 0.0, 0.0]
ball_display.Ambient, ball_display.Diffuse = 1.0, 0.0
for name, centre in {BALLS!r}.items():
    ball.Center = centre
    draw(name)
picture.Opaque = 1
draw("opaque")
"""
    )
    assert said["status"].endswith("points.") and said["display"] == ["Surface", 0, ["POINTS", "RGBA"]]
    assert said["follows"] == [1, [160, 120], 1]
    found, camera = np.load(tmp_path / "ours.npz"), camera_in(tmp_path / "ours.npz")
    rgba, depth = found["rgba"], np.nan_to_num(found["depth"], nan=np.inf)
    alone = read(tmp_path / "alone.png")
    assert -10 * np.log10(np.mean((alone - over_white(rgba)) ** 2)) > 45.0
    for name, centre in BALLS.items():
        ball = to_ball(camera, centre, RADIUS)
        there = np.isfinite(ball)
        hidden = np.where(there[..., None], rgba[..., :3] * rgba[..., 3:], over_white(rgba))  # a black ball behind it
        meant = np.where((ball < depth)[..., None], 0.0, hidden)
        wrong = np.abs(read(tmp_path / f"{name}.png") - meant).max(axis=2) > 0.05
        assert wrong.mean() < 0.01 and there.mean() > 0.02, name  # pixels at the ball's edge
    through = to_ball(camera, BALLS["through"], RADIUS)
    cut = np.isfinite(through)
    assert 0.1 < (through < depth)[cut].mean() < 0.9, "the ball does not poke through"
    kept = np.rint(255 * rgba[..., 3:]) >= 128
    farther = np.where(kept, rgba[..., :3], np.where(cut[..., None], 0.0, 1.0))
    meant = np.where((through < depth)[..., None], 0.0, farther)
    assert (np.abs(read(tmp_path / "opaque.png") - meant).max(axis=2) > 0.05).mean() < 0.02


@pytest.mark.slow
def test_the_picture_is_that_of_the_camera_whoever_moves_it(inside, tmp_path: Path) -> None:
    said = inside(
        VIEW
        + OURS
        + """
def draw(name, view):
    SaveScreenshot(folder + f"/{name}.png", view, ImageResolution=view.ViewSize)
view = small_view()
image, picture, _ = placed(view)
Render(view)
view.GetActiveCamera().Azimuth(40)
view.SMProxy.InteractiveRender()
said["small"] = [list(image.ImageSize), list(image.Camera[:3]) == list(view.GetActiveCamera().GetPosition())]
view.CameraPosition = [-1.5, 0.9, 2.0]
draw("script", view)
ours("script", view)
view.CameraParallelProjection, view.CameraParallelScale = 1, 0.8
draw("parallel", view)
ours("parallel", view)
view.CameraParallelProjection = 0
image.FollowCamera = 0
before = list(image.Camera)
view.CameraPosition = [1.0, 2.0, 1.0]
Render(view)
said["still"] = list(image.Camera) == before
image.FollowCamera = 1
Render(view)
said["again"] = list(image.Camera[:3])
# A second scene in a view beside it, whose camera is linked to the first one's.
beside = small_view()
second, _, _ = placed(beside)
Render(beside)
AddCameraLink(view, beside, "together")
view.CameraPosition = [2.0, -1.0, 1.5]
Render(view)
Render(beside)
said["linked"] = [list(image.Camera) == list(second.Camera), list(second.Camera[:3])]
draw("linked", beside)
ours("linked", view)
# A state shows the same, and goes on following.
SaveState(folder + "/state.pvsm")
ResetSession()
LoadState(folder + "/state.pvsm")
views = GetRenderViews()
for view in views:
    view.ViewSize = [160, 120]
    Render(view)
said["views"] = len(views)
view = views[0]
view.CameraPosition = [1.2, 0.9, 2.4]
draw("restored", view)
ours("restored", view)
said["not an image"] = status(StyleRFPlaceInView(Input=Wavelet()))
"""
    )
    assert said["small"] == [[64, 48], True]
    assert said["still"] and said["again"] == [1.0, 2.0, 1.0] and said["linked"] == [True, [2.0, -1.0, 1.5]]
    assert said["views"] == 2 and "not an image of a scene" in said["not an image"]
    for name in ("script", "parallel", "linked", "restored"):
        rgba = np.load(tmp_path / f"{name}.npz")["rgba"]
        seen = np.asarray(Image.open(tmp_path / f"{name}.png").convert("RGB")) / 255.0
        assert -10 * np.log10(np.mean((seen - over_white(rgba)) ** 2)) > 45.0, name
