"""Tasks of a chart's processes, which receive them on standard input."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from svv_bench.chart.plan import Training

Content = dict[str, Any]
"""JSON that one of our processes writes for another; a missing key is therefore a defect, not bad input."""


@dataclass(frozen=True)
class TrainTask:
    """A task to train a scene."""

    folder: Path
    """Folder of the run, for the scene and its figures."""
    views: Path
    run: Training

    def to_json(self) -> Content:
        """Return the task with the name of its work."""
        return {"work": "train", "folder": str(self.folder), "views": str(self.views), "run": asdict(self.run)}

    @classmethod
    def from_json(cls, content: Content) -> TrainTask:
        """Restore a task from the result of :meth:`to_json`."""
        return cls(Path(content["folder"]), Path(content["views"]), Training(**content["run"]))


@dataclass(frozen=True)
class RenderTask:
    """A task to render unseen views of a trained scene and score them."""

    folder: Path
    """Folder of the run, with its scene."""
    views: Path
    file: str
    """Name of the file for the figures, in the folder."""
    size: int
    """Width of the rendered views in pixels."""
    test: int
    """Number of views."""
    network: str
    device: str
    volume: Path | None
    """Volume from which the truth is drawn; None if the views' test split is the truth."""

    def to_json(self) -> Content:
        """Return the task with the name of its work."""
        paths = {"folder": str(self.folder), "views": str(self.views)}
        return {"work": "render", **asdict(self), **paths, "volume": self.volume and str(self.volume)}

    @classmethod
    def from_json(cls, content: Content) -> RenderTask:
        """Restore a task from the result of :meth:`to_json`."""
        values = {name: content[name] for name in ("file", "size", "test", "network", "device")}
        volume = None if content["volume"] is None else Path(content["volume"])
        return cls(Path(content["folder"]), Path(content["views"]), **values, volume=volume)
