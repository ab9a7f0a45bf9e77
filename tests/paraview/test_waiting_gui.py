"""A filter that has failed in the window for want of a transfer function starts nothing by itself."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from docs.screenshots import LISTENER, Window
from tests.nightly import nightly

SCRIPT = """
from paraview.simple import *
from svv.pv.live import sharpening

wavelet = Wavelet(WholeExtent=[-8, 8] * 3)
view = GetActiveViewOrCreate("RenderView")
display = Show(wavelet, view)  # as an outline
few = "reconstruct.iterations=20; recolour.iterations=20"
filter = StyleRFStylizedView(Input=wavelet, Preset="draft", Views=12, ViewSize=32, ImageSize=[48, 48], Settings=few)
filter.Live = 0
sharpening.in_window(filter)  # as for a filter that the menu makes
shown = Show(filter, view)
Render(view)

def said():
    Render(view)
    filter.UpdatePipeline()
    filter.UpdatePropertyInformation()
    return filter.Status

told = [said()]
display.SetRepresentationType("Volume")
ColorBy(display, ("POINTS", "RTData"))
for _ in range(3):
    told.append(said())
CreateView("RenderView")  # something is registered again
filter.Camera = [0.0] * 10  # following a view is no Apply, either
told.append(said())
WHAT
told.append(said())
done("\\n".join(told))
"""


NO_STYLE = "filter.StyleFiles = ['/nowhere/style.png']  # Apply"
"""Begins again, and ends before it learns."""


@pytest.mark.parametrize(
    "what", nightly([NO_STYLE, "filter.Views = 13  # Apply", "filter.TakeWhatIsShownNow()"], NO_STYLE)
)
def test_a_failed_filter_waits_until_the_user_asks(gui: Callable, what: str) -> None:
    *waiting, last = gui(SCRIPT.replace("WHAT", what)).first.split("\n")
    assert len(waiting) == 5 and len(set(waiting)) == 1
    assert waiting[0] == (
        "There is no transfer function: show the filter's input in the active view with the representation Volume, and "
        "then press Take What Is Shown Now."
    )
    if what == NO_STYLE:
        assert "There is no style picture /nowhere/style.png" in last, last
        return
    assert "regions, learned from" in last and "The transfer function is ParaView's default" in last, last
    assert "edit it in the Color Map Editor, and then press Take What Is Shown Now." in last


@pytest.mark.slow
def test_the_button_that_is_advised_updates_a_filter_that_no_view_shows(gui: Callable, tmp_path: Path) -> None:
    window = Window(gui(f"import os\nos.chdir({str(tmp_path)!r})\n{LISTENER}"), tmp_path)
    before, _ = SCRIPT.split("told = [said()]")
    window.do(f"{before}\nHide(filter, view)\ntold = said()")
    assert "press Take What Is Shown Now" in window.do("answer = told")
    window.do("display.SetRepresentationType('Volume'); ColorBy(display, ('POINTS', 'RTData')); Render(view)")
    window.do("filter.TakeWhatIsShownNow()")
    window.until("filter.UpdatePropertyInformation() or 'regions, learned from' in filter.Status")
