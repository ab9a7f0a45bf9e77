"""The whole job in its order."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from svv.io.images import read_style
from svv.job.result import write_result
from svv.job.source import Drawn, ViewSource
from svv.job.stages import Show, Stages, unseen
from svv.job.steps import Job, JobSettings


def check(settings: JobSettings) -> None:
    """Raise BadInput where an option does not exist, or does not go with another."""
    from svv.kernels.dispatch import device_named
    from svv.train.config import settings_of

    device_named(settings.train.device)
    settings_of(settings.train)


def run_job(
    source: Drawn | ViewSource,
    styles: Sequence[Path],
    out: Path,
    settings: JobSettings,
    show: Show = unseen,
    stages: Stages | None = None,
) -> Path:
    """Do the whole job, or what is left of it.

    Args:
        source: Where the views come from.
        styles: Style pictures, given to the regions in turn; none for no stylization.
        out: The folder of all results; made where it is missing.
        settings: What to do.
        show: How progress is shown.
        stages: Stages that were begun in the same folder, for a job whose source is made by a stage of its own.

    Returns:
        The page ``report.html``.

    Raises:
        BadInput: bad input anywhere, or a folder that cannot be written to.
        Cancelled: ``show``'s progress stopped the job; the same call goes on where it was.
    """
    check(settings)  # what is wrong is said before anything is made, and not after minutes of work
    source.identity()
    for style in styles:
        read_style(style)
    job = Job(source, styles, out, settings, stages or Stages(out, show))
    job.make_views()
    job.train()
    job.evaluate()
    job.regions()
    if settings.recolour:
        job.recolour()
    if styles:
        job.stylize()
    job.orbits()
    job.movie()
    page = out / "report.html"
    write_result(page, job)
    return page
