"""The panels of Edit and Palette in the real ParaView: how they change a scene, and what they refuse."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from svv.core.colour.light import Lamp
from svv.core.geometry.box import Box
from svv.core.geometry.cameras import CameraRig, sphere_cameras
from svv.fields.scene.expected import ExpectedErrors
from svv.fields.scene.scene import Scene
from svv.io.pictures.output import to_bytes
from svv.io.views.viewset import ViewSet
from svv.options.editing import OUTLINE_COLOUR, OUTLINE_WIDTH, PAINT_LIGHT
from svv.styles.gallery import gallery_picture
from svv.train.paint.ink import StyleInput
from svv.train.pipeline import stylize_scene
from tests.balls import SHORT
from tests.cube import clear_place, cube_scene, lit_cube_scene
from tests.loose_balls import loose_balls


def test_a_panel_cuts_a_scene_open(inside, tmp_path: Path) -> None:
    said = inside("""
edit = StyleRFEdit(Input=OpenDataFile(folder + "/cube.svv"))
image = StyleRFRender(Input=edit, ImageSize=[40, 40])
visible = lambda: float((arrays(image)["RGBA"][..., 3] > 100).mean())
said["whole"] = visible()
edit.Cuts = "x>50%; 1=outside sphere:0,0,0:0.3"
said["cut"] = [visible(), status(edit)]
volume = StyleRFVolume(Input=edit, Resolution=16)
said["volume"] = status(volume)
edit.SaveFile = folder + "/open.svv"
edit.SaveScene()
edit.Cuts = "x=5"
said["no cut"] = status(edit)
edit.UndoEdit()
edit.UndoEdit()
said["undone"] = [edit.Cuts, visible()]
""")
    assert 0.3 < said["cut"][0] / said["whole"] < 0.7
    told = ["cut x > 0", "cut all but ball of radius 0.3 at 0, 0, 0 of region 1"]
    assert all(one in said["cut"][1] for one in told), said["cut"]
    assert [cut.describe() for cut in Scene.load(tmp_path / "open.svv").cuts] == told
    assert said["no cut"].startswith("'x=5' is no cut: give sides of planes")
    assert said["undone"] == ["", said["whole"]]


def test_surfaces_with_handles_cut_a_scene_open(inside, tmp_path: Path) -> None:
    cube = cube_scene()
    there = replace(cube.occupancy, box=Box((9.5, -0.5, -0.5), 1.0, (1.0, 1.0, 1.0)))
    rig = CameraRig((10.0, 0.0, 0.0), 3.0, 0.5, (24, 24))
    replace(cube, occupancy=there, camera_rig=rig).save(tmp_path / "moved.svv")
    said = inside("""
import torch
from svv.core.geometry.cuts import Cut
from svv.pv.panel.cutting_shapes import text_of
reader = OpenDataFile(folder + "/moved.svv")
reader.UpdatePipeline()
edit = StyleRFEdit(Input=reader)
image = StyleRFRender(Input=edit, ImageSize=[24, 24])
visible = lambda: float((arrays(image)["RGBA"][..., 3] > 100).mean())
last = lambda: status(edit).split("last edit: ")[-1].split(" (")[0]
said["whole"] = visible()
edit.CutOpen = 1
said["first"] = [last(), visible()]
# ParaView's own functions, at the numbers of its panels.
numbers = {
    "Plane": {"Origin": [10.1, 0.2, 0.0], "Normal": [1.0, 2.0, -1.0], "Offset": 0.05},
    "Box": {"Position": [9.9, -0.3, -0.2], "Rotation": [20.0, -50.0, 35.0], "Length": [0.4, 0.7, 0.5]},
    "Sphere": {"Center": [10.1, 0.0, 0.1], "Radius": 0.4},
    "Cylinder": {"Center": [10.0, 0.1, 0.0], "Axis": [1.0, -2.0, 0.5], "Radius": 0.3},
}
points = np.random.default_rng(3).uniform(-0.6, 0.6, (150, 3)) + [10.0, 0.0, 0.0]
said["placed"], said["agree"], said["inside"], steps = {}, {}, {}, []
for kind, values in numbers.items():
    edit.CutOpenBy = kind
    said["placed"][kind] = [visible(), last()]
    for name, value in values.items():
        setattr(edit.CutOpenBy, name, value)
    visible()
    function = edit.CutOpenBy.SMProxy.GetClientSideObject()
    depth = Cut.parse(text_of(function), [[0] * 3, [1] * 3]).depth(torch.from_numpy(points)).numpy()
    signs = np.array([function.FunctionValue(*point) for point in points]) * (1 if kind == "Plane" else -1)
    said["agree"][kind] = bool(((signs > 0) == (depth > 0))[abs(depth) > 1e-6].all())
    said["inside"][kind] = float((depth > 0).mean())
    if kind == "Box":
        edit.CutOpenBy.UseReferenceBounds, edit.CutOpenBy.Bounds = 1, [-0.5, 0.5, 0.0, 2.0, 0.0, 1.0]
        edit.UpdatePipeline()
        depth = Cut.parse(text_of(function), [[0] * 3, [1] * 3]).depth(torch.from_numpy(points)).numpy()
        signs = -np.array([function.FunctionValue(*point) for point in points])
        said["agree"]["bounds"] = bool(((signs > 0) == (depth > 0))[abs(depth) > 1e-6].all())
        edit.CutOpenBy.UseReferenceBounds = 0
        SaveState(folder + "/open.pvsm")
    steps.append([last(), visible()])
edit.InvertCut, edit.CutRegions, edit.Cuts = 0, "1", "z<0"
said["both"] = status(edit)
edit.InvertCut, edit.CutRegions, edit.Cuts = 1, "", ""
said["again"] = [last(), visible()]
edit.CutOpenBy.Radius = 0.2
said["smaller"] = [last(), visible()]
edit.UndoEdit()
said["undone"] = [last(), visible()]
edit.RedoEdit()
said["redone"] = [last(), visible()]
edit.ResetEdits()
said["reset"] = [status(edit), visible()]
edit.CutOpen, edit.CutOpenBy = 1, "Box"
edit.CutOpenBy.Length = [1.0, 0.0, 1.0]
said["flat"] = status(edit)
ResetSession()
LoadState(folder + "/open.pvsm")
edit, image = FindSource("StyleRFEdit1"), FindSource("StyleRFRender1")
said["loaded"], said["steps"] = [last(), visible()], steps
said["volume"] = StyleRFVolume(Input=edit).CutBy.Origin[0]
""")
    assert said["first"][0] == "cut x > 10" and 0.3 < said["first"][1] / said["whole"] < 0.7
    assert said["agree"] == dict.fromkeys((*said["placed"], "bounds"), True)
    assert all(0.02 < share < 0.98 for share in said["inside"].values()), said["inside"]
    # New surfaces stand in the scene, not where ParaView puts them for an input without bounds.
    assert said["placed"]["Sphere"][1] == "cut all but ball of radius 0.25 at 10, 0, 0"
    assert all(0.02 < shown / said["whole"] < 0.9 for shown, _ in said["placed"].values()), said["placed"]
    assert "cut z < 0; cut cylinder of radius 0.3 at 10, 0.1, 0 of region 1" in said["both"]
    assert said["again"] == said["undone"] == said["steps"][3] and said["smaller"] == said["redone"] != said["undone"]
    assert said["reset"] == ["3 regions.", said["whole"]]
    assert said["flat"].startswith(
        "The shape of Cut Open By has no inside: choose a shape, and for a box lengths that are not 0."
    )
    assert said["loaded"] == said["steps"][1] and said["loaded"][0].startswith("cut all but ")
    assert said["volume"] == 10.0


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


def test_strokes_are_edited_where_there_are_any(inside, tmp_path: Path) -> None:
    oil = StyleInput(gallery_picture("oil", 200), "oil")
    stylize_scene(loose_balls(), [oil], SHORT, stroke_size=3.0)[0].save(tmp_path / "oil.svv")
    said = inside("""
edit = StyleRFEdit(Input=OpenDataFile(folder + "/oil.svv"), StrokeRelief=2.0, StrokeWidth=0.7, MoveStrokeLight=1)
edit.StrokeLight, edit.StrokePalette, edit.SaveFile = [0, 0, 2], "#102040,#f0d090", folder + "/edited.svv"
said["edited"] = status(edit)
edit.SaveScene()
edit.StrokeWidth = 3.0
said["too wide"] = status(edit)
plain = StyleRFEdit(Input=OpenDataFile(folder + "/cube.svv"), StrokeRelief=0.5)
said["none"] = status(plain)
""")
    assert "stroke relief 2, stroke width 0.7, stroke light 0,0,1, stroke palette of 64 colours" in said["edited"]
    region = Scene.load(tmp_path / "edited.svv").regions[0]
    assert (region.stroke_relief, region.stroke_width, region.stroke_light) == (2.0, 0.7, (0.0, 0.0, 1.0))
    assert "Stroke Size of StyleRF Stylize" in said["too wide"] and "No region of this painting" in said["none"]


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
    assert all("Lighting 'phong' of StyleRF Train" in said[name] for name in ("network", "coefficients"))


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


def test_an_image_shows_its_expected_error_or_says_that_it_is_not_known(inside, tmp_path: Path) -> None:
    level = np.full((32, 32, 32), 255, np.uint8)
    known = ExpectedErrors(level, 0.25, 0.0, 0.1, 0.2, (0.0, 0.0, 0.0))
    replace(cube_scene(), expected=known).save(tmp_path / "knows.svv")
    said = inside("""
for name in ("knows", "cube"):
    image = StyleRFRender(Input=OpenDataFile(f"{folder}/{name}.svv"), ImageSize=[40, 40], Show="expected error")
    found = arrays(image)
    said[name] = [sorted(found), status(image)]
    if "Doubt" in found:
        said["most"] = float(np.nanmax(found["Doubt"]))
        said["clear"] = int((found["RGBA"][..., 3] > 0).sum() - np.isfinite(found["Doubt"]).sum())
    image.Show = "image"
    said[name].append("Doubt" in arrays(image))
""")
    assert "Doubt" in said["knows"][0] and not said["knows"][2] and said["clear"] == 0
    assert 0.0 < said["most"] <= 0.25 + 1e-6
    assert "train it again" in said["cube"][1] and not said["cube"][2]


def test_a_palette_is_corrected_and_learned_again(inside, tmp_path: Path) -> None:
    cube = cube_scene()
    cameras = sphere_cameras(12, (0.0, 0.0, 0.0), 3.0, 0.5, 48)
    images = np.stack([to_bytes(cube.render(camera).rgba) for camera in cameras])
    ViewSet(tuple(cameras), images, tuple(f"r_{k}" for k in range(12))).write(tmp_path / "views", "train")
    places = [",".join(f"{v:.6f}" for v in clear_place(cube, region)) for region in (1, 2)]
    (tmp_path / "points.txt").write_text("=".join(places))
    said = inside("""
reader = OpenDataFile(folder + "/cube.svv")
palette = StyleRFPalette(Input=reader, Preset="draft")
said["nothing"] = status(palette)
palette.Merge = "0, 2"
said["no views"] = status(palette)
views = OpenDataFile(folder + "/views/transforms_train.json")
palette.Views = views
said["merged"] = [status(palette), column(palette, "Region")]
palette.Merge, palette.Points = "", open(folder + "/points.txt").read()
said["pointed"] = [status(palette), column(palette, "Region")]
palette.Points = "9,9,9=1"
said["no place"] = status(palette)
palette.Points = "1,2,3"
said["no point"] = status(palette)
palette.Points, palette.Views, palette.ViewsFile = "", None, folder + "/views/transforms_train.json"
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
    assert said["pointed"][1] == [0, 1] and "regions 1 and 2 merged" in said["pointed"][0]
    assert "There is nothing at 9, 9, 9" in said["no place"] and "write x,y,z=region or x,y,z=x,y,z" in said["no point"]
    assert said["changed"][1] == [0, 1, 2, 3] and "#e6e61a added" in said["changed"][0]
    assert len(Scene.load(tmp_path / "corrected.svv").regions) == 4
    assert said["reset"] == [0, [0, 1, 2]] and "no region 7" in said["no region"]


@pytest.mark.slow
def test_a_click_makes_a_part_a_region_of_its_own(inside, tmp_path: Path) -> None:
    loose_balls().save(tmp_path / "balls.svv")
    said = inside("""
from svv.pv.client.part_picking import pick
from svv.pv.display.linked_camera import fit, show_image
edit = StyleRFEdit(Input=OpenDataFile(folder + "/balls.svv"), SaveFile=folder + "/split.svv")
image = StyleRFRender(Input=edit, ImageSize=[60, 60], Camera=[0, 0, 3, 0, 0, 0, 0, 1, 0, 23])
sides = lambda: [int((arrays(image)["RGBA"][:, half, 3] > 200).sum()) for half in (slice(0, 30), slice(30, 60))]
said["whole"] = [status(edit), sides()]
flat = CreateView("RenderView")
flat.ViewSize = [120, 120]
show_image(image, flat)
Render(flat)
fit(flat, 60, 60)
pick(edit, flat, (34, 60))  # in the left ball, which is 9 pixels wide in the image
said["split"] = [status(edit), edit.Parts, column(edit, "Part Of"), sides()]
edit.Region2Hide = 1
said["hidden"] = [status(edit), sides()]
edit.SaveScene()
pick(edit, flat, (34, 60))  # nothing is there any more
said["nothing"] = [edit.Status, edit.Parts]
pick(edit, flat, (84, 60))
said["one piece"] = status(edit)
edit.UndoEdit()
said["undone"] = [status(edit), edit.Parts, edit.Region2Hide]
edit.UndoEdit(), edit.UndoEdit()
said["all undone"] = [status(edit), edit.Parts, sides()]
edit.RedoEdit(), edit.RedoEdit()
said["redone"] = [edit.Parts, edit.Region2Hide, sides()]
edit.ResetEdits()
solid = CreateView("RenderView")  # a 3D view, with a camera of its own: from the left, the left ball hides the other
solid.ViewSize = [100, 80]
Show(Box(XLength=1, YLength=1, ZLength=1), solid)
Render(solid)
camera = solid.GetActiveCamera()
camera.SetPosition(-3, 0, 0), camera.SetFocalPoint(0, 0, 0), camera.SetViewUp(0, 1, 0), camera.SetViewAngle(23)
pick(edit, solid, (50, 40))
said["solid"] = [float(edit.Parts.split(",")[0]), status(edit)]
edit.Parts = "1,2"
said["no point"] = status(edit)
edit.ResetEdits()
hand = flat.GetInteractor()
def click(x, y, moved=0):
    hand.SetEventInformation(x, y)
    hand.InvokeEvent("LeftButtonPressEvent")
    hand.SetEventInformation(x + moved, y)
    hand.InvokeEvent("LeftButtonReleaseEvent")
said["clicks"] = []
for press, moved in ((0, 0), (1, 20), (0, 0), (1, 0)):  # off, on but dragged, on, off
    press and edit.ClickPart()
    click(34, 60, moved)
    said["clicks"].append(edit.Parts)
    if edit.Parts:
        edit.ResetEdits()
""")
    whole, both = said["whole"]
    assert "2 regions" in whole and min(both) > 40
    told, point, part_of, shown = said["split"]
    assert "3 regions; region 2 is part of region 0; last edit: split region 0 (1 to undo)" in told
    assert part_of == [-1, -1, 0] and shown == both and float(point.split(",")[0]) < -0.2
    assert said["hidden"][1] == [0, both[1]] and "hide 2" in said["hidden"][0]
    assert [r.part_of for r in Scene.load(tmp_path / "split.svv").regions] == [None, None, 0]
    assert "Nothing is visible at the pixel" in said["nothing"][0] and said["nothing"][1] == point
    assert "in one piece" in said["one piece"]
    assert said["undone"][1:] == [point, 1] and said["all undone"][1:] == ["", both]
    assert said["redone"] == [point, 1, [0, both[1]]]
    assert said["solid"][0] < -0.2 and "3 regions" in said["solid"][1]
    assert "Parts must be points in space" in said["no point"]
    assert [text[:4] for text in said["clicks"]] == ["", "", "-0.2", ""]


def test_what_panels_show_at_first_is_said_in_one_sentence_and_short_labels(inside) -> None:
    said = inside("""
import re
manager = sm.vtkSMProxyManager.GetProxyManager().GetActiveSessionProxyManager()
said["long"], said["seen"] = [], 0
for name in (name for name in dir(sm.filters) if name.startswith("StyleRF")):
    proxy = manager.NewProxy("filters", name)
    iterator = proxy.NewPropertyIterator()
    iterator.Begin()
    while not iterator.IsAtEnd():
        found, key = iterator.GetProperty(), iterator.GetKey()
        if found.GetPanelVisibility() == "default" and not found.GetIsInternal() and found.GetDocumentation():
            help = " ".join(found.GetDocumentation().GetDescription().split("<br/>")[0].split())
            said["seen"] += 1
            if not help.endswith(".") or re.search(r"[.] [A-Z(]", help) or len(found.GetXMLLabel()) > 24:
                said["long"].append([name, key, help])
        iterator.Next()
""")
    assert said["seen"] > 100 and said["long"] == []
