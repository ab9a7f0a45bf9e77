"""Regions corrected by clicks into views, in the panel of StyleRF Palette."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from svv.core.geometry.cameras import sphere_cameras
from svv.io.pictures.output import to_bytes
from svv.io.views.viewset import ViewSet
from tests.loose_balls import loose_balls

SHOWN = """
config.PRESETS["draft"] = replace(draft, recolour=replace(draft.recolour, iterations=200, rays=512))
from svv.pv.display.linked_camera import fit, show_image
palette = StyleRFPalette(Input=OpenDataFile(folder + "/balls.svv"), Preset="draft",
                         ViewsFile=folder + "/views/transforms_train.json")
image = StyleRFRender(Input=palette, ImageSize=[60, 60], Camera=[0, 0, 3, 0, 0, 0, 0, 1, 0, 23])
flat = CreateView("RenderView")
flat.ViewSize = [120, 120]
show_image(image, flat)
Render(flat)
fit(flat, 60, 60)
LEFT, RIGHT, CORNER = (34, 60), (84, 60), (3, 3)

def click(at, view=flat):
    hand = view.GetInteractor()
    hand.SetEventInformation(*at)
    hand.InvokeEvent("LeftButtonPressEvent")
    hand.InvokeEvent("LeftButtonReleaseEvent")
    palette.UpdatePropertyInformation()
    return palette.Status

def sides():
    region = arrays(image)["Region"][..., 0]
    return [int(np.bincount(half[half >= 0]).argmax()) for half in (region[:, :30], region[:, 30:])]

"""


@pytest.fixture(autouse=True)
def _balls(tmp_path: Path) -> None:
    """Write two grey balls, one region beside another that shows nowhere, and views of them."""
    balls = loose_balls()
    balls.save(tmp_path / "balls.svv")
    cameras = sphere_cameras(12, (0.0, 0.0, 0.0), 3.0, 0.4, 48)
    images = np.stack([to_bytes(balls.render(camera).rgba) for camera in cameras])
    ViewSet(tuple(cameras), images, tuple(f"r_{k}" for k in range(12))).write(tmp_path / "views", "train")


def test_clicks_say_of_which_region_a_place_is(inside: Callable) -> None:
    """A click makes the left one of two balls of one region another region."""
    said = inside(
        SHOWN
        + """
said["before"] = [status(palette), sides()]
said["off"] = [click(LEFT), palette.Points]
palette.PointRegion = 1
palette.ClickRegion()
said["nothing"] = [click(CORNER), palette.Points]
said["left"] = [click(LEFT), palette.Points, sides()]
palette.PointRegion = 0
said["contradicts"] = [click(LEFT), palette.Points]
palette.PointRegion = 3
said["no region"] = [click(RIGHT), palette.Points]
palette.UndoPalette()
said["undone"] = [palette.PointRegion, palette.Points, sides()]
palette.RedoPalette()
said["redone"] = [palette.Points, sides()]
palette.Points = ""
palette.ClickRegion()  # off
palette.ClickSame()
said["first"] = [click(LEFT), palette.Points]
said["one already"] = [click(RIGHT), palette.Points]
said["first again"] = [click(LEFT), palette.Points]
palette.ClickSame()
palette.ClickSame()
said["forgotten"] = click(RIGHT)
# The panel's row counts as it shows it, before it is applied.
palette.ClickRegion()
palette.GetProperty("PointRegion").SMProperty.SetUncheckedElement(0, 2)
said["new"] = [click(LEFT), palette.Points, column(palette, "Region"), sides()]
plain = StyleRFRender(Input=palette.Input, ImageSize=[60, 60], Camera=[0, 0, -3, 0, 0, 0, 0, 1, 0, 23])
Hide(image, flat)
show_image(plain, flat)
palette.GetProperty("PointRegion").SMProperty.SetUncheckedElement(0, 1)
said["from behind"] = [click(LEFT), palette.Points]
"""
    )
    whole, other = said["before"]
    assert "palette is unchanged" in whole and other == [0, 0]
    assert said["off"][1] == ""
    assert "Nothing is visible at the pixel" in said["nothing"][0] and said["nothing"][1] == ""
    told, points, shown = said["left"]
    assert "of region 0 is now region 1" in told and float(points.split(",")[0]) < -0.2 and points.endswith("=1")
    assert shown == [1, 0]
    assert "contradict each other" in said["contradicts"][0] and said["contradicts"][1] == points
    assert "There is no region 3" in said["no region"][0] and said["no region"][1] == points
    assert said["undone"] == [3, "", [0, 0]] and said["redone"] == [points, [1, 0]]
    assert "now click on another place of the same region" in said["first"][0] and said["first"][1] == ""
    assert "Both places are region 0 already" in said["one already"][0] and said["one already"][1] == ""
    assert "now click on another place" in said["first again"][0] and "now click on another" in said["forgotten"]
    told, points, rows, shown = said["new"]
    assert points.endswith("=2") and (rows, shown) == ([0, 1, 2], [2, 0]), told
    both = said["from behind"][1].split("; ")
    assert len(both) == 2 and float(both[1].split(",")[0]) > 0.2 and both[1].endswith("=1"), both


def test_clicks_hit_what_the_picture_shows(inside: Callable) -> None:
    """A filter behind the palette hides the nearer ball: in each picture of its scene, clicks meet the farther one."""
    said = inside(
        SHOWN
        + """
RIGHT_BALL, CAMERA = "0.28,0,0", [3, 0, 0, 0, 0, 0, 0, 1, 0, 23]
edit = StyleRFEdit(Input=palette, Parts=RIGHT_BALL)
edit.GetProperty("Region2Hide").SetData(1)
Hide(image, flat)
palette.ClickRegion()

def solid(source):
    view = CreateView("RenderView")
    view.ViewSize = [120, 120]
    Show(source, view)
    view.CameraPosition, view.CameraFocalPoint, view.CameraViewUp = CAMERA[:3], CAMERA[3:6], CAMERA[6:9]
    view.CameraViewAngle = CAMERA[9]
    palette.ClickRegion(); palette.ClickRegion()  # its clicks are heard in this view, too
    Render(view)
    return view

def met(view, name):
    palette.Points = ""
    said[name] = [click((60, 60), view), palette.Points]

whole = StyleRFRender(Input=palette, ImageSize=[60, 60], Camera=CAMERA)
shown = StyleRFRender(Input=edit, ImageSize=[60, 60], Camera=CAMERA)
for picture, name in ((whole, "whole"), (shown, "hidden")):
    show_image(picture, flat)
    fit(flat, 60, 60)
    Render(flat)
    met(flat, name)
    Hide(picture, flat)
edit.Region2Hide, edit.Region2Opacity = 0, 0.01
show_image(shown, flat)
Render(flat)
met(flat, "faint")
edit.Region0Hide = edit.Region2Hide = 1
Render(flat)
met(flat, "nothing")
edit.Region0Hide, edit.Region2Opacity = 0, 1.0
met(solid(StyleRFPlaceInView(Input=StyleRFRender(Input=edit))), "placed")
baked = StyleRFVolume(Input=edit)
view = solid(baked)
met(view, "volume")
baked.Cut = 1
met(view, "cut")
palette.Points = ""
for source in GetSources().values():  # a script that ends with a filter behind one that failed has failed
    source.UpdatePipeline()
"""
    )
    assert float(said["whole"][1].split(",")[0]) > 0.1, said["whole"]
    for name in ("hidden", "faint", "placed", "volume"):
        assert float(said[name][1].split(",")[0]) < -0.1, (name, said[name])
    assert "Nothing is visible at the pixel" in said["nothing"][0] and said["nothing"][1] == ""
    assert "turn Cut off" in said["cut"][0] and said["cut"][1] == ""
