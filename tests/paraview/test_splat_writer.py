"""ParaView's *Save Data* writes a scene as Gaussian splats."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import svv
from tests.paraview.filter_script import VOLUME
from tests.solid_ball import solid_ball


def test_save_data_writes_splats(pvpython: Callable[..., str], tmp_path: Path) -> None:
    """With the options of the panel, and the edits of the filters before it."""
    solid_ball().save(tmp_path / "ball.svv")
    pvpython(
        VOLUME
        + """
scene = OpenDataFile(sys.argv[1] + "/ball.svv")
scene.UpdatePipeline()
edit = StyleRFEdit(Input=scene, Region0Name="bone")
SaveData(sys.argv[1] + "/ball.ply", proxy=edit, Splats=300, Steps=3, Degree="1")
""",
        tmp_path,
    )
    splats = svv.read_splats(tmp_path / "ball.ply")
    assert 100 < len(splats) <= 300 and splats.harmonics.shape[1] == 4
    assert splats.names == ("bone",)
