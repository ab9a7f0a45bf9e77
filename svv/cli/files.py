"""Scene files that commands read and write, and the checkpoints of interrupted work."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from svv.progress import duration

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene
    from svv.train.run.report import Report


def check_targets(*paths: Path | None) -> None:
    """Check before minutes of work that the results can be written; raises BadInput otherwise."""
    from svv.io.files.atomic import check_writable

    for path in paths:
        if path is not None:
            check_writable(path)


def load(path: Path, device: str = "cpu") -> Scene:
    """Read a scene onto a device; raises BadInput if either is not available."""
    from svv.io.scene_file import read_scene_header

    read_scene_header(path)  # a wrong file is told of before the rest is loaded
    from svv.fields.devices.gpu import device_named
    from svv.fields.scene.scene import Scene

    where = device_named(device)
    return Scene.load(path).on(where)


def finish(scene: Scene, report: Report, out: Path, json: Path | None, checkpoint: Path) -> None:
    """Save a trained scene and the report of its training, then delete the checkpoint."""
    from svv.io.files.atomic import write_json
    from svv.io.scene_file import remove_checkpoints

    scene.save(out)
    if json is not None:
        write_json(json, {**report, "scene_bytes": out.stat().st_size})
    remove_checkpoints(checkpoint, len(scene.layers) + 1)
    total, size = duration(report["seconds"]["total"]), out.stat().st_size / 1e6
    source = f", from {report['learned_from']}" if "learned_from" in report else ""  # paint is not learned from views
    print(f"{out}: {size:.1f} MB, {len(scene.regions)} regions{source}, {total}")
    if sure := report.get("confidence"):
        print("Confidence of the regions: " + ", ".join(f"{k}: {part:.0%}" for k, part in enumerate(sure)))
