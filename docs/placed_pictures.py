"""The documentation's pictures of scenes among other things in ParaView's 3D view, from the results of ``make demo``.

``.venv/bin/svv pvpython docs/placed_pictures.py demo`` in the checkout writes ``docs/images/volume.jpg`` and
``docs/images/placed.jpg``, in two minutes of CPU time.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

from PIL import Image

IMAGES = Path(__file__).resolve().parent / "images"

SIZE = 640
"""Width and height of each picture in pixels."""

EYE, TURNED = (0.45, 0.55, 1.5), (-0.9, 0.75, 1.1)
"""Directions of the cameras from the middle of the box, in sides of the box."""


def look_from(view: Any, bounds: tuple[float, ...], eye: tuple[float, float, float], zoom: float = 1.0) -> None:
    """Point the view's camera at the middle of a box."""
    from paraview import simple

    simple.Render(view)  # the first one resets the camera
    low, high = bounds[::2], bounds[1::2]
    side = max(b - a for a, b in zip(low, high, strict=True))
    middle = [0.5 * (a + b) for a, b in zip(low, high, strict=True)]
    view.CameraPosition = [m + 1.15 / zoom * side * e for m, e in zip(middle, eye, strict=True)]
    view.CameraFocalPoint, view.CameraViewUp, view.CameraViewAngle = middle, [0.0, 1.0, 0.0], 30.0


def shot(view: Any, folder: Path) -> Image.Image:
    """Return what the view shows."""
    from paraview import simple

    simple.Render(view)
    simple.SaveScreenshot(str(folder / "shot.png"), view)
    return Image.open(folder / "shot.png").convert("RGB").copy()


def keep(name: str, pictures: list[Image.Image]) -> None:
    """Save pictures side by side among the documentation's images."""
    wide = Image.new("RGB", (sum(p.width for p in pictures), pictures[0].height), "white")
    left = 0
    for picture in pictures:
        wide.paste(picture, (left, 0))
        left += picture.width
    wide.save(IMAGES / f"{name}.jpg", quality=84, optimize=True, progressive=True)


def new_view() -> Any:
    """Return an empty white view."""
    from paraview import simple

    view = simple.CreateView("RenderView")
    view.ViewSize, view.OrientationAxesVisibility = [SIZE, SIZE], 0
    view.UseColorPaletteForBackground, view.Background = 0, [1.0, 1.0, 1.0]
    simple.SetActiveView(view)
    return view


def coloured(source: Any, view: Any, colour: tuple[float, float, float]) -> Any:
    """Show a source in one colour."""
    from paraview import simple

    display = simple.Show(source, view)
    display.ColorArrayName = [None, ""]
    display.DiffuseColor = display.AmbientColor = list(colour)
    return display


def volume_pictures(demo: Path, folder: Path) -> list[Image.Image]:
    """Return a painted scene as a volume; with a sphere and a plane in it; and cut open."""
    from paraview import simple

    volume = simple.StyleRFVolume(Input=simple.OpenDataFile(str(demo / "styled.svv")))
    view = new_view()
    simple.Show(volume, view)
    bounds = volume.GetDataInformation().GetBounds()
    look_from(view, bounds, EYE, 0.85)
    pictures = [shot(view, folder)]
    side = bounds[1] - bounds[0]
    sphere = simple.Sphere(Center=[0.24 * side, -0.18 * side, 0.34 * side], Radius=0.09 * side)
    sphere.ThetaResolution = sphere.PhiResolution = 64
    plane = simple.Plane(Origin=[bounds[0], 0.0, bounds[4]], Point1=[bounds[1], 0.0, bounds[4]])
    plane.Point2 = [bounds[0], 0.0, bounds[5]]
    shown = [coloured(sphere, view, (0.15, 0.45, 0.3)), coloured(plane, view, (0.72, 0.72, 0.76))]
    pictures.append(shot(view, folder))
    for display in shown:
        display.Visibility = 0
    volume.Cut = 1
    volume.CutBy.Origin, volume.CutBy.Normal = [0.0, 0.0, 0.0], [0.35, 0.1, 1.0]
    pictures.append(shot(view, folder))
    return pictures


def placed_pictures(demo: Path, folder: Path) -> list[Image.Image]:
    """Return a scene's image among glyphs, a slice and an outline; the same, opaque; and turned."""
    from paraview import simple

    field = simple.OpenDataFile(str(demo / "volume.vti"))
    view = new_view()
    cut = simple.Slice(Input=field)
    cut.SliceType.Origin, cut.SliceType.Normal = [0.0, -0.12, 0.0], [0.0, 1.0, 0.0]
    display = simple.Show(cut, view)
    simple.ColorBy(display, ("POINTS", "wave"))
    display.SetScalarBarVisibility(view, False)
    gradient = simple.Gradient(Input=field)
    gradient.ScalarArray = ["POINTS", "wave"]
    upright = simple.Slice(Input=gradient)
    upright.SliceType.Origin, upright.SliceType.Normal = [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]
    glyphs = simple.Glyph(Input=upright, GlyphType="Arrow", GlyphMode="Uniform Spatial Distribution (Bounds Based)")
    glyphs.OrientationArray, glyphs.ScaleArray = ["POINTS", "Gradient"], ["POINTS", "Gradient"]
    glyphs.MaximumNumberOfSamplePoints, glyphs.ScaleFactor = 900, 0.03
    coloured(glyphs, view, (0.1, 0.45, 0.2))
    coloured(simple.Outline(Input=field), view, (0.15, 0.15, 0.15))
    image = simple.StyleRFRender(Input=simple.OpenDataFile(str(demo / "styled.svv")))
    placed = simple.StyleRFPlaceInView(Input=image)
    simple.Show(placed, view)
    bounds = field.GetDataInformation().GetBounds()
    look_from(view, bounds, EYE, 0.85)
    pictures = [shot(view, folder)]
    placed.Opaque = 1
    pictures.append(shot(view, folder))
    placed.Opaque = 0
    look_from(view, bounds, TURNED, 0.85)
    pictures.append(shot(view, folder))
    return pictures


def main() -> None:
    demo = Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory() as name:
        keep("volume", volume_pictures(demo, Path(name)))
        keep("placed", placed_pictures(demo, Path(name)))


if __name__ == "__main__":
    main()
