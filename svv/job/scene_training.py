"""Training as Python asks for it: in this process, or in the background in one of its own."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Literal, overload

from svv.errors import BadInput, Progress, silent
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet
from svv.options.making import TrainOptions
from svv.train import pipeline
from svv.train.run.config import Preset, given
from svv.train.run.learning import Learning
from svv.train.run.report import Report

COMMAND = (sys.executable, "-c", "from svv.job.learning_process import main; main()")
"""The process that trains in the background."""


@overload
def train_scene(
    views: ViewSet,
    options: TrainOptions | Preset | str = ...,
    progress: Progress = ...,
    checkpoint: Path | None = ...,
    *,
    background: Literal[False] = ...,
    **changes: object,
) -> tuple[Scene, Report]: ...


@overload
def train_scene(
    views: ViewSet,
    options: TrainOptions | str = ...,
    progress: Progress = ...,
    checkpoint: Path | None = ...,
    *,
    background: Literal[True],
    **changes: object,
) -> Learning: ...


def train_scene(
    views: ViewSet,
    options: TrainOptions | Preset | str = TrainOptions(),
    progress: Progress = silent,
    checkpoint: Path | None = None,
    *,
    background: bool = False,
    **changes: object,
) -> tuple[Scene, Report] | Learning:
    """Train a scene: base field, palette and palette colour network (stages 1 and 2).

    Args:
        views: Training views.
        options: How to train. The name of a preset, or custom settings, mean the default options with these settings.
            On a CPU, the same views, options and number of threads give the same scene (without a time limit); a GPU
            sums in a different order each time.
        progress: Called several times a second; stops the training when it raises.
        checkpoint: File to save to regularly, and to resume from if it exists. The caller removes it once the scene
            is saved.
        background: Whether to return at once, and train in a process of its own. The result is then a
            :class:`svv.Learning`, which gives sketches while they are better than nothing, and the scene; it calls no
            ``progress``, and removes the ``checkpoint`` itself.
        changes: Fields of the options to change, by name, such as ``time_limit=60``.

    Returns:
        The scene, and a report: ``seconds`` per stage and ``total``, ``peak_rss_bytes``, ``parameters``, ``device``,
        ``gpu`` (its name), ``kernels``, ``peak_gpu_bytes`` (None on a CPU, as is ``gpu``), ``seed``, ``preset``,
        ``encoding``, ``lighting`` (the light of the scene: ``network``, ``phong`` or ``none``), ``notes`` (why the
        model has its size), ``learned_from`` (``volume and views`` or ``views only``) and ``warnings`` (what may be
        wrong with the views, or with regions found in them). Regions found in views alone have a ``confidence`` each,
        in [0, 1].

    Raises:
        BadInput: There are fewer than 3 views, none shows anything, no point is visible in all of them, they contradict
            their cameras, an option does not exist, or the time limit is not above 0.

    >>> trained, report = svv.train_scene(views, "draft", time_limit=2.0)
    >>> trained.networks, sorted(report["seconds"])
    (('base', 'pcn'), ['base', 'check', 'doubt', 'extinction', 'hull', 'palette', 'pcn', 'sampling', 'total'])
    """
    if not background:
        return pipeline.train_scene(views, options, progress, checkpoint, **changes)
    asked, _ = given(TrainOptions, options, changes)
    pipeline.check_enough(views)
    if isinstance(options, Preset):
        raise BadInput("In the background, training takes the name of a preset, with change=... for its settings.")
    return Learning(COMMAND, views, asked, checkpoint)
