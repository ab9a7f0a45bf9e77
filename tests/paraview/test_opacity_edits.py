"""Opacities edited in the colour map editor: at once, where a scene knows its volume's values, and else a sentence."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from filter_script import VOLUME  # type: ignore[import-not-found]

from svv.io.pictures.output import write_png

EDIT = """
from vtkmodules.util.numpy_support import vtk_to_numpy
NOW, SINCE = "The opacities are those of the transfer function", "The transfer function has been edited since"
MORE = FEW + "; recolour.iterations=250"  # until all colours are learned
points = GetOpacityTransferFunction("RTData")
def edited(opacity, start=200):
    points.Points = [37, 0, 0.5, 0, start, 0, 0.5, 0, 220, opacity, 0.5, 0, 277, opacity, 0.5, 0]

def drawn(filter):
    return image(filter)[1]["RGBA"].astype(int)

def differ(one, other):
    return float(np.abs(one - other).mean())
"""

WORK = """
import numpy as np
from svv.job import request
counted = []
def counting(module, name):
    plain = getattr(module, name)
    setattr(module, name, lambda *given, **more: (counted.append(name), plain(*given, **more))[1])
counting(request, "train_scene")
counting(request, "stylize_scene")
volume, display = shown()
"""


@pytest.fixture
def brush(tmp_path: Path) -> Path:
    """A picture to paint with."""
    noise = np.random.default_rng(3).random((48, 48, 3), np.float32)
    write_png(tmp_path / "brush.png", noise)
    return tmp_path / "brush.png"


@pytest.mark.slow
def test_opacities_are_shown_at_once_and_what_cannot_be_says_why(pvpython: Callable, brush: Path) -> None:
    pvpython(
        VOLUME
        + WORK
        + EDIT
        + """
train = StyleRFTrain(Input=volume, Preset="draft", Encoding="values", Views=8, ViewSize=64, Settings=MORE)
paint = StyleRFStylize(Input=train, StyleFiles=[sys.argv[1]], Preset="draft", Device="cpu")
plain, painted = StyleRFRender(Input=train, ImageSize=[60, 60]), StyleRFRender(Input=paint, ImageSize=[60, 60])
first, stroked, as_trained = drawn(plain), drawn(painted), scene(train)
assert counted == ["train_scene", "stylize_scene"] and differ(first, stroked) > 1, counted

edited(0.2)
fainter, fainter_paint = drawn(plain), drawn(painted)
assert NOW in status(train), status(train)
assert fainter[..., 3].sum() < 0.8 * first[..., 3].sum() and differ(fainter, first) > 2
assert fainter_paint[..., 3].sum() < 0.9 * stroked[..., 3].sum() and differ(fainter_paint, fainter) > 0.5
assert counted == ["train_scene", "stylize_scene"], "painted or trained again"

# The file that is saved shows what is shown.
paint.SaveFile = sys.argv[1] + ".svv"
paint.SMProxy.InvokeCommand("SaveScene")
from svv.fields.scene.scene import Scene
assert Scene.load(sys.argv[1] + ".svv").made["source"]["tf"]["Points"][9] == 0.2

edited(0.2, start=100)
drawn(plain)
assert SINCE in status(train) and "transparent, so it has no colour for them" in status(train), status(train)
assert status(train).endswith("Take What Is Shown Now trains it again.") and scene(train) == as_trained

edited(1.0)
assert differ(drawn(plain), first) == 0 and differ(drawn(painted), stroked) == 0
assert scene(train) == as_trained and SINCE not in status(train) and NOW not in status(train), status(train)
table = GetColorTransferFunction("RTData")
table.RGBPoints = [*table.RGBPoints[:-3], 0.1, 0.8, 0.2]
drawn(plain)
assert "has other colours" in status(train) and scene(train) == as_trained, status(train)
train.TakeAsEdited()
drawn(plain)
assert counted[-1] == "train_scene" and len(counted) == 3 and SINCE not in status(train), (counted, status(train))

# Features that were learned are changed by the volume, and at once as well.
lattice = small(StyleRFTrain(Input=volume, Preset="draft", Settings=MORE))
paint = StyleRFStylize(Input=lattice, StyleFiles=[sys.argv[1]], Preset="draft", Device="cpu")
plain, painted = StyleRFRender(Input=lattice, ImageSize=[60, 60]), StyleRFRender(Input=paint, ImageSize=[60, 60])
first, stroked, as_trained, known = drawn(plain), drawn(painted), scene(lattice), len(counted)
edited(0.2)
fainter, fainter_paint = drawn(plain), drawn(painted)
assert NOW in status(lattice) and SINCE not in status(lattice), status(lattice)
assert fainter[..., 3].sum() < 0.8 * first[..., 3].sum() and differ(fainter, first) > 2
assert fainter_paint[..., 3].sum() < 0.9 * stroked[..., 3].sum() and differ(fainter_paint, fainter) > 0.5
edited(0.2, start=215)
assert drawn(plain)[..., 3].sum() < fainter[..., 3].sum() and NOW in status(lattice), status(lattice)
edited(0.2, start=60)
drawn(plain)
assert SINCE in status(lattice) and scene(lattice) == as_trained, status(lattice)
edited(1.0)
assert differ(drawn(plain), first) == 0 and differ(drawn(painted), stroked) == 0 and scene(lattice) == as_trained
assert len(counted) == known, "painted or trained again"

# Views tell nothing of the volume.
drawn_views = small(StyleRFViews(Input=volume))
alone = StyleRFTrain(Input=drawn_views, Preset="draft", Settings=FEW)
drawn(StyleRFRender(Input=alone, ImageSize=[60, 60]))
before = scene(alone)
edited(0.3)
alone.UpdatePipeline()
assert scene(alone) == before and NOW not in status(alone), status(alone)
""",
        brush,
    )


@pytest.mark.slow
def test_the_view_in_one_step_shows_them_too(pvpython: Callable, brush: Path) -> None:
    pvpython(
        VOLUME
        + WORK
        + EDIT
        + """
one = small(StyleRFStylizedView(Input=volume, StyleFiles=[sys.argv[1]], Preset="draft", Settings=MORE, Device="cpu",
                                Encoding="values", ImageSize=[60, 60]))
first = drawn(one)
edited(0.2)
fainter = drawn(one)
assert NOW in status(one) and fainter[..., 3].sum() < 0.8 * first[..., 3].sum(), status(one)
edited(0.2, start=100)
assert differ(drawn(one), first) == 0 and SINCE in status(one), status(one)
edited(1.0)
assert differ(drawn(one), first) == 0 and SINCE not in status(one), status(one)
assert counted == ["train_scene", "stylize_scene"], counted
""",
        brush,
    )
