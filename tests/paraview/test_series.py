"""Scenes with time steps in the real ParaView."""

from __future__ import annotations

from functools import partial

import pytest
from filter_script import VOLUME  # type: ignore[import-not-found]

from svv.dvr.draw.views import make_views
from svv.job.series import Step, with_time_steps
from svv.train.pipeline import train_scene
from tests.test_from_values import SHORT, TWO, moved_ball


@pytest.mark.slow
def test_a_file_with_time_steps_plays_them(pvpython, tmp_path) -> None:
    views, _ = make_views(moved_ball(0.0), TWO, n=12, test=3, size=64, mapper="cpu")
    shifts = (0.0, 0.1, 0.3)
    steps = [Step(str(k), float(k), partial(moved_ball, shift)) for k, shift in enumerate(shifts)]
    scene, _ = with_time_steps(train_scene(views, SHORT)[0], steps)
    scene.save(tmp_path / "series.svv")
    pvpython(
        VOLUME
        + """
from svv.fields.scene.scene import Scene
from svv.pv.display.linked_camera import show_image
reader = OpenDataFile(sys.argv[1] + "/series.svv")
reader.UpdatePipeline()
assert list(reader.TimestepValues) == [0.0, 1.0, 2.0], list(reader.TimestepValues)
edit = StyleRFEdit(Input=reader)
image = StyleRFRender(Input=edit, ImageSize=[40, 30])
view = CreateView("RenderView")
show_image(image, view)
animation = GetAnimationScene()
animation.UpdateAnimationUsingDataTimeSteps()
seen = []
for time in (0.0, 1.0, 2.0, 0.0):
    animation.AnimationTime = time
    Render(view)
    seen.append(Scene.from_bytes(scene(reader), "the scene").info()["bounds"])
    assert f"time step {time:.0f} of 3" in status(reader), status(reader)
assert seen[0] == seen[3]

# Another file's steps are its own, even where its scene lies in memory where the first one's lay.
from svv.pv.filters import readers
readers.id = lambda thing: 0
first = scene(reader)
Scene.load(sys.argv[1] + "/series.svv").edited(0, colour=(0.0, 0.0, 1.0)).save(sys.argv[1] + "/other.svv")
reader.FileName = sys.argv[1] + "/other.svv"
reader.UpdatePipeline(0.0)
assert Scene.from_bytes(scene(reader), "it").regions[0].edited_colour == (0.0, 0.0, 1.0) and scene(reader) != first
""",
        tmp_path,
    )
