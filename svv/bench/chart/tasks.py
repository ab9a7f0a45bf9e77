"""What a process of a chart is asked to do, as it goes to its standard input."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from svv.bench.chart.plan import Training

Content = dict[str, Any]
"""JSON. One process of ours writes it for another one, so a key that is missing is a defect and no bad input."""


@dataclass(frozen=True)
class TrainTask:
    """Train a scene."""

    folder: Path
    """Of the run: for the scene and its figures."""
    views: Path
    run: Training

    def to_json(self) -> Content:
        """With the name of the work."""
        return {"work": "train", "folder": str(self.folder), "views": str(self.views), "run": asdict(self.run)}

    @classmethod
    def from_json(cls, content: Content) -> TrainTask:
        """The inverse of :meth:`to_json`."""
        return cls(Path(content["folder"]), Path(content["views"]), Training(**content["run"]))


@dataclass(frozen=True)
class RenderTask:
    """Render unseen views of a trained scene, and score them."""

    folder: Path
    """Of the run, with its scene."""
    views: Path
    file: str
    """Name in the folder, for the figures."""
    size: int
    """Width of the rendered views, pixels."""
    test: int
    """Number of views."""
    network: str
    device: str
    volume: Path | None
    """The truth is drawn of it; None: the views' test split is the truth."""

    def to_json(self) -> Content:
        """With the name of the work."""
        paths = {"folder": str(self.folder), "views": str(self.views)}
        return {"work": "render", **asdict(self), **paths, "volume": self.volume and str(self.volume)}

    @classmethod
    def from_json(cls, content: Content) -> RenderTask:
        """The inverse of :meth:`to_json`."""
        values = {name: content[name] for name in ("file", "size", "test", "network", "device")}
        volume = None if content["volume"] is None else Path(content["volume"])
        return cls(Path(content["folder"]), Path(content["views"]), **values, volume=volume)
