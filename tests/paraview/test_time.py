"""Time-dependent data in the real ParaView: the requested time steps, when a scene is trained, and the orbit."""

from __future__ import annotations

import numpy as np
import pytest
from filter_script import VOLUME  # type: ignore[import-not-found]
from time_script import BLOB, SOURCE  # type: ignore[import-not-found]


@pytest.mark.slow
def test_time_passes_and_the_scene_stays_until_it_is_asked_for(pvpython, tmp_path) -> None:
    pvpython(
        SOURCE
        + """
from svv.fields.scene.scene import Scene
made = lambda: Scene.from_bytes(scene(train), "the scene").made
train = small(StyleRFTrain(Input=source, Preset="draft", Settings=FEW))
image = StyleRFRender(Input=train, ImageSize=[40, 30])
view = as_image(image)
assert counted == ["draw_views", "train_scene"], counted
first = scene(train)
animation.UpdateAnimationUsingDataTimeSteps()
assert steps(animation) == times and animation.PlayMode == "Snap To TimeSteps", steps(animation)
assert not hasattr(image, "TimestepValues") and not hasattr(train, "TimestepValues")

asked()
animation.Play()
SaveAnimation(sys.argv[1] + "/time.png", view)
assert set(asked()) == set(times), "a time that is none of the source's"
assert scene(train) == first and len(counted) == 2, "an animation trained"
assert "Trained at time 0; the data is now at 2" in status(train), status(train)
at(animation, 1.5, view)
image.Frame = 40
Render(view)
train.Device = "auto"
Render(view)
assert scene(train) == first, "another frame trained, at another time"
SaveData(sys.argv[1] + "/kept.svv", proxy=train)
assert scene(train) == first and set(asked()) <= set(times)
kept = OpenDataFile(sys.argv[1] + "/kept.svv")
kept.UpdatePipeline()
assert scene(kept) == first
at(animation, 0.0, view)
assert "time" not in status(train), status(train)

at(animation, 1.5, view)
train.TakeAsEdited()
Render(view)
second = scene(train)
assert second != first and made()["time"] == 1.5 and "time" not in status(train), status(train)
train.TakeAsEdited()
Render(view)
assert scene(train) == second, "trained again, though nothing had changed"
source.Script = SCRIPT.replace("14.0", "10.0")  # an Apply further up
Render(view)
third = scene(train)
assert third != second and made()["time"] == 1.5
at(animation, 0.0, view)
assert scene(train) == third
train.Seed = 1
Render(view)
assert scene(train) != third and made()["time"] == 0.0
assert counted == ["draw_views", "train_scene"] * 4, counted
""",
        tmp_path,
    )


@pytest.mark.slow
def test_an_image_stays_in_its_view_when_the_view_has_it_made_anew(pvpython, tmp_path) -> None:
    done = pvpython(
        VOLUME
        + """
wavelet, display = shown()
views = small(StyleRFViews(Input=wavelet, Folder=sys.argv[1] + "/views"))
view = CreateView("RenderView")
view.ViewSize = [60, 60]
Show(views, view)
Render(view)
before, kept = status(views), views.KeptAs
views.Views = 9
Render(view)
assert before.startswith("8 views") and status(views).startswith("9 views"), status(views)
assert views.KeptAs != kept and views.KeptAs == views.GetProperty("Kept").GetElement(0)
""",
        tmp_path,
    )
    assert "no vtkImageData input" not in done.stderr  # what ParaView says of a display without its data


def test_each_time_step_is_trained_once_where_that_is_wished(pvpython, tmp_path) -> None:
    pvpython(
        SOURCE
        + """
train = small(StyleRFTrain(Input=source, Preset="draft", Settings=FEW, TrainEachTimeStep=1))
train.UpdatePipeline(0.0)
scenes = {0.0: scene(train)}
for time in (0.5, 1.0):
    train.UpdatePipeline(time)
    scenes[time] = scene(train)
assert len(set(scenes.values())) == len(counted) / 2 == 3, counted
for time in (0.5, 1.0, 0.0, 1.0):
    train.UpdatePipeline(time)
    assert scene(train) == scenes[time], f"another scene at {time}"
    assert "time" not in status(train), status(train)
train.TrainEachTimeStep = 0
train.UpdatePipeline(0.0)
assert scene(train) == scenes[1.0] and "Trained at time 1; the data is now at 0" in status(train), status(train)
assert len(counted) == 6, counted
assert set(asked()) <= {None, *times}
""",
        tmp_path,
    )


@pytest.mark.slow
def test_the_orbit_is_an_animation_at_one_time_of_the_data(pvpython, tmp_path) -> None:
    pvpython(
        SOURCE
        + """
from svv.errors import BadInput
from svv.pv.client.orbit import play_orbit, stop_orbit
try:
    play_orbit()
except BadInput as error:
    assert "nothing to orbit" in str(error)
else:
    raise AssertionError("an orbit around nothing")
filter = small(StyleRFStylizedView(Input=source, Preset="draft", Settings=FEW, ImageSize=[40, 30]))
at(animation, 0.5)
view = as_image(filter)
filter.Frame = 181
Render(view)
assert "Frame must be 0 to 180" in status(filter), status(filter)
filter.Camera = [0, 0, 90, 0, 0, 0, 0, 1, 0, 30]
asked()
play_orbit()
assert not any(filter.Camera[:9])
assert (animation.PlayMode, animation.NumberOfFrames) == ("Sequence", 181)
Hide(filter, view)  # what is hidden is not drawn: all frames at once
frames = []
animation.GoToFirst()
for _ in range(181):
    frames.append(filter.SMProxy.GetProperty("Frame").GetElement(0))
    animation.GoToNext()
assert frames == list(range(181)), frames
Show(filter, view)
play_orbit(filter, 10)
SaveAnimation(sys.argv[1] + "/orbit.png", view, FrameWindow=[0, 3])
assert filter.SMProxy.GetProperty("Frame").GetElement(0) == 60
assert asked() == [] and animation.TimeKeeper.Time == view.ViewTime == 0.5, "the data's time went on"
assert counted == ["draw_views", "train_scene"] and "time" not in status(filter), (counted, status(filter))
stop_orbit()
assert [track.GetXMLName() for track in animation.Cues] == ["TimeAnimationCue"]
assert animation.PlayMode == "Snap To TimeSteps" and steps(animation) == times
animation.GoToFirst()
animation.GoToNext()
assert view.ViewTime == 0.5 and filter.Frame == 60
animation.GoToNext()
assert view.ViewTime == 1.0 and asked() == [0.0, 0.5, 1.0]
assert counted == ["draw_views", "train_scene"], counted
assert "Trained at time 0.5; the data is now at 1" in status(filter), status(filter)
""",
        tmp_path,
    )
    from PIL import Image

    frames = [np.asarray(Image.open(path)) for path in sorted(tmp_path.glob("orbit.*.png"))]
    assert len(frames) == 4
    assert all((one != other).any() for k, one in enumerate(frames) for other in frames[:k])


@pytest.mark.slow
def test_files_with_times(pvpython, tmp_path) -> None:
    pvpython(
        BLOB
        + """
from svv.pv.client.orbit import play_orbit, stop_orbit
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkIOXML import vtkXMLImageDataWriter
os.chdir(sys.argv[1])
os.environ["SVV_CACHE_SIZE"] = "0"  # the two series are of the same data, so views of one would be found for the other
for k in range(3):
    data = vtkImageData()
    data.SetDimensions(16, 16, 16)
    array = numpy_to_vtk(blob(0.5 * k).ravel(), deep=1)
    array.SetName("v")
    data.GetPointData().SetScalars(array)
    writer = vtkXMLImageDataWriter()
    writer.SetDataModeToBinary()
    writer.SetFileName(f"{sys.argv[1]}/blob_{k}.vti")
    writer.SetInputData(data)
    assert writer.Write()
parts = "".join(f'<DataSet timestep="{time}" file="blob_{k}.vti"/>' for k, time in enumerate((0.25, 1.0, 7.5)))
open("blob.pvd", "w").write(f'<VTKFile type="Collection" version="0.1"><Collection>{parts}</Collection></VTKFile>')

for files, expected in (
    ([f"{sys.argv[1]}/blob_{k}.vti" for k in range(3)], [0.0, 1.0, 2.0]),
    (sys.argv[1] + "/blob.pvd", [0.25, 1.0, 7.5]),
):
    reader = OpenDataFile(files)
    animation = as_volume(reader)
    counted.clear()
    views = small(StyleRFViews(Input=reader))
    view = as_image(views)
    animation.UpdateAnimationUsingDataTimeSteps()
    assert steps(animation) == expected, steps(animation)
    first = image(views, time=expected[0])[1]["RGBA"]
    animation.Play()
    SaveAnimation("series.png", view)
    assert counted == ["draw_views"], counted
    words = f"Drawn at time {expected[0]:g}; the data is now at {expected[2]:g}: Take What Is Shown Now draws "
    words += "them again."
    assert status(views).endswith(words), status(views)
    views.ShownView = 3
    other = image(views, time=expected[2])[1]["RGBA"]
    assert counted == ["draw_views"] and (other != first).any()
    play_orbit(views)
    assert animation.NumberOfFrames == 8
    stop_orbit()
    views.TakeAsEdited()
    taken = image(views, time=expected[2])[1]["RGBA"]
    assert counted == ["draw_views"] * 2 and (taken != other).any() and "time" not in status(views), status(views)
    for proxy in (views, reader):
        Delete(proxy)
    del views, reader
""",
        tmp_path,
    )


@pytest.mark.slow
def test_training_follows_views_that_were_drawn_again(pvpython, tmp_path) -> None:
    pvpython(
        SOURCE
        + """
views = small(StyleRFViews(Input=source))
train = StyleRFTrain(Input=views, Preset="draft", Settings=FEW)
train.UpdatePipeline(0.0)
first = scene(train)
train.UpdatePipeline(1.0)
assert scene(train) == first and counted == ["draw_views", "train_scene"], counted
views.TakeAsEdited()
train.UpdatePipeline(1.5)
assert scene(train) != first and counted == ["draw_views", "train_scene"] * 2, counted
""",
        tmp_path,
    )


@pytest.mark.slow
def test_what_looks_at_a_view_looks_at_its_time(pvpython, tmp_path) -> None:
    pvpython(
        SOURCE
        + """
from pathlib import Path
from svv.fields.scene.scene import Scene
from svv.pv import scripts
from svv.pv.work.vtk_data import time_of
from svv.pv.display.linked_camera import follow, stop_following
at(animation, 1.5)
SaveState(sys.argv[1] + "/state.pvsm")
ResetSession()
display, view = scripts.open_volume(Path(sys.argv[1] + "/state.pvsm"))
assert time_of(scripts.shown_volume(display).data) == 1.5
GetAnimationScene().AnimationTime = 1.0
train = small(StyleRFTrain(Input=display.Input, Preset="draft", Settings=FEW))
follow(StyleRFRender(Input=train), view)
assert counted == ["draw_views", "train_scene"] and Scene.from_bytes(scene(train), "the scene").made["time"] == 1.0
stop_following()
""",
        tmp_path,
    )


@pytest.mark.slow
def test_a_scene_of_values_follows_the_time_without_training(pvpython, tmp_path) -> None:
    pvpython(
        SOURCE
        + """
from svv.fields.scene.scene import Scene
middle = lambda proxy: np.mean(Scene.from_bytes(scene(proxy), "the scene").info()["bounds"], axis=0)[0]
train = small(StyleRFTrain(Input=source, Preset="draft", Settings=FEW, Encoding="values"))
image = StyleRFRender(Input=train, ImageSize=[40, 30])
view = as_image(image)
animation.UpdateAnimationUsingDataTimeSteps()
at(animation, 0.0, view)
first = middle(train)
for time in (1.0, 1.5, 0.5):
    at(animation, time, view)
    assert abs(middle(train) - first - 4 * time) < 1.1, (time, first, middle(train))
    assert f"Followed to time {time:g}." in status(train), status(train)
at(animation, 0.0, view)
assert abs(middle(train) - first) < 1e-6
assert counted == ["draw_views", "train_scene"], counted
""",
        tmp_path,
    )


@pytest.mark.slow
def test_paint_moves_with_the_matter_while_time_is_played(pvpython, tmp_path) -> None:
    pvpython(
        SOURCE
        + """
from svv.io.pictures.output import write_png
from svv.job.moving import Moving
write_png(sys.argv[1] + "/style.png", np.random.default_rng(0).random((64, 64, 3)).astype(np.float32))
asked_for, plain = {}, Moving.matter
Moving.matter = lambda self, image, time: asked_for.setdefault(time, plain(self, image, time))
filter = small(StyleRFStylizedView(Input=source, Preset="draft", Settings=FEW, Encoding="values", ImageSize=[40, 30],
                                   RayCaster="cpu", StyleFiles=[sys.argv[1] + "/style.png"]))
view = as_image(filter)
animation.UpdateAnimationUsingDataTimeSteps()
at(animation, 0.0, view)
assert not asked_for, asked_for
for time in (0.5, 1.0, 0.5):
    at(animation, time, view)
    assert f"Followed to time {time:g}." in status(filter), status(filter)
assert sorted(asked_for) == [0.5, 1.0], asked_for
for time, place in asked_for.items():
    moved = (place(here := np.array([[4.0 + 4.0 * time, 8.0, 8.0]])) - here)[0]
    assert abs(moved[0] + 4.0 * time) < 1.5 and np.abs(moved[1:]).max() < 0.7, (time, moved)
""",
        tmp_path,
    )


@pytest.mark.slow
def test_what_appears_while_time_is_played_is_painted(pvpython, tmp_path) -> None:
    """A ball is there from the fourth time on: it gets strokes, which are there again when it is played again."""
    pvpython(
        SOURCE
        + """
from svv.fields.strokes.flocks import FAR, Flocks
from svv.io.pictures.output import write_png
from svv.styles.gallery import gallery_picture
write_png(sys.argv[1] + "/style.png", gallery_picture("impasto"))
begun, plain = [], Flocks.__init__
Flocks.__init__ = lambda self, *given: (begun.append(self), plain(self, *given))[1]
moving, later = "(x - 4 - 4 * shown)", "+ (shown > 1.0) * np.exp(-((x - 11) ** 2 + (y - 8) ** 2 + (z - 8) ** 2) / 8.0)"
source.Script = SCRIPT.replace(moving, "(x - 4 - 0.2 * shown)").replace(".astype(np.float32)", later).replace(
    "numpy_to_vtk(values", "numpy_to_vtk(values.astype(np.float32)").replace("/ 14.0)", "/ 8.0)")
filter = small(StyleRFStylizedView(Input=source, Preset="draft", Settings=FEW, Encoding="values", ImageSize=[40, 30],
                                   RayCaster="cpu", StyleFiles=[sys.argv[1] + "/style.png"]))
view = as_image(filter)
animation.UpdateAnimationUsingDataTimeSteps()
at(animation, 0.0, view)
shown = {}
for time in [*times[1:], 1.0, 1.5, 2.0]:
    at(animation, time, view)
    assert f"Followed to time {time:g}." in status(filter), status(filter)
    seen = image(filter, time=time)[1]["RGBA"]
    assert np.array_equal(shown.setdefault(time, seen), seen), time
(flocks,) = begun
assert flocks._times == times and flocks.painted == 0.0
every = flocks.lives()
assert (np.concatenate([lives.own[:, 1] for lives in every]) > FAR + 4).mean() > 0.8, "hardly anything has gone"
born = [lives for lives in every if lives.born is not None]
assert np.concatenate([lives.when[:, 0] for lives in born]).min() == FAR + 3
places = np.concatenate([lives.born.where[:, 0] for lives in born])
# The values of the new ball add to those of the other, whose front bulges: a stroke may be born there, too.
assert (places > 0.4).mean() > 0.98, f"{(places <= 0.4).sum()} of {len(places)} points do not lie on the new ball"
""",
        tmp_path,
    )
