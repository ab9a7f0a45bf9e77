"""The panel of Stylize in the real ParaView: pictures, masks, gallery and ink, and what it refuses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from svv.fields.scene.scene import Scene
from svv.io.pictures.output import write_png
from svv.options.making import DRAWN
from svv.render.pictures import read_png
from svv.styles.gallery import open_style
from svv.styles.gallery.offered import GALLERY, INKS
from svv.train.paint.style_choice import pairs_by_colour
from tests.cube import cube_scene


@pytest.mark.slow
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


@pytest.mark.slow
def test_points_of_a_mask_are_set_in_the_view(inside, tmp_path: Path) -> None:
    # A picture larger than it is used: 1600 x 1200 pixels are shown as 1024 x 768.
    picture = np.full((1200, 1600, 3), (0.85, 0.2, 0.1), np.float32)
    picture[:, 800:] = (0.1, 0.7, 0.25)
    write_png(tmp_path / "large.png", picture)
    said = inside("""
paint = StyleRFStylize(Input=OpenDataFile(folder + "/cube.svv"), StyleFiles=["large.png"], PreviewOnly=1, ShownMask=1)
from svv.pv.client.clicks import place_under
from svv.pv.client.mask_points import set_point
from svv.pv.display.linked_camera import fit, show_image
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


@pytest.mark.slow
def test_regions_get_the_pictures_of_their_rows_and_paintings_stand_side_by_side(inside, tmp_path: Path) -> None:
    said = inside("""
reader = OpenDataFile(folder + "/cube.svv")
style = lambda: [sm.Fetch(paint).GetColumnByName("Style").GetValue(k) for k in range(3)]
paint = StyleRFStylize(Input=reader, StyleFiles=["halves.png", "blue.png"], Preset="draft", StrokeSize=0.5,
                       Region0Style="picture 1", Region1Style="as it is", Region2Style="picture 0",
                       Region2Positive="10,30", PreviewFile=folder + "/now.png")
said["first"] = [status(paint), style()]
from pathlib import Path
from svv.fields.scene.scene import Scene
from svv.job.request import make_preview_callback
said["labels"] = []
show, progress = make_preview_callback(Path("again.png"), lambda fraction, label: said["labels"].append(label))
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
    assert painted.made["stylized"]["continued"] == []
    assert painted.regions[0].strength == 0.25 and said["reset"][1] == ["", "", ""]


@pytest.mark.slow
def test_regions_share_a_picture_and_a_row_chooses_its_part(inside) -> None:
    said = inside(
        """
paint = StyleRFStylize(Input=OpenDataFile(folder + "/cube.svv"), StyleFiles=["halves.png"], Preset="draft",
                       Region2Style="as it is", Manner="pieces", StrokeSize=2.0)
said["offered"] = list(paint.GetProperty("Divide").Available)
said["first"] = status(paint)
first = re.findall(r"Region (\\d): (\\S+) of halves", said["first"])
said["parts"] = first
paint.Region0Share = dict(first)["1"]
said["turned"] = re.findall(r"Region (\\d): (\\S+) of halves", status(paint))
paint.Region0Share = "nonsense"
said["refused"] = status(paint)
paint.Region0Share, paint.Divide = "", "no"
said["whole"] = status(paint)
""".replace("paint =", "import re\npaint =", 1)
    )
    assert said["offered"] == ["auto", "areas", "colours", "no"]
    assert "halves is divided among the regions" in said["first"], said
    assert [region for region, _ in said["parts"]] == ["0", "1"] and len({part for _, part in said["parts"]}) == 2
    assert (
        dict(said["turned"])["0"] == dict(said["parts"])["1"] and dict(said["turned"])["1"] != dict(said["turned"])["0"]
    )
    assert "halves has no part called 'nonsense'; its parts are" in said["refused"]
    assert "divided" not in said["whole"] and "Painted in" in said["whole"]


@pytest.mark.slow
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


@pytest.mark.slow
def test_regions_are_drawn_in_ink_without_a_picture(inside) -> None:
    said = inside("""
paint = StyleRFStylize(Input=OpenDataFile(folder + "/cube.svv"), Gallery="ink:hatching", Preset="draft",
                       Region1Style="ink:stippling", Region2Style="as it is")
said["status"], said["shape"] = status(paint), arrays(paint, 1)["RGBA"].shape
said["styles"] = [sm.Fetch(paint).GetColumnByName("Style").GetValue(k) for k in range(3)]
""")
    assert said["styles"] == ["ink:hatching", "ink:stippling", ""] and "Painted in" in said["status"], said
    assert said["shape"] == [64, 64, 3]


def test_opacity_follows_glazes_unless_an_edit_says_how(inside, tmp_path: Path) -> None:
    inside("""
from dataclasses import replace
from svv.job import request
painted = request.stylize_scene

def glazed(*given, **more):  # as if region 0 were translucent
    scene, report = painted(*given, **more)
    kept = scene.made["stylized"]
    scene = scene.painted(scene.styled, {0: scene.regions[0].style}, kept, scene.variant, {0: 0.2})
    return scene, report

request.stylize_scene = glazed
reader = OpenDataFile(folder + "/cube.svv")
for name, own in (("plain", {}), ("edited", {"StrokeOpacity": -0.3})):
    edit = StyleRFEdit(Input=reader, Region1Opacity=0.5, **own)
    paint = StyleRFStylize(Input=edit, Region0Style="ink:hatching", Region1Style="as it is", Preset="draft")
    shown = StyleRFEdit(Input=paint, SaveFile=f"{folder}/{name}.svv")
    shown.UpdatePipeline()
    shown.SaveScene()
""")
    plain, edited = (Scene.load(tmp_path / f"{name}.svv") for name in ("plain", "edited"))
    assert [scene.regions[0].stroke_opacity for scene in (plain, edited)] == [0.2, -0.3]
    assert plain.undone().regions[0].stroke_opacity == 0.2 and plain.undone().regions[1].opacity == 1.0
    assert edited.reset().regions[0].stroke_opacity == 0.2
