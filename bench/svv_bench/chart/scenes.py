"""The scenes of a chart: folders of views, or volumes from which views are drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from svv.core.geometry.cameras import Camera
from svv.errors import BadInput, Progress
from svv.io.views.view_meta import known
from svv.io.views.viewset import ViewSet, read_meta
from svv.job.source import ViewSource, VolumeSource
from svv.options.making import ViewOptions
from svv_bench.chart.plan import LEAST_VIEWS, Grid, Measure, digest

DRAWN_SIZE = 400
"""Default width of a volume's views in pixels; small because a chart consists of many runs."""


@dataclass(frozen=True)
class ChartScene:
    """A scene with its unique name in the chart."""

    name: str
    source: ViewSource | VolumeSource
    own_width: int | None
    """Width of its views in pixels; None for a volume."""
    own_height: int | None
    """Height of its views in pixels; None for a volume."""

    @property
    def volume(self) -> VolumeSource | None:
        """The volume; None for a folder of views."""
        return self.source if isinstance(self.source, VolumeSource) else None

    def views_key(self, size: int, measure: Measure) -> str:
        """Return a hash of everything that its training views of that width depend on."""
        drawn = {} if self.volume is None else {"n": measure.n, "mapper": measure.mapper}
        return digest({"source": self.source.identity(), "size": size, **drawn})

    def measured_key(self, size: int, measure: Measure) -> str:
        """Return a hash of everything besides the trained scene that the figures at a rendered width depend on."""
        return digest({"size": size, "test": measure.test, "network": measure.network})

    def sizes(self, grid: Grid) -> tuple[int, ...]:
        """Return the widths of its training views in pixels."""
        return self._resolved(grid.sizes, self.own_width or DRAWN_SIZE)

    def render_sizes(self, grid: Grid, size: int) -> tuple[int, ...]:
        """Return the widths in pixels at which a scene trained on views ``size`` pixels wide is rendered."""
        return self._resolved(grid.render_sizes, size)

    def _resolved(self, sizes: Sequence[int | None], default: int) -> tuple[int, ...]:
        chosen = tuple(dict.fromkeys(default if size is None else size for size in sizes))
        for size in chosen:
            if self.own_width is not None and self.own_height is not None:
                if size > self.own_width or self.own_width % size or self.own_height % (self.own_width // size):
                    raise BadInput(
                        f"The views of {self.name} are {self.own_width} x {self.own_height}: they can be shrunk by "
                        f"whole factors, but not to {size} pixels."
                    )
        return chosen

    def views_folder(self, out: Path, size: int, measure: Measure) -> Path:
        """Return the folder of its training views of a width."""
        if isinstance(self.source, ViewSource):
            return self.source.folder
        return out / "views" / f"{self.name}-{size}px-{self.views_key(size, measure)}"

    def drawn(self, out: Path, size: int, measure: Measure) -> bool:
        """Return whether those views exist."""
        return (self.views_folder(out, size, measure) / "transforms_train.json").exists()

    def draw(self, out: Path, size: int, measure: Measure, progress: Progress) -> None:
        """Draw the training views of a volume."""
        assert self.volume is not None
        options = ViewOptions(measure.n, 0, size, measure.mapper)
        self.volume.make_views(self.views_folder(out, size, measure), options, progress)


def read_scenes(sources: Sequence[Path], tfs: Sequence[Path], measure: Measure) -> list[ChartScene]:
    """Return the scenes of a command.

    Args:
        sources: Folders of views with a train and a test split, and volumes.
        tfs: Transfer functions: one per volume in their order, one for all volumes, or none.
        measure: Settings of the measurement, with the number of test views.

    Raises:
        BadInput: A source or transfer function is missing, there are too few test views, or the number of transfer
            functions does not fit the volumes.
    """
    if not sources:
        raise BadInput("Give at least one folder of views, or a volume.")
    volumes = [path for path in sources if not path.is_dir()]
    if len(tfs) not in (0, 1, len(volumes)) or (tfs and not volumes):
        raise BadInput(f"There are {len(volumes)} volumes and {len(tfs)} transfer functions; give one each, or one.")
    scenes: list[ChartScene] = []
    for path in sources:
        if path.is_dir():
            scene = _of_views(path, measure)
        else:
            at = volumes.index(path)
            tf = None if not tfs else tfs[at] if len(tfs) > 1 else tfs[0]
            scene = ChartScene(path.name.split(".")[0], VolumeSource(path, tf), None, None)
            scene.source.identity()  # raises if something is missing
        taken = {other.name for other in scenes}
        names = (scene.name if k == 1 else f"{scene.name}-{k}" for k in range(1, len(sources) + 1))
        scenes.append(replace(scene, name=next(name for name in names if name not in taken)))
    return scenes


def _of_views(folder: Path, measure: Measure) -> ChartScene:
    source = ViewSource(folder)
    source.identity()
    test = ViewSet.read(folder, "test")
    if len(test) < measure.test:
        least = f" (at least {LEAST_VIEWS} are needed)" if len(test) < LEAST_VIEWS else f"; give --test {len(test)}"
        raise BadInput(f"{folder} has {len(test)} test views, not {measure.test}{least}.")
    height, width = test.images.shape[1:3]
    return ChartScene(folder.resolve().name, source, width, height)


def spread_over(count: int, test: int) -> list[int]:
    """Return ``test`` of ``count`` indices, evenly spread, with the first and the last."""
    return [int(i) for i in np.rint(np.linspace(0, count - 1, test))]


def shrunk(views: ViewSet, size: int) -> ViewSet:
    """Shrink views to a width of ``size`` pixels, which must divide theirs, by alpha-weighted means of blocks."""
    factor = views.images.shape[2] // size
    if factor == 1:
        return views
    n, height, width = views.images.shape[:3]
    images = np.empty((n, height // factor, width // factor, 4), np.uint8)
    for image, out in zip(views.images, images):
        blocks = image.reshape(height // factor, factor, width // factor, factor, 4).astype(np.float32)
        alpha = blocks[..., 3:].mean(axis=(1, 3))
        colour = (blocks[..., :3] * blocks[..., 3:]).mean(axis=(1, 3)) / np.maximum(alpha, 1e-6)
        out[...] = np.rint(np.concatenate([colour, alpha], axis=-1))
    cameras = tuple(camera.resized(width // factor, height // factor) for camera in views.cameras)
    return ViewSet(cameras, images, views.names, views.meta)


def unseen_cameras(folder: Path, test: int, size: int) -> list[Camera]:
    """Return test cameras around a volume, given the folder of the views that were drawn of it."""
    from svv.dvr.draw.views import ORBIT, unseen_numbers

    path = known(read_meta(folder).rig, "rig").orbit(ORBIT, size)
    return [path[i] for i in unseen_numbers(test)]
