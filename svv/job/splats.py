"""A scene written as Gaussian splats, for the command, ParaView's *Save Data* and assistants alike."""

from __future__ import annotations

from pathlib import Path

from svv.errors import Progress, part, silent
from svv.fields.scene.scene import Scene
from svv.io.files.atomic import check_writable
from svv.options.splats import SplatOptions
from svv.render.splats.files import check_name, write_splats
from svv.train.splats.fit import fit_splats


def export_splats(path: Path, scene: Scene, options: SplatOptions, progress: Progress = silent) -> str:
    """Fit splats to a scene and write them; return their number, degree and bytes, and what to know of the file.

    Raises BadInput as :func:`svv.fit_splats` and :func:`svv.write_splats`, before the work if the file cannot be
    written.
    """
    check_name(path)
    check_writable(path)
    splats = fit_splats(scene, options, part(progress, 0.0, 0.97))
    notes = write_splats(path, splats, part(progress, 0.97, 1.0))
    if scene.steps is not None and len(scene.steps) > 1:
        shown = scene.steps.times[scene.steps.own]
        notes.append(f"They show the scene at time {shown:g}; svv follow --out FOLDER writes one scene for each time.")
    degree = {1: 0, 4: 1, 9: 2, 16: 3}[splats.harmonics.shape[1]]
    return " ".join([f"{len(splats)} splats of degree {degree}, {path.stat().st_size / 1e6:.1f} MB.", *notes])
