"""A request: what is to be made of views, a volume or a scene; and the one way in which it is made.

The command, Python, trainings in the background, assistants and ParaView's filters, at work themselves or beside the
window, all make a request, so that the same request gives the same scene through each of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeAlias

from svv.core.colour.correction import Correction
from svv.errors import BadInput, Progress, part, silent
from svv.fields.devices.gpu import device_named
from svv.fields.scene.scene import Scene
from svv.io.scene_file import checkpoint_of
from svv.io.views.viewset import ViewSet
from svv.job.orders import LEARNED
from svv.options.making import DeviceName, PaintOptions, PaletteOptions, TrainOptions, ViewOptions
from svv.render.frames import previews_in
from svv.train.correct import correct_palette
from svv.train.paint.ink import StyleInput
from svv.train.pipeline import stylize_scene, train_scene
from svv.train.run.previews import Show
from svv.train.run.report import Report

DRAWN, READ = 0.15, 0.03
"""Fractions of learning when the views of a volume are drawn, and when those of a palette are read."""

Draw: TypeAlias = Callable[[ViewOptions, Progress], ViewSet]
"""A volume as it is shown: draws views of it."""


@dataclass(frozen=True)
class Styles:
    """Styles for the regions of one scene."""

    given: Sequence[StyleInput]
    """Pictures and inks, with their masks."""
    mapping: Mapping[int, int | str] | None = None
    """Region -> index into ``given``, or name of a part; None leaves the options' own mapping as it is."""
    notes: Sequence[str] = ()
    """Sentences for the user."""


@dataclass(frozen=True)
class Paint:
    """How the regions of a scene are painted."""

    styles: Callable[[Scene, Progress], Styles]
    """The styles, which may depend on the scene: those that go by its colours do."""
    options: PaintOptions = PaintOptions()
    """All else."""
    sources: tuple[str, ...] = ()
    """Names of pictures among them, of which the hand can be measured before there is a scene."""
    preview: Path | None = None
    """File to which pictures of the unfinished painting are written."""

    @classmethod
    def of(cls, styles: Sequence[StyleInput], options: PaintOptions = PaintOptions()) -> Paint:
        """Return a painting in the same styles, whatever the scene."""
        given = Styles(tuple(styles))
        return cls(lambda scene, progress: given, options)


@dataclass(frozen=True)
class Correct:
    """How the palette of a scene is corrected."""

    correction: Correction
    """The changes."""
    views: Callable[[Progress], ViewSet]
    """Reads the views that the scene was trained on."""
    options: PaletteOptions = PaletteOptions()
    """How its regions are trained again."""


@dataclass(frozen=True)
class Request:
    """What is to be made: a scene is learned from an input or corrected, if the input is none, and painted.

    >>> from svv.job.compile_ahead import ball_views
    >>> request = Request(ball_views(), train=TrainOptions("draft", time_limit=1.0))
    >>> run(request).scene.networks
    ('base', 'pcn')
    """

    input: ViewSet | Draw | Scene
    """What it begins with."""
    views: ViewOptions = ViewOptions(test=0)
    """Which views of a volume are drawn."""
    train: TrainOptions = TrainOptions()
    """How a scene is learned from views."""
    correct: Correct | None = None
    """How the palette of a scene that is the input is corrected."""
    paint: Paint | None = None
    """How the scene is painted."""
    device: DeviceName = "auto"
    """Where a scene that is the input, or that is painted, is worked on."""
    file: Path | None = None
    """The user's file for the scene that is learned, beside which there is a checkpoint."""
    noted: Mapping[str, object] = field(default_factory=dict)
    """What the record of a scene that is learned or corrected is to say of where it comes from."""


@dataclass(frozen=True)
class Result:
    """What has been made."""

    scene: Scene
    learned: Report | None = None
    """Report on the training."""
    painted: Report | None = None
    """Report on the painting."""

    @property
    def notes(self) -> list[str]:
        """What the user should know of it, each sentence once."""
        assumed = self.scene.made.get("source", {}).get("assumed")
        learned = [] if self.learned is None else self.learned.get("warnings", [])
        painted = [] if self.painted is None else self.painted["notes"]
        return list(dict.fromkeys([*filter(None, [assumed]), *learned, *painted]))


def run(
    request: Request, progress: Progress = silent, checkpoint: Path | None = None, preview: Show | None = None
) -> Result:
    """Make what is asked for; ``preview`` is called with the unfinished painting (:func:`svv.stylize_scene`).

    The work is saved to the ``checkpoint`` regularly, and resumes from it if it exists; the caller removes it once the
    result is saved. Raises BadInput for the reasons of :func:`svv.make_views`, :func:`svv.train_scene`,
    :func:`svv.correct_palette` and :func:`svv.stylize_scene`, and what ``progress`` raises.
    """
    if request.paint is None:
        return Result(*learn(request, progress, checkpoint))
    if isinstance(request.input, Scene) and request.correct is None:
        scene, painted = paint(request, request.input, progress, checkpoint, preview)
        return Result(scene, None, painted)
    scene, learned = learn(request, part(progress, 0.0, LEARNED), checkpoint)
    scene, painted = paint(request, round_trip(scene), part(progress, LEARNED, 1.0), None, preview)
    return Result(scene, learned, painted)


def learn(request: Request, progress: Progress = silent, checkpoint: Path | None = None) -> tuple[Scene, Report]:
    """Learn the scene of a request, or correct it, as :func:`run`; return it, not yet painted, with a report."""
    if request.correct is not None:
        return _corrected(request, request.correct, progress, checkpoint)
    views, file = request.input, request.file
    assert not isinstance(views, Scene)
    if not isinstance(views, ViewSet):
        views, progress = views(request.views, part(progress, 0.0, DRAWN)), part(progress, DRAWN, 1.0)
    checkpoint = checkpoint if file is None else checkpoint_of(file)
    scene, report = train_scene(views, request.train, progress, checkpoint)
    scene = replace(scene, made={**scene.made, **request.noted})
    if file is not None and checkpoint is not None:
        scene.save(file)
        checkpoint.unlink(missing_ok=True)
    return scene, report


def paint(
    request: Request,
    scene: Scene,
    progress: Progress = silent,
    checkpoint: Path | None = None,
    preview: Show | None = None,
) -> tuple[Scene, Report]:
    """Paint a scene as a request asks; return it with a report. Arguments and errors are those of :func:`run`."""
    asked = request.paint
    if asked is None:
        raise BadInput("No style is given.")
    device = device_named(request.device)
    styles = asked.styles(scene, part(progress, 0.0, 0.02))
    options = asked.options if styles.mapping is None else replace(asked.options, mapping=dict(styles.mapping))
    painting = part(progress, 0.02, 1.0)
    if asked.preview is not None:
        preview, painting = make_preview_callback(asked.preview, painting)
    painted, report = stylize_scene(scene.on(device), styles.given, options, painting, checkpoint, preview)
    if styles.notes:
        report["notes"] = [*styles.notes, *report["notes"]]
        painted = replace(painted, made={**painted.made, "stylized": {**painted.made["stylized"], **report}})
    return painted, report


def round_trip(scene: Scene) -> Scene:
    """Return a scene as its file gives it back: with a little less precision, of which a painting may tell."""
    return Scene.from_bytes(scene.to_bytes()).on(scene.device)


def make_preview_callback(file: Path, progress: Progress) -> tuple[Show, Progress]:
    """Return a preview callback that writes a .png (else BadInput), and a progress that mentions the file."""
    write, there = previews_in(file), []

    def show(scene: Scene) -> None:
        write(scene)
        there.append(scene.variant)

    return show, lambda fraction, label: progress(fraction, f"{label}; see {file}" if there else label)


def _corrected(
    request: Request, asked: Correct, progress: Progress, checkpoint: Path | None
) -> tuple[Scene, Report]:  # fmt: skip
    """Return the scene that is the input with its palette corrected, and a report."""
    scene = request.input
    assert isinstance(scene, Scene)
    views, progress = asked.views(part(progress, 0.0, READ)), part(progress, READ, 1.0)
    on_device = scene.on(device_named(request.device))
    result, report = correct_palette(on_device, views, asked.correction, asked.options, progress, checkpoint)
    return replace(result, made={**result.made, **request.noted}).on(scene.device), report
