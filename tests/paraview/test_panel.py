"""The panels of Edit, Palette and Stylize in the real ParaView: how they change a scene, and what they refuse."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from svv.core.cameras import sphere_cameras
from svv.core.light import Lamp
from svv.fields.scene import Scene
from svv.io.output import to_bytes, write_png
from svv.io.viewset import ViewSet
from svv.options.editing import OUTLINE_COLOUR, OUTLINE_WIDTH, PAINT_LIGHT
from svv.options.making import DRAWN
from svv.render.pictures import read_png
from svv.styles.gallery import open_style
from svv.styles.offered import GALLERY, INKS
from svv.train.style_choice import pairs_by_colour
from tests.cube import cube_paint, cube_scene, lit_cube_scene

START = """
import json, os, sys
import numpy as np
from paraview.simple import *
from paraview import servermanager as sm
from vtkmodules.util.numpy_support import vtk_to_numpy
folder = sys.argv[1]
os.chdir(folder)
said = {}

from dataclasses import replace
from svv.train import config
draft = config.PRESETS["draft"]
few = replace(draft.stylize, distil_iterations=20, distil_views=6, distil_rays=512, style_iterations=3, style_views=3,
              style_size=48)
config.PRESETS["draft"] = replace(draft, stylize=few)  # a test is no painting

def status(filter):
    filter.UpdatePipeline()
    filter.UpdatePropertyInformation()
    return filter.Status

def arrays(filter, port=0):
    filter.UpdatePipeline()
    data = sm.Fetch(filter, idx=port)
    width, height, _ = data.GetDimensions()
    found = data.GetPointData()
    return {found.GetArrayName(i): vtk_to_numpy(found.GetArray(i)).reshape(height, width, -1)[::-1]
            for i in range(found.GetNumberOfArrays())}

def column(filter, name):
    filter.UpdatePipeline()
    return vtk_to_numpy(sm.Fetch(filter).GetColumnByName(name)).tolist()
"""
END = """
json.dump(said, open("said.json", "w"))
"""


@pytest.fixture
def inside(pvpython, tmp_path: Path):
    """Run a script in pvpython in a folder with `cube.svv`, the painted `two.svv`, and two pictures."""
    cube = cube_scene()
    cube.save(tmp_path / "cube.svv")
    ink = cube.painted(cube_paint(cube, 1), {0: "brush"}, {}, "ink")
    ink.painted(cube_paint(cube, 2), {0: "oil", 1: "oil"}, {}, "oil").save(tmp_path / "two.svv")
    picture = np.full((60, 80, 3), (0.85, 0.2, 0.1), np.float32)
    picture[:, 40:] = (0.1, 0.7, 0.25)
    picture[:, ::2] *= 0.9
    write_png(tmp_path / "halves.png", picture)
    write_png(tmp_path / "blue.png", np.where(picture > 0.5, picture, 0.3)[..., ::-1])

    def run(script: str) -> dict:
        pvpython(START + script + END, tmp_path)
        return json.loads((tmp_path / "said.json").read_text())

    return run


def test_regions_are_hidden_isolated_and_edits_taken_back(inside, tmp_path: Path) -> None:
    said = inside("""
edit = StyleRFEdit(Input=OpenDataFile(folder + "/cube.svv"), Region0Opacity=0.5)
image = StyleRFRender(Input=edit, ImageSize=[40, 40])
seen = lambda: sorted(set(arrays(image)["Region"].ravel().tolist()))
said["all"] = seen()
edit.Region1Hide = 1
said["hidden"] = seen()
edit.SaveFile = folder + "/edited.svv"
status(edit)
edit.SaveScene()
edit.UndoEdit()
said["undone"] = [edit.Region1Hide, seen()]
edit.RedoEdit()
said["redone"] = [edit.Region1Hide, seen()]
edit.ResetEdits()
said["reset"] = [edit.Region1Hide, edit.Region0Opacity, column(edit, "Opacity")]
edit.Isolate = "2"
said["isolated"] = seen()
again = StyleRFEdit(Input=OpenDataFile(folder + "/edited.svv"))
said["again"] = [status(again), column(again, "Opacity")]
again.Undo = 1
said["before"] = [column(again, "Opacity")]
again.Undo, again.AsTrained = 0, 1
said["as trained"] = [column(again, "Opacity")]
again.AsTrained, again.Undo = 0, 2
said["too many"] = status(again)
two = StyleRFEdit(Input=OpenDataFile(folder + "/two.svv"), Variant="ink", Strength=0.5)
said["variant"] = [status(two), [sm.Fetch(two).GetColumnByName("Style").GetValue(k) for k in range(3)]]
said["light on paint"] = [two.PaintLight]
two.PaintLight, two.SaveFile = 0.25, folder + "/dim.svv"
said["light on paint"].append(status(two))
two.SaveScene()
two.UndoEdit()
said["light on paint"].append(two.PaintLight)
two.StrokeOpacity, two.SaveFile = -0.5, folder + "/strokes.svv"
said["strokes"] = [status(two)]
two.SaveScene()
two.UndoEdit()
said["strokes"].append(two.StrokeOpacity)
drawn = StyleRFRender(Input=two, ImageSize=[200, 200])
said["ink"] = [float((arrays(drawn)["RGBA"][..., 3] > 128).mean())]
two.Outline, two.OutlineWidth, two.OutlineRegions, two.SaveFile = 0.9, 8.0, "0, 2", folder + "/inked.svv"
said["ink"] += [status(two), float((arrays(drawn)["RGBA"][..., :3].max(axis=2) < 60).mean())]
two.SaveScene()
two.OutlineRegions = "0, x"
said["no regions"] = status(two)
two.UndoEdit()
two.UndoEdit()
said["ink"] += [two.Outline, two.OutlineWidth, list(two.OutlineColour)]
two.Variant = "chalk"
said["no variant"] = status(two)
""")
    assert said["all"] == [-1, 0, 1, 2] and said["hidden"] == [-1, 0, 2]
    assert said["undone"] == [0, [-1, 0, 1, 2]] and said["redone"] == [1, [-1, 0, 2]]
    assert said["reset"] == [0, 1.0, [1.0, 1.0, 1.0]] and said["isolated"] == [-1, 2]
    regions = Scene.load(tmp_path / "edited.svv").regions
    assert [(r.opacity, r.hidden) for r in regions] == [(0.5, False), (1.0, True), (1.0, False)]
    assert said["again"][1] == [0.5, 1.0, 1.0] and "1 to undo" in said["again"][0]
    assert said["before"] == said["as trained"] == [[1.0, 1.0, 1.0]]
    assert "came with 1" in said["too many"] and "no variant 'chalk'" in said["no variant"]
    default, told, undone = said["light on paint"]
    assert default == undone == PAINT_LIGHT and "light on paint 0.25" in told
    assert [r.paint_light for r in Scene.load(tmp_path / "dim.svv").regions] == [0.25] * 3
    assert "stroke opacity -0.5" in said["strokes"][0] and said["strokes"][1] == 0.0
    assert [r.stroke_opacity for r in Scene.load(tmp_path / "strokes.svv").regions] == [-0.5] * 3
    lines = [(r.outline, r.outline_width) for r in Scene.load(tmp_path / "inked.svv").regions]
    assert lines == [(0.9, 8.0), (0.0, OUTLINE_WIDTH), (0.9, 8.0)] and said["ink"][3:] == [
        0.0,
        OUTLINE_WIDTH,
        list(OUTLINE_COLOUR),
    ]
    assert "outline 0.9, 8 px wide" in said["ink"][1] and said["ink"][2] > 0.01
    assert "whole numbers" in said["no regions"]
    assert said["variant"][1] == ["brush", "", ""] and "shown: ink" in said["variant"][0]


def test_the_light_is_moved_where_it_can_be(inside, tmp_path: Path) -> None:
    lit = lit_cube_scene()
    lit.with_light(-30, 10, intensity=0.7).save(tmp_path / "lit.svv")
    said = inside("""
edit = StyleRFEdit(Input=OpenDataFile(folder + "/lit.svv"), SaveFile=folder + "/edited.svv")
def saved(name):
    said[name] = status(edit)
    os.path.exists("edited.svv") and os.remove("edited.svv")
    edit.SaveScene()
    os.replace("edited.svv", name + ".svv")
saved("as it came")
edit.LightIntensity = 1.5
saved("bright")
edit.LightFrom, edit.LightAzimuth, edit.LightElevation, edit.LightIntensity = "beside the camera", 60, 20, 1.0
saved("beside")
edit.LightFrom, edit.LightDirection = "in the world", [0, 1, 0]
edit.Region1Reflect, edit.Region1Specular, edit.Region1Shininess = 1, 0.6, 12
saved("above")
edit.LightDirection = [0, 0, 0]
said["nowhere"] = status(edit)
edit.ResetEdits()
saved("reset")
other = StyleRFEdit(Input=OpenDataFile(folder + "/cube.svv"), LightFrom="beside the camera", LightAzimuth=60)
said["network"] = status(other)
other.LightFrom, other.Region0Reflect = "as it came", 1
said["coefficients"] = status(other)
""")
    lamps = {name: Scene.load(tmp_path / f"{name}.svv").lamp for name in ("as it came", "bright", "beside", "above")}
    assert lamps["as it came"] == Lamp(-30, 10, None, 0.7) and lamps["bright"] == Lamp(-30, 10, None, 1.5)
    assert lamps["beside"] == Lamp(60, 20, None, 0.7) and lamps["above"] == Lamp(0, 0, (0, 1, 0), 0.7)
    above, expected = Scene.load(tmp_path / "above.svv"), lit.edited(1, ambient=0.1, diffuse=0.9, specular=0.6,
                                                                       shininess=12)  # fmt: skip
    assert above.regions == expected.regions
    assert Scene.load(tmp_path / "reset.svv").lamp == lamps["as it came"] and "60 degrees right" in said["beside"]
    assert "give a direction" in said["nowhere"]
    assert all("Lighting of StyleRF Train" in said[name] for name in ("network", "coefficients"))


def test_a_preview_shows_the_regions(inside) -> None:
    said = inside("""
reader = OpenDataFile(folder + "/cube.svv")
image = StyleRFRender(Input=reader, ImageSize=[80, 80], Show="regions in their colours")
for show in ("regions in their colours", "numbered regions"):
    image.Show = show
    found = arrays(image)
    region = found["Region"][..., 0]
    said[show] = [np.median(found["RGBA"][region == k], axis=0).tolist() for k in (-1, 0, 1, 2)]
""")
    colours = [[*to_bytes(region.colour).tolist(), 255] for region in cube_scene().regions]
    assert said["regions in their colours"][1:] == colours
    assert said["regions in their colours"][0][3] == said["numbered regions"][0][3] == 0
    assert len({tuple(colour) for colour in said["numbered regions"]}) == 4


def test_masks_are_shown_and_kept_before_anything_is_painted(inside, tmp_path: Path) -> None:
    said = inside("""
reader = OpenDataFile(folder + "/cube.svv")
paint = StyleRFStylize(Input=reader, StyleFiles=["halves.png"], PreviewOnly=1, ShownMask=1,
                       MaskFolder=folder + "/masks", Region1Positive="10,30", Region1Negative="70,30")
mask = arrays(paint, 1)
said["status"], said["mask"] = status(paint), mask["Mask"][..., 0].tolist()
said["pixel"], said["sizes"] = mask["Pixel"][7, 3].tolist(), {k: v.shape for k, v in mask.items()}
paint.Region1Positive, paint.Region1Negative, paint.Region1Mask = "", "", folder + "/masks/region-1.png"
said["from file"] = arrays(paint, 1)["Mask"][..., 0].tolist()
paint.Region1Mask, paint.PictureParts = "", 2
said["parts"] = np.unique(arrays(paint, 1)["Mask"]).tolist()
paint.Region1Part = 1
said["part"] = float(arrays(paint, 1)["Mask"].mean())
paint.StyleFiles, paint.Gallery, paint.PictureParts, paint.Region1Part = [], "mosaic", 0, -1
said["gallery"] = arrays(paint, 1)["RGBA"].shape
""")
    mask = np.array(said["mask"])
    assert said["sizes"]["RGBA"] == [60, 80, 3] and said["pixel"] == [3, 7]
    assert mask[:, :36].mean() > 0.95 and mask[:, 44:].mean() < 0.05
    assert "nothing was painted" in said["status"] and said["from file"] == said["mask"]
    assert (tmp_path / "masks" / "region-1.json").is_file() and (tmp_path / "masks" / "region-1-overlay.png").is_file()
    assert said["parts"] == [0, 1] and 0.3 < said["part"] < 0.7 and said["gallery"] == [512, 512, 3]


def test_points_of_a_mask_are_set_in_the_view(inside, tmp_path: Path) -> None:
    # A picture larger than it is used: 1600 x 1200 pixels are shown as 1024 x 768.
    picture = np.full((1200, 1600, 3), (0.85, 0.2, 0.1), np.float32)
    picture[:, 800:] = (0.1, 0.7, 0.25)
    write_png(tmp_path / "large.png", picture)
    said = inside("""
paint = StyleRFStylize(Input=OpenDataFile(folder + "/cube.svv"), StyleFiles=["large.png"], PreviewOnly=1, ShownMask=1)
from svv.pv.points import place_under, set_point
from svv.pv.follow import fit, show_image
none = StyleRFStylize(Input=OpenDataFile(folder + "/cube.svv"), PreviewOnly=1)
set_point(none, (0, 0), "ClickInside")
said["before"] = none.Region0Positive
said["pixel"] = arrays(paint, 1)["Pixel"][700, 256].tolist()
set_point(paint, (256, 767 - 700), "ClickInside")  # rows of an image count from the bottom
said["inside"] = [paint.Region1Positive, float(arrays(paint, 1)["Mask"].mean())]
set_point(paint, (900, 767 - 64), "ClickOutside")
set_point(paint, (1500, 900), "ClickOutside")  # beside the picture
set_point(paint, (1023.4, -0.4), "ClickOutside")
said["outside"] = [paint.Region1Positive, paint.Region1Negative, status(paint)]
set_point(paint, (905, 767 - 60), "ClickRemove")
said["removed"] = [paint.Region1Positive, paint.Region1Negative]
paint.PreviewOnly = 0
set_point(paint, (128, 400), "ClickInside")  # must not begin to paint
paint.UpdatePropertyInformation()
said["waits"] = [paint.Status, paint.Region1Positive]
paint.PreviewOnly = 1
view = CreateView("RenderView")
view.ViewSize = [512, 384]
show_image(OutputPort(paint, 1), view)
Render(view)  # the first time, it sets the camera itself
fit(view, 1024, 768)
said["under"] = [place_under(view, at) for at in ((0, 0), (256, 192), (512, 384))]
""")
    assert said["before"] in ("", None) and said["pixel"] == [400, 1094]
    assert said["inside"][0] == "400,1094" and 0.45 < said["inside"][1] < 0.55
    assert said["outside"][:2] == ["400,1094", "1407,100; 1599,1199"] and "nothing was painted" in said["outside"][2]
    assert said["removed"] == ["400,1094", "1599,1199"]
    assert "nothing was painted" in said["waits"][0] and said["waits"][1] == "400,1094; 200,574"
    np.testing.assert_allclose(said["under"], [(-0.5, -0.5), (511.5, 383.5), (1023.5, 767.5)], atol=0.01)


def test_regions_get_the_pictures_of_their_rows_and_paintings_stand_side_by_side(inside, tmp_path: Path) -> None:
    said = inside("""
reader = OpenDataFile(folder + "/cube.svv")
style = lambda: [sm.Fetch(paint).GetColumnByName("Style").GetValue(k) for k in range(3)]
paint = StyleRFStylize(Input=reader, StyleFiles=["halves.png", "blue.png"], Preset="draft", StrokeSize=0.5,
                       Region0Style="picture 1", Region1Style="as it is", Region2Style="picture 0",
                       Region2Positive="10,30", PreviewFile=folder + "/now.png")
said["first"] = [status(paint), style()]
from pathlib import Path
from svv.fields.scene import Scene
from svv.pv.styling import told_of
said["labels"] = []
show, progress = told_of(Path("again.png"), lambda fraction, label: said["labels"].append(label))
progress(0.1, "before")
show(Scene.load("two.svv"))
progress(0.2, "after")
paint.Strength = 0.25
said["weaker"] = [status(paint), column(paint, "Opacity")]
paint.Variant, paint.Mapping = "by likeness", "by colour"
for k in range(3):
    setattr(paint, f"Region{k}Style", "by mapping")
said["second"] = [status(paint), style()]
paint.ShowVariant = "styled"
said["shown"] = [status(paint), style()]
paint.ShowVariant, paint.Continue, paint.StrokeSize = "", 1, 0.6
said["on"] = status(paint)
paint.SaveFile = folder + "/painted.svv"
paint.SaveScene()
paint.ResetStyle()
said["reset"] = [status(paint), style()]
""")
    assert read_png(tmp_path / "now.png").shape[:2] == read_png(tmp_path / "again.png").shape[:2] == (320, 320)
    assert said["labels"] == ["before", "after; see again.png"]
    assert said["first"][1] == ["blue", "", "halves (region 2)"], said
    assert said["weaker"][0] == said["first"][0], "painted again, though only the strength was changed"
    assert said["shown"] == [said["second"][0], said["first"][1]]
    styles = [open_style(tmp_path / name)[1] for name in ("halves.png", "blue.png")]
    pairs = pairs_by_colour(cube_scene().regions, styles)
    assert [name.split(" ")[0] for name in said["second"][1]] == [("halves", "blue")[pairs[k]] for k in range(3)]
    painted = Scene.load(tmp_path / "painted.svv")
    assert painted.variants == ("by likeness", "styled") and painted.variant == "by likeness"
    assert painted.made["stylized"]["continued"] == [0, 1, 2]
    assert painted.regions[0].strength == 0.25 and said["reset"][1] == ["", "", ""]


def test_a_palette_is_corrected_and_learned_again(inside, tmp_path: Path) -> None:
    cube = cube_scene()
    cameras = sphere_cameras(12, (0.0, 0.0, 0.0), 3.0, 0.5, 48)
    images = np.stack([to_bytes(cube.render(camera).rgba) for camera in cameras])
    ViewSet(tuple(cameras), images, tuple(f"r_{k}" for k in range(12))).write(tmp_path / "views", "train")
    said = inside("""
reader = OpenDataFile(folder + "/cube.svv")
palette = StyleRFPalette(Input=reader, Preset="draft", TimeLimit=1.0)
said["nothing"] = status(palette)
palette.Merge = "0, 2"
said["no views"] = status(palette)
views = OpenDataFile(folder + "/views/transforms_train.json")
palette.Views = views
said["merged"] = [status(palette), column(palette, "Region")]
palette.Merge, palette.Views, palette.ViewsFile = "", None, folder + "/views/transforms_train.json"
palette.Region1SetColour, palette.Region1Colour = 1, [0.1, 0.2, 0.9]
palette.Colour0Add, palette.Colour0Value = 1, [0.9, 0.9, 0.1]
said["changed"] = [status(palette), column(palette, "Region")]
palette.SaveFile = folder + "/corrected.svv"
palette.SaveScene()
palette.ResetPalette()
said["reset"] = [palette.Colour0Add, column(palette, "Region")]
palette.Region7Remove = 1
said["no region"] = status(palette)
""")
    assert "palette is unchanged" in said["nothing"] and "connect StyleRF Views" in said["no views"], said
    assert said["merged"][1] == [0, 1] and "regions 0 and 2 merged" in said["merged"][0]
    assert said["changed"][1] == [0, 1, 2, 3] and "#e6e61a added" in said["changed"][0]
    assert len(Scene.load(tmp_path / "corrected.svv").regions) == 4
    assert said["reset"] == [0, [0, 1, 2]] and "no region 7" in said["no region"]


def test_what_cannot_be_painted_is_one_sentence(inside) -> None:
    said = inside("""
reader = OpenDataFile(folder + "/cube.svv")
def tried(name, **values):
    said[name] = status(StyleRFStylize(Input=reader, Preset="draft", **{"StyleFiles": ["halves.png"], **values}))
tried("none", StyleFiles=[])
tried("missing", StyleFiles=["nowhere.png"])
tried("gallery", StyleFiles=["gallery:gouache"])
tried("picture", Region0Style="picture 3")
tried("region", Region5Style="woodcut")
tried("points", Region0Positive="here")
tried("outside", Region0Positive="500,5")
tried("both", Region0Positive="10,10", Region0Negative="10,10")
tried("negative", Region0Negative="10,10")
tried("mask", Region0Mask="nowhere.png")
tried("cut", Region0Part=1)
tried("part", Region0Part=9, PictureParts=2)
tried("all kept", **{f"Region{k}Style": "as it is" for k in range(3)})
tried("variant", ShowVariant="chalk", PreviewOnly=1)
tried("ink", StyleFiles=["ink:scribble"])
tried("ink's part", Region0Style="ink:hatching", Region0Positive="10,10")
""")
    expected = {
        "none": "at least one picture", "missing": "no style picture", "gallery": "no 'gouache' in the gallery",
        "picture": "picture 3, but there are 1", "region": "no region 5", "points": "must be points",
        "outside": "outside the picture", "both": "both positive and negative", "negative": "at least one positive",
        "mask": "no mask", "cut": "Picture Parts", "part": "is divided into 2", "all kept": "No region is left",
        "variant": "no variant 'chalk'", "ink": "no 'ink:scribble'", "ink's part": "leave out its mask",
    }  # fmt: skip
    assert {name: words in said[name] for name, words in expected.items()} == dict.fromkeys(expected, True), said


def test_the_panel_offers_the_whole_gallery(inside) -> None:
    said = inside("""
paint = StyleRFStylize(Input=OpenDataFile(folder + "/cube.svv"), PreviewOnly=1)
said["offered"] = list(paint.GetProperty("Gallery").Available)
""")
    assert said["offered"] == ["none", *GALLERY, *(DRAWN + kind for kind in INKS)]


def test_regions_are_drawn_in_ink_without_a_picture(inside) -> None:
    said = inside("""
paint = StyleRFStylize(Input=OpenDataFile(folder + "/cube.svv"), Gallery="ink:hatching", Preset="draft",
                       Region1Style="ink:stippling", Region2Style="as it is")
said["status"], said["shape"] = status(paint), arrays(paint, 1)["RGBA"].shape
said["styles"] = [sm.Fetch(paint).GetColumnByName("Style").GetValue(k) for k in range(3)]
""")
    assert said["styles"] == ["ink:hatching", "ink:stippling", ""] and "Painted in" in said["status"], said
    assert said["shape"] == [64, 64, 3]
