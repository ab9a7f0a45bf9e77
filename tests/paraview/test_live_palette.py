"""StyleRF Palette as the window has it: its regions are trained in a process of its own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.paraview.live_script import LIVE

TRAINED = """
def reached(filter, word):
    return until(filter, lambda told: word in told)

def unfinished(filter):
    return bool(sm.Fetch(filter).GetFieldData().HasArray("StyleRF Unfinished"))

def regions(filter):
    return sm.Fetch(filter).GetNumberOfRows()

bumps = [(37, 0), (110, 0), (120, 0.2), (130, 0), (200, 0), (220, 1), (277, 1)]
GetOpacityTransferFunction("RTData").Points = [v for x, y in bumps for v in (x, y, 0.5, 0)]
views = StyleRFViews(Input=wavelet, Views=8, ViewSize=64)
train = StyleRFTrain(Input=views, Preset="draft", Settings=FEW["Settings"], Device="cpu")
train.UpdatePipeline()
whole = regions(train)
assert whole > 1, whole
"""


@pytest.mark.slow
@pytest.mark.parametrize("source", ["the filter", "a file"])
def test_palette_trains_beside_the_window(pvpython: Callable, tmp_path: Path, source: str) -> None:
    pvpython(
        f"""{LIVE}{TRAINED}
if {source == "a file"}:
    file = f"{{folder}}/views/transforms_train.json"
    views.Folder = f"{{folder}}/views"
    views.UpdatePipeline()
    given = dict(ViewsFile=file)
else:
    given = dict(Views=views)
palette = StyleRFPalette(Input=train, Preset="draft", Device="cpu", **given)
in_window(palette)
palette.UpdatePipeline()
assert "palette is unchanged" in status(palette) and not unfinished(palette), status(palette)
palette.Merge = "0, 1"
palette.UpdatePipeline()
assert status(palette).startswith("Learning") and "shown as it was" in status(palette), status(palette)
assert regions(palette) == whole and unfinished(palette)
render = StyleRFRender(Input=palette, ImageSize=[64, 64])
assert "still being learned" in (render.UpdatePipeline() or status(render)), status(render)
reached(palette, "as a sketch")
assert regions(palette) == whole - 1 and unfinished(palette)
told = reached(palette, "trained in")
assert "regions 0 and 1 merged" in told and "cache" not in told, told
assert regions(palette) == whole - 1 and not unfinished(palette)
merged = scene(palette)
(worker,) = workers()

# Other corrections take the place of the one that is being trained, and the old result stays until they are there.
palette.Merge, palette.Region0SetColour, palette.Region0Colour = "", 1, [0.1, 0.2, 0.9]
palette.UpdatePipeline()
assert unfinished(palette) and regions(palette) == whole - 1
reached(palette, "as a sketch")
palette.Region0Colour = [0.9, 0.2, 0.1]
palette.UpdatePipeline()
assert "#e6331a" in reached(palette, "trained in"), status(palette)
assert workers() == [worker]
palette.Region7Remove = 1
palette.UpdatePipeline()
reached(palette, "no region 7")
palette.Region7Remove = palette.Region0SetColour = 0
palette.UpdatePipeline()
assert "palette is unchanged" in status(palette) and not news(palette).endswith("*"), news(palette)
last.clear()
Delete(render), Delete(palette)
del render, palette
assert workers() == []

# A script waits, and has the same.
os.environ["SVV_CACHE"] = f"{{folder}}/alone"
waits = StyleRFPalette(Input=train, Preset="draft", Device="cpu", Merge="0, 1", **given)
waits.UpdatePipeline()
assert "trained in" in status(waits) and workers() == [], status(waits)
rows = lambda filter: [sm.Fetch(filter).GetColumnByName("Colour").GetTuple(k) for k in range(regions(filter))]
from svv.fields.scene.scene import Scene
colours = [[region.colour for region in Scene.from_bytes(one, "it").regions] for one in (merged, scene(waits))]
assert colours[0] == colours[1], colours
""",
        tmp_path,
        own=True,
    )
