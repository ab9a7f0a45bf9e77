"""Every filter on every output that a filter makes: it works, or says in one sentence what to connect instead."""

from __future__ import annotations

from tests.paraview.filter_script import VOLUME

MADE = """
from paraview import servermanager as sm
volume, display = shown(6)
scene = OpenDataFile(folder + "/two.svv")
image = StyleRFRender(Input=scene, ImageSize=[32, 24])
few = dict(Preset="draft", Settings=FEW)
views = small(StyleRFViews(Input=volume))
stylized = small(StyleRFStylizedView(Input=volume, ImageSize=[32, 24], **few))
styles = dict(StyleFiles=[folder + "/halves.png"], Preset="draft")
masks = StyleRFStylize(Input=scene, PreviewOnly=1, **styles)
figure = StyleRFFigure(Input=scene, Dpi=72)
baked, placed = StyleRFVolume(Input=scene, Resolution=16), StyleRFPlaceInView(Input=image)
outputs = {
    "scene": scene, "image": image, "stylized view": stylized, "view": views, "cameras": OutputPort(views, 1),
    "mask": OutputPort(masks, 1), "baked": baked, "placed": placed, "figure": figure,
}
for made in (stylized, views, masks, baked, placed, figure):
    made.UpdatePipeline()
"""

PAIRS = """
settings = {
    "Train": few, "StylizedView": {**few, "ImageSize": [32, 24]}, "Stylize": {**styles, "PreviewOnly": 1},
    "Volume": {"Resolution": 16}, "Figure": {"Dpi": 72}, "Render": {"ImageSize": [32, 24]},
}
for name, given in outputs.items():
    for kind in ("Views", "Train", "Edit", "Palette", "Stylize", "Look", "Join", "Volume", "Render", "PlaceInView",
                 "StylizedView", "Figure"):
        inputs = [scene, given] if kind == "Join" else given
        made = globals()["StyleRF" + kind](Input=inputs, **settings.get(kind, {}))
        if kind in ("Views", "Train", "StylizedView"):
            small(made)
        offered = bool(made.SMProxy.GetProperty("Input").IsInDomains())
        told = status(made)
        data = made.SMProxy.GetClientSideObject().GetOutputDataObject(0)
        full = data.GetNumberOfElements(6 if data.IsA("vtkTable") else 0) > 0
        said[f"{name}, {kind}"] = [full, offered, told]
        Delete(made)
    try:
        SaveData(f"{folder}/{name}.svv", proxy=given)
    except RuntimeError as error:
        said[f"{name}, writer"] = str(error)
    said[f"{name}, written"] = os.path.exists(f"{folder}/{name}.svv")
palette = StyleRFPalette(Input=scene, Views=baked, Merge="0, 1")
said["no views"] = status(palette)
"""


def test_x(inside) -> None:
    said = inside(VOLUME.replace("import json, os, sys, tempfile", "") + MADE + PAIRS)
    for p, q in said.items():
        print(p, "|", q)
