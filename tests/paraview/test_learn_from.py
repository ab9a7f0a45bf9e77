"""The choice between volume and views, and views only, in the panels of the real ParaView."""

from __future__ import annotations

import pytest
from filter_script import VOLUME  # type: ignore[import-not-found]


@pytest.mark.slow
def test_panels_offer_the_choice_and_say_what_was_learned_from(pvpython) -> None:
    pvpython(
        VOLUME
        + """
volume, display = shown()
views = small(StyleRFViews(Input=volume))
seen = {}
for alone in (0, 1):
    train = StyleRFTrain(Input=views, Preset="draft", Settings=FEW)
    assert train.ViewsOnly == 0, "not the default"
    train.ViewsOnly = alone
    train.UpdatePipeline()
    seen[alone] = status(train), scene(train)
assert "learned from volume and views," in seen[0][0] and "learned from views only," in seen[1][0], seen
assert seen[0][1] != seen[1][1]
whole = small(StyleRFStylizedView(Input=volume, Preset="draft", Settings=FEW, ImageSize=[32, 32], ViewsOnly=1))
image(whole)
assert "views only" in status(whole), status(whole)
for filter in (train, whole, StyleRFPalette(Input=train)):
    choice = filter.SMProxy.GetProperty("ViewsOnly")
    # Since 5.13 a property is as visible as its group, which is an advanced one in Stylized View.
    seen_in = ("default", "advanced") if filter is whole else ("default",)
    assert choice.GetPanelVisibility() in seen_in and choice.GetXMLLabel() == "Views Only", filter
    groups = [filter.SMProxy.GetPropertyGroup(k) for k in range(filter.SMProxy.GetNumberOfPropertyGroups())]
    (group,) = (group for group in groups if group.GetXMLLabel() == "Learn From")
    names = [group.GetPropertyName(k) for k in range(group.GetNumberOfProperties())]
    assert names == ["ViewsOnly", *["IgnoreFixed"] * (filter is train)], names
"""
    )
