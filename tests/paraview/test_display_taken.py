"""*Take What Is Shown Now* in the real ParaView: what has changed in the display counts, too."""

from __future__ import annotations

import json

from tests.paraview.test_displays import END, VOLUME


def test_what_is_shown_now_is_taken_with_how_the_display_shows_it(pvpython, tmp_path) -> None:
    done = """
data = image()
data.GetPointData().AddArray(named("other", 200 - field))
input = source(data)
display = show(input, "POINTS", "other", Ambient=0.25)
show(input)
made = StyleRFViews(Input=input, Views=4, ViewSize=32, RayCaster="cpu")
made.Diffuse = 0.5

def taken(name):
    made.UpdatePipeline(); made.UpdatePropertyInformation()
    said[name] = [made.Scalars[1], made.Shade, made.Ambient, made.Diffuse, made.TransferFunction == display.LookupTable,
                  str(made.Status)[:30]]

taken("first")
ColorBy(display, ("POINTS", "other"))
display.Ambient = 0.75
taken("display changed")
made.TakeWhatIsShownNow()
taken("taken")
display.BlendMode = "Isosurface"
made.TakeAsEdited()
taken("refused")
display.BlendMode = "Composite"
made.TakeAsEdited()
taken("again")
first, view = view, CreateView("RenderView")
show(input, Ambient=0.5)  # another view, which is active now
made.TakeAsEdited()
taken("other view")
display.SetRepresentationType("Outline")
Hide(input, view); GetDisplayProperties(input, view).SetRepresentationType("Outline")
made.TakeAsEdited()
taken("no volume")
"""
    pvpython(VOLUME + done + END, tmp_path)
    said = json.loads((tmp_path / "said.json").read_text())
    assert said["first"][:5] == ["s", 0, 0.25, 0.5, True]
    assert said["display changed"][:5] == ["s", 0, 0.25, 0.5, False]
    for name in ("taken", "again", "other view", "no volume"):  # what the panel alone was told stays
        assert said[name][:5] == ["other", 0, 0.75, 0.5, True], name
        assert said[name][5].startswith("4 views"), name
    assert said["refused"][5].startswith("The volume is shown with the")
