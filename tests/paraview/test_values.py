"""Values read off an image of a scene: clicks into it say them in the panel, and an array has them for Find Data."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.solid_ball import solid_ball
from tests.test_probing import front, keeping, linear

SHOWN = """
from svv.pv.display.linked_camera import fit, show_image
ball = OpenDataFile(folder + "/ball.svv")
image = StyleRFRender(Input=ball, ImageSize=[60, 60], Camera=[0, 0, 3, 0, 0, 0, 0, 1, 0, 23])
flat = CreateView("RenderView")
flat.ViewSize = [120, 120]
show_image(image, flat)
Render(flat)
fit(flat, 60, 60)
MIDDLE, RIGHT, CORNER = (60, 60), (74, 60), (3, 3)

def click(at, view=flat):
    hand = view.GetInteractor()
    hand.SetEventInformation(*at)
    hand.InvokeEvent("LeftButtonPressEvent")
    hand.InvokeEvent("LeftButtonReleaseEvent")
    image.UpdatePropertyInformation()
    return image.Status

"""


def test_clicks_say_the_value_and_the_array_has_it(inside: Callable, tmp_path: Path) -> None:
    scene = keeping(solid_ball(), linear)
    scene.save(tmp_path / "ball.svv")
    said = inside(
        SHOWN
        + """
said["off"] = click(MIDDLE)
said["arrays"] = sorted(arrays(image))
image.ClickValue()
said["middle"], said["right"] = click(MIDDLE), click(RIGHT)
said["corner"] = click(CORNER)
said["third"] = click((60, 74))
image.ClickValue()
said["stopped"] = click(RIGHT)
image.WithValues = 1
found = arrays(image)["Value"][..., 0]
said["value"] = [float(found[29, 30]), bool(np.isnan(found[0, 0])), found.shape]
said["status"] = status(image)
"""
    )
    assert said["off"] == "60 x 60 pixels." and said["arrays"] == ["Depth", "RGBA", "Region"]
    assert said["middle"].startswith("30,29: Region 0 (100 % of the pixel) at ") and " of ball.vti" in said["middle"]
    assert "distance" not in said["middle"] and "; distance " in said["right"]
    assert said["corner"] == "Nothing is visible there."
    assert "; distances " in said["third"] and "angle" in said["third"]
    assert said["stopped"] == said["third"]
    told = float(said["middle"].partition("from the camera), ")[2].split()[0])
    value, empty, shape = said["value"]
    assert abs(value - told) < 12.0 and empty and shape == [60, 60]
    assert said["status"] == "60 x 60 pixels."
    own = scene.probe(front(scene, 60), (30, 29))
    assert own is not None and np.isfinite(value)


def test_without_values_the_panel_says_how_to_keep_them(inside: Callable, tmp_path: Path) -> None:
    solid_ball().save(tmp_path / "ball.svv")
    said = inside(
        SHOWN
        + """
image.ClickValue()
said["click"] = click(MIDDLE)
image.WithValues = 1
said["on"] = status(image)
"""
    )
    assert "no value: " in said["click"]
    assert said["on"].startswith("60 x 60 pixels. There are no values, because ")
    assert "Keep Values" in said["on"]
