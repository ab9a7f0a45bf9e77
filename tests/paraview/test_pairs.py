"""Every filter on every output that a filter makes: it works, or says in one sentence what to connect instead."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from tests.paraview.filter_script import VOLUME

MADE = """
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
    "flat": Wavelet(WholeExtent=[-5, 5, -5, 5, 0, 0]), "rows": PlotOverLine(Input=volume),
}
outputs = {name: outputs[name] for name in chosen}
for name, given in outputs.items():
    {"cameras": views, "mask": masks}.get(name, given).UpdatePipeline()
"""

PAIRS = """
settings = {
    "Train": few, "StylizedView": {**few, "ImageSize": [32, 24]}, "Stylize": {**styles, "PreviewOnly": 1},
    "Volume": {"Resolution": 16}, "Figure": {"Dpi": 72}, "Render": {"ImageSize": [32, 24]},
}
for name, given in outputs.items():
    for kind in ("Views", "Train", "StylizedView", "Edit", "Palette", "Stylize", "Look", "Join", "Volume", "Render",
                 "Figure", "PlaceInView"):
        inputs = [scene, given] if kind == "Join" else given
        made = globals()["StyleRF" + kind](Input=inputs, **settings.get(kind, {}))
        if kind in ("Views", "Train", "StylizedView"):
            small(made)
        offered = bool(made.SMProxy.GetProperty("Input").IsInDomains())
        made.UpdatePipeline()
        made.UpdatePropertyInformation()
        data = made.SMProxy.GetClientSideObject().GetOutputDataObject(0)
        full = data.GetNumberOfElements(6 if data.IsA("vtkTable") else 0) > 0
        said[f"{name}, {kind}"] = [full, offered, made.Status]
        Delete(made)
    file = f"{folder}/{name}-written.svv"
    try:
        SaveData(file, proxy=given)
    except (AttributeError, RuntimeError):  # ParaView says that it has no writer for that
        pass
    said[f"{name}, writer"] = os.path.exists(file)
palette = StyleRFPalette(Input=scene, Views=baked, Merge="0, 1")
palette.UpdatePipeline()
palette.UpdatePropertyInformation()
said["no views"] = palette.Status
"""

SCENES = ("scene", "image", "stylized view")
"""Outputs that filters of scenes take."""

OF_VOLUMES = ("Views", "Train", "StylizedView")
OF_SCENES = ("Edit", "Palette", "Stylize", "Look", "Join", "Volume", "Render", "Figure")

WHAT = {
    "scene": "a scene", "image": "an image of a scene", "stylized view": "an image of a scene",
    "view": "a set of views", "cameras": "a set of views", "mask": "a flat image",
    "baked": "a volume baked from a scene", "placed": "the picture of a scene in the 3D view", "figure": "a flat image",
    "flat": "a flat image", "rows": "a vtkPolyData",
}  # fmt: skip
"""What sentences call each output."""

LEARNED = "connect the one that it was learned from."
VOLUMES = {
    "scene": LEARNED, "image": LEARNED, "stylized view": LEARNED, "baked": LEARNED, "placed": LEARNED,
    "mask": "more than one slice", "figure": "more than one slice", "flat": "more than one slice",
    "rows": "which fill no space: insert",
}  # fmt: skip
"""What filters of volumes say of what is none."""


USUAL = ("scene", "mask", "rows")
"""Outputs that say most: one that is taken, one that is not, and one that is none of ours."""


@pytest.mark.parametrize(
    "chosen",
    [USUAL, pytest.param([name for name in WHAT if name not in USUAL], marks=pytest.mark.slow)],
    ids=["usual", "all others"],
)
def test_each_filter_takes_each_output_or_says_what_to_connect(inside, chosen: Sequence[str]) -> None:
    said = inside(f"chosen = {chosen!r}\n" + VOLUME + MADE + PAIRS)
    assert "connect StyleRF Views as the second input" in said.pop("no views")
    assert {pair.split(", ")[0] for pair in said} == set(chosen)
    wrong: dict[str, object] = {}
    for pair, found in said.items():
        name, kind = pair.split(", ")
        if kind == "writer":
            right = found == (name in SCENES)
        elif (name in SCENES and kind in OF_SCENES) or (name in SCENES[1:] and kind == "PlaceInView"):
            right = found[:2] == [True, True]
        elif name in ("view", "cameras") and kind in ("Train", "StylizedView"):
            right = found[:2] == [True, True]
        else:
            full, offered, told = found
            words = VOLUMES.get(name, "connect StyleRF Train or Stylized View") if kind in OF_VOLUMES else "connect"
            one = told.endswith(".") and ". " not in told.replace(" a .svv", "")
            right = not full and one and WHAT[name] in told and words in told
            right = right and (kind in OF_VOLUMES or not offered)  # menus enable filters of volumes for all grids
        if not right:
            wrong[pair] = found
    assert not wrong, wrong
