"""The torch that pip gives every Linux user brings triton, whose LLVM has to live beside the one that Mesa uses."""

from __future__ import annotations

import importlib.util
import os
import sys
from pathlib import Path

import pytest
from filter_script import VOLUME  # type: ignore[import-not-found]

from svv.pv import start

TESTS = Path(__file__).resolve().parents[1]

BOTH_LLVM = """
maps = open("/proc/self/maps").read()
assert "libtriton.so" in maps, "triton was not loaded, so nothing was tested"
assert "libLLVM" in maps, "nothing was rendered with Mesa's LLVM, so nothing was tested"
"""


@pytest.fixture(scope="module")
def triton(
    paraview: start.ParaView, environ: dict[str, str], tmp_path_factory: pytest.TempPathFactory
) -> dict[str, str]:
    """The variables with which ParaView's Python finds triton too."""
    folder = tmp_path_factory.mktemp("triton")
    places = [start.environment_folder(paraview) / "triton"]
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
            }
    pytest.skip(f"no triton for Python {'.'.join(map(str, paraview.python))}, so none is loaded")


def test_a_painting_survives_triton_after_rendering(pvpython, triton: dict[str, str]) -> None:
    done = pvpython(
        VOLUME
        + """
volume, display = shown()
Render()
SaveScreenshot(tempfile.mkdtemp() + "/shown.png", ImageResolution=[64, 64])
train = trained(volume)
assert scene(train) is not None, status(train)
edit = StyleRFEdit(Input=train, Region0Opacity=0.5)
paint = StyleRFStylize(Input=edit, StyleFiles=["gallery:woodcut"], Preset="draft")
paint.UpdatePipeline()
dimensions, arrays = image(StyleRFRender(Input=paint, ImageSize=[40, 30]))
import triton
"""
        + BOTH_LLVM
        + """
print("SAID", status(paint), dimensions, arrays["RGBA"].shape)
""",
        environ=triton,
    )
    assert "SAID Painted in" in done.stdout
    assert "(40, 30, 1) (1200, 4)" in done.stdout


@pytest.mark.parametrize("order", [("render", "compile", "render"), ("compile", "render", "compile")], ids="-".join)
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
    import shutil, test_fused_compiles as tests
    shutil.rmtree(os.environ["TRITON_CACHE_DIR"], ignore_errors=True)
    tests.KERNELS, tests.NETWORKS = [k for k in tests.KERNELS if k[0] == "harmonics"], []
    tests.compile_all()
for step in order:
    globals()[step]()
"""
        + BOTH_LLVM,
        environ=triton,
    )
    assert done.stdout.count("harmonics ") == order.count("compile")
