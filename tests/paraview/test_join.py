"""Scenes of several transfer functions, made and joined in the real ParaView."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from filter_script import VOLUME  # type: ignore[import-not-found]

from svv.fields.scene.joined import joined, members
from svv.fields.scene.scene import Scene
from tests.cube import cube_camera, cube_scene, lit_cube_scene


@pytest.mark.slow
def test_functions_of_a_volume_are_trained_and_joined(pvpython, tmp_path: Path) -> None:
    """Two filters on one volume: each keeps the transfer function that was shown when it was made."""
    pvpython(
        VOLUME
        + """
volume, display = shown()
outer = trained(volume)
GetOpacityTransferFunction("RTData").Points = [37, 0, 0.5, 0, 120, 0, 0.5, 0, 130, 1, 0.5, 0, 140, 0, 0.5, 0]
inner = trained(volume)
join = StyleRFJoin(Input=[outer, inner], SaveFile=sys.argv[1] + "/both.svv")
join.UpdatePipeline()
assert "regions" in status(join), status(join)
join.SaveScene()
counts = [sm.Fetch(one).GetNumberOfRows() for one in (outer, inner, join)]
assert counts[0] + counts[1] == counts[2], counts
edit = StyleRFEdit(Input=join, Isolate="0")
_, arrays = image(StyleRFRender(Input=edit, ImageSize=[40, 30]))
assert set(arrays["Region"].tolist()) == {-1, 0}
volume = StyleRFVolume(Input=join)
volume.UpdatePipeline()
assert "points" in status(volume), status(volume)
join.Input = [inner]
join.UpdatePipeline()
assert "2 to 8" in status(join), status(join)
json.dump(counts, open(sys.argv[1] + "/counts.json", "w"))
""",
        tmp_path,
        check=True,
    )
    counts = json.loads((tmp_path / "counts.json").read_text())
    whole = Scene.load(tmp_path / "both.svv")
    assert [len(member.regions) for member in members(whole)] == counts[:2]


def test_a_join_is_the_same_as_outside(pvpython, tmp_path: Path) -> None:
    scenes = cube_scene(0), lit_cube_scene()
    for number, scene in enumerate(scenes):
        scene.save(tmp_path / f"{number}.svv")
    pvpython(
        VOLUME
        + """
readers = [OpenDataFile(f"{sys.argv[1]}/{number}.svv") for number in range(2)]
join = StyleRFJoin(Input=readers, SaveFile=sys.argv[1] + "/both.svv")
join.UpdatePipeline()
join.SaveScene()
""",
        tmp_path,
    )
    inside = Scene.load(tmp_path / "both.svv")
    outside = joined([Scene.load(tmp_path / f"{number}.svv") for number in range(2)])
    assert inside.regions == outside.regions
    pictures = [scene.render(cube_camera()).rgba for scene in (inside, outside)]
    np.testing.assert_allclose(pictures[0], pictures[1], atol=2e-3)
