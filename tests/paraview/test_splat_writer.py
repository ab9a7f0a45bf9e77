"""ParaView's *Save Data* writes a scene as Gaussian splats."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import svv
from tests.cube import cube_scene
from tests.paraview.filter_script import VOLUME


def test_save_data_writes_splats(pvpython: Callable[..., str], tmp_path: Path) -> None:
    """With the options of the panel, and the edits of the filters before it."""
    cube_scene().save(tmp_path / "cube.svv")
    pvpython(
        VOLUME
        + """
scene = OpenDataFile(sys.argv[1] + "/cube.svv")
scene.UpdatePipeline()
edit = StyleRFEdit(Input=scene, Region0Hide=1)
SaveData(sys.argv[1] + "/cube.ply", proxy=edit, Splats=300, Steps=3, Degree="1")
""",
        tmp_path,
    )
    splats = svv.read_splats(tmp_path / "cube.ply")
    assert 100 < len(splats) <= 300 and splats.harmonics.shape[1] == 4
    assert 0 not in splats.regions and len(splats.names) > 1
