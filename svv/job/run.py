"""The whole job, stage by stage."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from svv.fields.devices.gpu import device_named
from svv.io.pictures.style_picture import read_style
from svv.job.result import write_result
from svv.job.source import Drawn, ViewSource
from svv.job.stages import Show, Stages, unseen
from svv.job.steps import Job, JobSettings
from svv.train.run.config import settings_of


def check(settings: JobSettings) -> None:
    """Raise BadInput if an option does not exist or is incompatible with another."""
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
    """Do the whole job, or whatever part of it is not done yet, in the folder ``out``; return the page ``report.html``.

    Regions get the style pictures in turn; without any, nothing is stylized. ``stages`` are those already begun in the
    same folder, for a job in which an earlier stage creates the source. Raises BadInput if an input is unusable, or the
    folder cannot be written to, and Cancelled if the progress that ``show`` gives stopped the job; the same call
    resumes it.
    """
    check(settings)  # report errors before the work begins, not minutes into it
    source.identity()
    for style in styles:
        read_style(style)
    page = out / "report.html"
    job = Job(source, styles, out, settings, stages or Stages(out, show))
    job.stages.page = page
    job.make_views()
    job.train()
    job.evaluate()
    job.regions()
    if settings.recolour:
        job.recolour()
    if settings.look is not None:
        job.give_look()
    elif styles:
        job.stylize()
    job.share()
    job.orbits()
    job.movie()
    write_result(page, job)
    return page
