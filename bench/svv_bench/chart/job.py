"""The whole chart: views, runs, table, figures and page; finished parts are not repeated."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from svv.errors import Progress, part
from svv.io.files.atomic import make_folder
from svv.kernels.dispatch import KERNELS_VARIABLE
from svv_bench.chart.plan import Grid, Measure, Rendering, Training, check, trainings
from svv_bench.chart.process import run_apart
from svv_bench.chart.scenes import ChartScene, read_scenes
from svv_bench.chart.table import Row, read_row
from svv_bench.chart.tasks import RenderTask, TrainTask

RENDER_SECONDS = 25.0
"""Rough time of rendering a run's views, from which the remaining time is estimated."""
DRAW_SECONDS = 25.0
"""Rough time of drawing a volume's views, from which the remaining time is estimated."""


@dataclass(frozen=True)
class Step:
    """A unit of work: views to draw (no rendering), a run to train, or a trained run to render."""

    scene: ChartScene
    training: Training
    rendering: Rendering | None
    draw: bool = False

    @property
    def expected(self) -> float:
        """Rough time in seconds."""
        if self.draw:
            return DRAW_SECONDS
        return self.training.expected if self.rendering is None else RENDER_SECONDS


class Chart:
    """The chart in one folder.

    Args:
        sources: Folders of views, and volumes.
        tfs: Transfer functions of the volumes.
        out: Folder of all results; created if missing.
        grid: Settings that are varied.
        measure: How runs are measured.

    Raises:
        BadInput: An error that can be found before the first run.
    """

    def __init__(self, sources: Sequence[Path], tfs: Sequence[Path], out: Path, grid: Grid, measure: Measure) -> None:
        check(grid, measure)
        self.grid, self.measure, self.out = grid, measure, out
        self.scenes = read_scenes(sources, tfs, measure)
        self.steps = [step for scene in self.scenes for step in self._steps(scene)]
        make_folder(out)

    def _steps(self, scene: ChartScene) -> Iterator[Step]:
        sizes = scene.sizes(self.grid)
        keys = {size: scene.views_key(size, self.measure) for size in sizes}
        drawn: set[int] = set()
        for run in trainings(self.grid, scene.name, keys, sizes):
            if scene.volume is not None and run.size not in drawn:
                drawn.add(run.size)
                yield Step(scene, run, None, draw=True)
            yield Step(scene, run, None)
            for size in scene.render_sizes(self.grid, run.size):
                yield Step(scene, run, Rendering(run, size, scene.measured_key(size, self.measure)))

    def folder(self, run: Training) -> Path:
        """Return the folder of a run, for its scene file and its figures."""
        return self.out / "runs" / run.name

    def is_done(self, step: Step) -> bool:
        """Return whether a step has already been done."""
        if step.draw:
            return step.scene.drawn(self.out, step.training.size, self.measure)
        folder = self.folder(step.training)
        name = "train.json" if step.rendering is None else step.rendering.file
        return (folder / name).exists() and (folder / "scene.svv").exists()

    def do(self, progress: Progress) -> int:
        """Do all unfinished steps and return their number."""
        left = [step for step in self.steps if not self.is_done(step)]
        whole, before = sum(step.expected for step in left), 0.0
        for number, step in enumerate(left):
            share = part(progress, before / whole, (before + step.expected) / whole)
            title = f"{number + 1}/{len(left)} {step.training.name.rsplit('-', 1)[0]}"
            self._do(step, _titled(share, title))
            before += step.expected
        return len(left)

    def _do(self, step: Step, progress: Progress) -> None:
        scene, run = step.scene, step.training
        if step.draw:
            scene.draw(self.out, run.size, self.measure, progress)
            return
        folder, views = make_folder(self.folder(run)), scene.views_folder(self.out, run.size, self.measure)
        task: TrainTask | RenderTask
        if step.rendering is None:
            for old in folder.glob("render-*.json"):
                old.unlink()  # figures of a scene that is no longer there
            task = TrainTask(folder, views, run)
        else:
            volume = None if scene.volume is None else scene.volume.volume
            task = RenderTask(
                folder, views, step.rendering.file, step.rendering.size, self.measure.test, self.measure.network,
                run.device, volume,
            )  # fmt: skip
        run_apart(task.to_json(), progress, {KERNELS_VARIABLE: "reference" if run.kernels == "reference" else ""})

    def rows(self) -> list[Row]:
        """Return a row per finished run of this command and rendered size, in the command's order."""
        done = [step for step in self.steps if step.rendering is not None and self.is_done(step)]
        return [
            read_row(self.folder(step.training) / "train.json", self.folder(step.training) / step.rendering.file)
            for step in done
            if step.rendering is not None
        ]


def _titled(progress: Progress, title: str) -> Progress:
    return lambda fraction, label: progress(fraction, f"{title}: {label}")
