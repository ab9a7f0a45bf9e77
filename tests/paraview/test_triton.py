"""The torch that pip installs on Linux includes triton, whose LLVM has to coexist with the one that Mesa uses."""

from __future__ import annotations

import importlib.util
import os
import sys
from pathlib import Path

import pytest
from filter_script import VOLUME  # type: ignore[import-not-found]

from svv.pv.launch import programs

TESTS = Path(__file__).resolve().parents[1]

FLOW = """
import numpy as np
folder = sys.argv[1]
volume, display = shown()
display.ScalarOpacityUnitDistance = 2.5
GetOpacityTransferFunction("RTData").Points = [37, 0, 0.5, 0, 200, 0, 0.5, 0, 220, 1, 0.5, 0, 277, 1, 0.5, 0]  # little
Render()
SaveScreenshot(folder + "/shown.png", ImageResolution=[64, 64])
views = small(StyleRFViews(Input=volume, TestViews=2, Folder=folder + "/views"))
dimensions, arrays = image(views)
assert dimensions == (64, 64, 1), status(views)
train = StyleRFTrain(Input=views, Preset="draft", Settings=FEW)
train.UpdatePipeline()
assert scene(train) is not None, status(train)
edit = StyleRFEdit(Input=train, Region0Recolour=1, Region0Colour=[0.8, 0.1, 0.1])
edit.UpdatePipeline()
edit.Region0Opacity = 0.5
edit.UpdatePipeline()
said = []
for press in (edit.UndoEdit, edit.RedoEdit, edit.ResetEdits):
    press()
    said.append((edit.Region0Opacity, edit.Region0Recolour))
assert said == [(1.0, 1), (0.5, 1), (1.0, 0)], said
paint = StyleRFStylize(Input=edit, StyleFiles=["gallery:woodcut"], Preset="draft")
paint.UpdatePipeline()
assert status(paint).startswith("Painted in"), status(paint)
assert OutputPort(paint, 1).GetDataInformation().GetNumberOfPoints() > 1, "no picture with its mask"
render = StyleRFRender(Input=paint, ImageSize=[40, 30], Frame=90)
dimensions, arrays = image(render)
assert dimensions == (40, 30, 1) and arrays["RGBA"].dtype == np.uint8, status(render)
render.Frame = 20
assert not np.array_equal(image(render)[1]["RGBA"], arrays["RGBA"]), "the orbit stands still"
Show(render, CreateView("RenderView"))
Render()
SaveData(folder + "/painted.svv", proxy=paint)
again = OpenDataFile(folder + "/painted.svv")
again.UpdatePipeline()
assert scene(again) == scene(paint), status(again)
read = OpenDataFile(folder + "/views/transforms_train.json")
assert image(read)[0] == (64, 64, 1), status(read)
palette = StyleRFPalette(Input=train, ViewsFile=folder + "/views/transforms_train.json", Preset="draft",
                         Colour0Add=1, Colour0Value=[0.1, 0.9, 0.1])
palette.UpdatePipeline()
assert "trained in" in status(palette), status(palette)
view = small(StyleRFStylizedView(Input=volume, StyleFiles=["gallery:impasto"], Preset="draft", Settings=FEW))
view.ImageSize = [40, 30]
assert image(view)[0] == (40, 30, 1), status(view)
import triton
"""

BOTH_LLVM = """
maps = open("/proc/self/maps").read()
assert "libtriton.so" in maps, "triton was not loaded, so nothing was tested"
assert "libLLVM" in maps, "nothing was rendered with Mesa's LLVM, so nothing was tested"
"""


@pytest.fixture(scope="module")
def triton(
    paraview: programs.ParaView, environ: dict[str, str], tmp_path_factory: pytest.TempPathFactory
) -> dict[str, str]:
    """The variables with which ParaView's Python finds triton too."""
    folder = tmp_path_factory.mktemp("triton")
    places = [programs.environment_folder(paraview) / "triton"]
    if paraview.python == sys.version_info[:2]:
        spec = importlib.util.find_spec("triton")
        places += [Path(place) for place in (spec.submodule_search_locations or [])] if spec else []
    for place in places:
        if place.is_dir():
            for part in (place, *place.parent.glob("triton-*.dist-info")):  # its back ends are entry points
                (folder / part.name).symlink_to(part.resolve())
            return {
                "PYTHONPATH": os.pathsep.join([environ["PYTHONPATH"], str(folder)]),
                "TRITON_CACHE_DIR": str(tmp_path_factory.mktemp("cache")),
                "TRITON_INTERPRET": "0",  # which other tests ask for
            }
    pytest.skip(f"no triton for Python {'.'.join(map(str, paraview.python))}, so none is loaded")


@pytest.mark.slow
def test_the_whole_flow_outlives_triton_after_rendering(pvpython, triton: dict[str, str], tmp_path: Path) -> None:
    pvpython(VOLUME + FLOW + BOTH_LLVM, tmp_path, environ=triton, timeout=900)


@pytest.mark.slow
@pytest.mark.parametrize(
    "order",
    [("render", "compile", "render"), ("compile", "render", "compile")],
    ids="-".join,
)
def test_kernels_for_a_gpu_are_compiled_whatever_came_first(pvpython, triton: dict[str, str], order) -> None:
    # What `Device: cuda` needs of triton, as far as it can be had without a GPU: machine code.
    done = pvpython(
        f"sys_path, order = {str(TESTS)!r}, {order!r}\n"
        + VOLUME
        + """
import svv.pv
sys.path.append(sys_path)
def render():
    shown()
    Render()
def compile():
    import shutil, compiled_kernels as tests
    shutil.rmtree(os.environ["TRITON_CACHE_DIR"], ignore_errors=True)
    tests.KERNELS, tests.NETWORKS = [k for k in tests.KERNELS if k[0] == "harmonics"], []
    tests.compile_all((tests.HOPPER,))
for step in order:
    globals()[step]()
"""
        + BOTH_LLVM,
        environ=triton,
    )
    assert done.stdout.count("harmonics ") == order.count("compile")
