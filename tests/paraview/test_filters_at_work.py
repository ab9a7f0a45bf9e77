"""The filters in the real ParaView: when aborted, used together, without torch, and on a server."""

from __future__ import annotations

import pytest
from filter_script import VOLUME  # type: ignore[import-not-found]


def test_stopping_keeps_what_was_there_before(pvpython, tmp_path) -> None:
    result = pvpython(
        VOLUME
        + """
volume, display = shown()
train = trained(volume)
first = scene(train)
algorithm = train.GetClientSideObject()
def stop(*_):
    if algorithm.GetProgress() > 0.3:
        algorithm.SetAbortExecute(1)
tag = algorithm.AddObserver("ProgressEvent", stop)
train.Seed = 1
train.UpdatePipeline()
print("SAID", status(train))
assert scene(train) == first
algorithm.RemoveObserver(tag)
train.Seed = 2
train.UpdatePipeline()
assert scene(train) not in (first, None)
""",
    )
    assert "SAID Stopped" in result.stdout


@pytest.mark.slow
def test_two_trainings_at_once_and_what_is_deleted_meanwhile(pvpython) -> None:
    result = pvpython(
        VOLUME
        + """
volume, display = shown()
one, two = (small(StyleRFTrain(Input=volume, Preset="draft", Settings=FEW, Seed=seed)) for seed in (0, 1))
image = StyleRFRender(Input=one, ImageSize=[40, 40])
said = []
def meanwhile(*_):
    if not said and one.GetClientSideObject().GetProgress() > 0.3:
        said.append("")  # handled once
        two.UpdatePipeline()
        said.append(status(two))
        Delete(display)
        Delete(volume)
one.GetClientSideObject().AddObserver("ProgressEvent", meanwhile)
one.UpdatePipeline()
print("SAID two:", said[1])
print("SAID one:", status(one))
first = scene(one)
assert first is not None
two.UpdatePipeline()
Delete(one)
image.UpdatePipeline()
print("SAID image:", status(image))
""",
    )
    said = dict(line[5:].split(": ", 1) for line in result.stdout.splitlines() if line.startswith("SAID "))
    assert "StyleRFTrain is at work" in said["two"] and "regions" in said["one"], said
    assert "pixels" in said["image"] or "no scene" in said["image"], said
    assert "Traceback" not in result.stderr


def test_without_torch_a_filter_says_what_to_do(pvpython, tmp_path) -> None:
    (tmp_path / "torch.py").write_text("raise ImportError('no torch here', name='torch')")
    result = pvpython(
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        + VOLUME
        + """
volume, display = shown()
train = trained(volume)
print("SAID", status(train))
""",
        tmp_path,
        own=True,
    )
    assert "SAID torch is missing in ParaView's Python" in result.stdout
    assert "Traceback" not in result.stderr


@pytest.mark.slow
def test_a_server_learns_what_the_client_shows(pvpython, pvserver) -> None:
    pvpython(
        VOLUME
        + """
Connect("127.0.0.1", int(sys.argv[1]))
volume, display = shown()
train = trained(volume)
first = scene(train)
assert train.TransferFunction is not None and first is not None, status(train)
lut = GetColorTransferFunction("RTData")
lut.RGBPoints = [*lut.RGBPoints[:1], 1.0, 0.0, 0.0, *lut.RGBPoints[4:]]
train.TakeAsEdited()
train.UpdatePipeline()
assert scene(train) != first, "the client's edit did not reach the server"
""",
        pvserver,
    )


@pytest.mark.slow
def test_the_image_of_a_server_follows_the_client_s_camera(pvpython, pvserver, tmp_path) -> None:
    from tests.cube import cube_scene

    cube_scene().save(tmp_path / "scene.svv")
    pvpython(
        VOLUME
        + """
Connect("127.0.0.1", int(sys.argv[1]))
volume, display = shown()
view = GetActiveView()
render = StyleRFRender(Input=StyleRFScene(FileName=sys.argv[2]), FollowCamera=1)
render.UpdatePipeline()
Render(view)
assert len(GetRenderViews()) == 2, "no view was made for the image"
view.GetActiveCamera().SetPosition(0.0, 90.0, 1.0)
view.GetInteractor().InvokeEvent("EndInteractionEvent")
assert list(render.Camera[:3]) == [0.0, 90.0, 1.0] and max(image(render)[0]) == 800
""",
        pvserver, tmp_path / "scene.svv",
    )  # fmt: skip
