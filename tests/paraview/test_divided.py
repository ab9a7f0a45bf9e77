"""A volume that is divided among the ranks of the real ParaView: drawn as by one process, and never gathered."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from svv.pv.launch.programs import ParaView
from tests.paraview.filter_script import LITTLE, VOLUME
from tests.paraview.stirred_files import write_stirred

SCRIPTS = Path(__file__).resolve().parents[2] / "paraview_scripts"
MEAN = 0.1
"""Largest mean difference in levels of 255, over all pixels; one level is what is promised."""

ONE_SAMPLE = 0.02
"""Largest share of the visible pixels that differ by more than ``FAINT``: the ray caster rounds the positions of
samples, so that one at a seam is sometimes missed or counted twice."""

FAINT, MOST = 4, 40
"""Levels: what rounding explains; and what one sample does, 255 * (1 - 0.6 ** (0.5 / 1.73)) = 35, with shading."""

CREW = """
import json, sys
import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkFiltersCore import vtkPointDataToCellData
from vtkmodules.vtkImagingCore import vtkRTAnalyticSource
from svv.core.colour.shading import Shading
from svv.dvr.parallel.crew import Crew
from svv.dvr.parallel.crew_views import make_crew_views
from svv.dvr.read.grids import put_scalars
from svv.dvr.parallel.ranks import ranks_here
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.draw.views import make_views
from svv.errors import BadInput
from svv.options.making import ViewOptions

TF = TransferFunction(
    ((180, 0.1, 0.3, 0.9), (215, 0.2, 0.9, 0.3), (277, 0.9, 0.2, 0.1)),
    ((180, 0, 0.5, 0), (190, 0.3, 0.5, 0), (205, 0.0, 0.5, 0), (230, 0.02, 0.5, 0), (277, 0.4, 0.5, 0)),
)
ranks = ranks_here()

def wavelet(piece=None, ghosts=0, half=(24, 20, 16)):
    source = vtkRTAnalyticSource()
    source.SetWholeExtent(*(sign * n for n in half for sign in (-1, 1)))
    source.UpdateInformation()
    source.UpdatePiece(*(piece or (0, 1)), ghosts)
    image = vtkImageData()
    image.DeepCopy(source.GetOutput())
    return image

def changed(image, case):
    if case == "on cells":
        filter = vtkPointDataToCellData()
        filter.SetInputData(image)
        filter.Update()
        image.DeepCopy(filter.GetOutput())
    if case == "turned":
        image.SetDirectionMatrix(0.8, -0.6, 0, 0.6, 0.8, 0, 0, 0, 1)
        image.SetSpacing(1.0, 1.3, 0.8)
    if case == "mirrored, whole numbers":
        image.SetDirectionMatrix(-1, 0, 0, 0, 1, 0, 0, 0, 1)
        put_scalars(image, vtk_to_numpy(image.GetPointData().GetScalars()).astype(np.uint16), "RTData")
    return image

def part(case):
    here = ranks.number, ranks.count
    if case == "on the last rank":
        return wavelet() if ranks.number == ranks.count - 1 else None
    if case == "whole on each rank":
        return wavelet()
    return changed(wavelet(here, 2 if case == "with ghosts" else 0), case)
"""

COMPARE = (
    CREW
    + """
FAINT, said = 4, {}
for case in json.loads(sys.argv[2]):
    crew = Crew(ranks, part(case), "RTData")
    if ranks.number:
        crew.serve()
        continue
    projection = "orthographic" if case == "turned" else "perspective"
    options = ViewOptions(n=4, size=96, test=0, projection=projection, step=0.5, mapper="cpu")
    with crew:
        ours, _ = make_crew_views(crew, TF, options, Shading(), "w", lambda *_: None)
    alone, _ = make_views(changed(wavelet(), case), TF, options, shading=Shading(), rescale=False, name="w")
    def levels(images):
        images = images / 1.0
        images[..., :3] *= images[..., 3:] / 255
        return images
    difference = levels(ours.images) - levels(alone.images)
    worst, seen = np.abs(difference).max(axis=3), alone.images[..., 3] > 0
    one, other = ours.classified, alone.classified
    said[case] = {
        "seen": seen.mean(), "mean": np.abs(difference).mean(), "bias": abs(difference[seen].mean()),
        "more": (worst[seen] > FAINT).mean(), "most": worst[seen].max(), "beyond": (worst[~seen] > FAINT).mean(),
        "classified": np.abs(one.exponent.astype(float) - other.exponent.astype(float)).max(),
        "ranges": np.allclose(*([[r.low, r.high, *r.colour] for r in volume.ranges] for volume in (one, other))),
        "owner": (one.owner != other.owner).mean(),
        "grid": ours.meta.grid == alone.meta.grid and ours.meta.bounds == alone.meta.bounds,
        "cameras": all(np.allclose(a.camera_to_world, b.camera_to_world) for a, b in zip(ours.cameras, alone.cameras)),
    }
if ranks.number == 0:
    with open(sys.argv[1], "w") as file:
        json.dump(said, file)
"""
)


@pytest.mark.parametrize(
    ("ranks", "cases"),
    [
        (2, ["as it is", "on the last rank", "mirrored, whole numbers"]),
        pytest.param(
            4, ["as it is", "with ghosts", "whole on each rank", "on cells", "turned"], marks=pytest.mark.slow
        ),
    ],
    ids=["2", "4"],
)
def test_ranks_draw_and_classify_as_one_process(
    paraview: ParaView, mpiexec: Callable, tmp_path: Path, ranks: int, cases: list[str]
) -> None:
    everywhere = [paraview.program("pvbatch"), "--symmetric"]
    mpiexec(COMPARE, tmp_path / "said.json", json.dumps(cases), ranks=ranks, program=everywhere)
    said = json.loads((tmp_path / "said.json").read_text())
    assert list(said) == cases
    for case, found in said.items():
        assert found["seen"] > 0.1 and found["grid"] and found["cameras"], (case, found)
        assert found["mean"] < MEAN and found["most"] <= MOST and found["more"] < ONE_SAMPLE, (case, found)
        assert found["beyond"] < 2e-3, (case, found)  # one process leaves out the outermost pixels of the volume's box
        assert found["bias"] < 0.1, (case, found)  # a seam that is darker or brighter would show here
        assert found["ranges"] and found["classified"] < 1e-2 and found["owner"] < 1e-3, (case, found)


SENT = (
    CREW
    + """
half = (64, 64, 64)
crew = Crew(ranks, wavelet((ranks.number, ranks.count), 0, half), "RTData")
if ranks.number:
    crew.serve()
else:
    from svv.core.geometry.cameras import sphere_cameras
    from svv.dvr.parallel.crew_views import render_crew_views
    with crew:
        render_crew_views(crew, TF, sphere_cameras(3, (0.0, 0.0, 0.0), 300.0, 0.5, 96), Shading(), lambda *_: None)
pieces, sent = ranks.everyones(np.array([crew.piece.values.size], float)), ranks.sent
if ranks.number == 0:
    with open(sys.argv[1], "w") as file:
        json.dump([pieces.ravel().tolist(), sent], file)
"""
)


@pytest.mark.slow
def test_no_rank_gets_the_volume(paraview: ParaView, mpiexec: Callable, tmp_path: Path) -> None:
    """Each has its piece and a layer around it, and what is sent has the size of images."""
    everywhere = [paraview.program("pvbatch"), "--symmetric"]
    mpiexec(SENT, tmp_path / "said.json", ranks=4, program=everywhere)
    pieces, sent = json.loads((tmp_path / "said.json").read_text())
    assert max(pieces) <= 66 * 66 * 129 and len(pieces) == 4
    images = 3 * 96 * 96 * 4 * 2 + 12 * 128 * 128 * 4 * 2  # with those that choose the sample distance
    assert sent < 1.1 * images + 10_000 and sent < 4 * 129**3


VIEWS = (
    VOLUME
    + """
import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
if len(sys.argv) > 2:
    Connect("127.0.0.1", int(sys.argv[2]))
volume, display = shown()
views = small(StyleRFViews(Input=volume, RayCaster="cpu"))
views.UpdatePipeline(2.0)
assert "8 views" in status(views) and "cpu" in status(views), status(views)
np.save(sys.argv[1], vtk_to_numpy(sm.Fetch(views).GetPointData().GetArray("RGBA")))
"""
)
TRAIN = (
    VIEWS
    + """
train = trained(views)
assert scene(train) is not None, status(train)
render = StyleRFRender(Input=train)
assert max(image(render)[0]) == 400, status(render)
"""
)


@pytest.mark.slow
def test_filters_draw_train_and_render_on_ranks_and_on_a_server_with_ranks(
    pvpython: Callable, mpiexec: Callable, start_pvserver: Callable, tmp_path: Path
) -> None:
    pvpython(VIEWS, tmp_path / "1.npy")
    mpiexec(VIEWS, tmp_path / "4.npy", ranks=4)
    pvpython(TRAIN, tmp_path / "2.npy", start_pvserver(ranks=2))
    alone, two, four = (np.load(tmp_path / f"{ranks}.npy").astype(float) for ranks in (1, 2, 4))
    assert (alone[:, 3] > 0).mean() > 0.05
    for pixels in (two, four):
        assert np.abs(pixels - alone).mean() < MEAN and np.abs(pixels - alone).max() <= MOST


TROUBLE = (
    VOLUME
    + """
volume, display = shown()
calculator = Calculator(Input=volume, Function="RTData * sqrt(35 - coordsX - coordsY - coordsZ)", ResultArrayName="bad")
calculator.ReplaceInvalidResults = 0
views = small(StyleRFViews(Input=calculator, TransferFunction=GetColorTransferFunction("RTData")))
views.Scalars = ["POINTS", "bad"]
views.UpdatePipeline()
first = status(views)
views.Scalars, views.RayCaster = ["POINTS", "RTData"], "gpu"
views.UpdatePipeline()
second = status(views)
views.RayCaster = "auto"
views.UpdatePipeline()
print("SAID", json.dumps([first, second, status(views)]))
"""
)


@pytest.mark.slow
def test_trouble_on_any_rank_is_one_sentence_and_the_ranks_work_on(mpiexec: Callable) -> None:
    """The values that are not numbers are on the last rank only."""
    done = mpiexec(TROUBLE)
    (line,) = (line for line in done.stdout.splitlines() if line.startswith("SAID "))
    first, second, third = json.loads(line.removeprefix("SAID "))
    assert "NaN or infinite" in first and "With several ranks, the CPU ray caster" in second and "8 views" in third
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_the_whole_job_runs_on_ranks(mpiexec: Callable, tmp_path: Path) -> None:
    write_stirred(tmp_path)
    arguments = [tmp_path / "volume.vti", "--tf", tmp_path / "tf.json", "--preset", "draft", "--views", 8, "--test", 2]
    arguments += ["--size", 64, "--orbit", 2, "--orbit-size", 48, "--out", tmp_path / "out"]
    mpiexec(LITTLE, SCRIPTS / "stylize_volume.py", *arguments)
    assert json.loads((tmp_path / "out" / "train.json").read_text())["learned_from"] == "volume and views"
    assert (tmp_path / "out" / "report.html").exists() and (tmp_path / "out" / "image.png").exists()
    done = mpiexec(LITTLE, SCRIPTS / "stylize_volume.py", *arguments, "--style", tmp_path / "none.png", check=False)
    assert done.returncode == 2 and "none.png" in done.stderr and "Traceback" not in done.stderr
