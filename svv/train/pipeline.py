"""Train a scene from views, and stylize a scene: all stages in order, measured and resumable."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import numpy as np
import torch

from svv._version import __version__
from svv.errors import BadInput, Progress, silent
from svv.fields.devices.gpu import device_named, gpu_errors
from svv.fields.scene.scene import Scene
from svv.io.views.on_screen import ignoring_fixed
from svv.io.views.viewset import ViewSet
from svv.kernels.dispatch import forget_gpu_peak
from svv.measure import measured
from svv.options.making import PaintOptions, TrainOptions
from svv.styles.features import load_features
from svv.train.evaluate import evaluate_scene as evaluate_scene
from svv.train.joined_scenes import stylize_layers
from svv.train.keeping_values import check_keeps, keeping_values
from svv.train.match.matching import Matching
from svv.train.match.style_loss import PAPER_LOSS
from svv.train.paint.dividing import divided
from svv.train.paint.ink import Ink, Style, StyleInput
from svv.train.paint.laying import Laying
from svv.train.paint.legibility import notes_on
from svv.train.paint.pieces import PieceSettings
from svv.train.paint.plan import Order, ordered, with_hands
from svv.train.paint.recorded_styles import keep_styles
from svv.train.run import ranks
from svv.train.run.checkpoint import Checkpoint
from svv.train.run.config import VALUES, MatchSettings, Preset, given
from svv.train.run.previews import Show
from svv.train.run.report import Report, report_on
from svv.train.training import Training

LEAST_VIEWS = 3


def check_enough(views: ViewSet) -> None:
    """Raise BadInput if there are too few views to train on."""
    if len(views.cameras) < LEAST_VIEWS:
        raise BadInput(f"{len(views.cameras)} views are too few to train on; give at least {LEAST_VIEWS} (usually 92).")


def train_scene(
    views: ViewSet,
    options: TrainOptions | Preset | str = TrainOptions(),
    progress: Progress = silent,
    checkpoint: Path | None = None,
    **changes: object,
) -> tuple[Scene, Report]:
    """Train a scene in this process; arguments, result and errors are those of :func:`svv.train_scene`."""
    asked, chosen = given(TrainOptions, options, changes)
    check_enough(views)
    device, time_limit, seed = device_named(asked.device), asked.time_limit, asked.seed
    if asked.keep_values:
        check_keeps(views, asked.views_only)
    if asked.views_only:
        views = replace(views, classified=None)
    views, left_out = ranks.once(lambda: ignoring_fixed(views)) if asked.ignore_fixed else (views, None)
    if time_limit is not None and not time_limit > 0:
        raise BadInput(f"The time limit must be more than 0 seconds, not {time_limit}.")
    saved = None
    if checkpoint is not None:
        saved = ranks.once(lambda: Checkpoint(checkpoint, key_of(views, chosen, time_limit, seed)))
    forget_gpu_peak(device)
    with gpu_errors(device), measured() as cost:
        training = Training(views, chosen, time_limit, seed, progress, saved, device)
        training.notes += [] if left_out is None else [left_out]
        scene = training.run()
        if asked.keep_values:
            scene, said = keeping_values(scene, views)
            training.notes.append(said)
    seconds = {**training.seconds, "total": sum(training.seconds.values())}
    report = report_on(scene, seconds, cost, chosen, seed)
    report |= Report(
        encoding=VALUES if chosen.values else chosen.field.encoding,
        lighting=scene.settings.lighting,
        notes=training.notes,
        learned_from=training.learned_from,
        warnings=training.warnings,
    )
    if training.confidence:
        report["confidence"] = [round(sure, 3) for sure in training.confidence]
    made = ranks.once(
        lambda: {
            **report,
            "svv": __version__,
            "torch": torch.__version__,
            "views": len(views.cameras),
            "source": views.meta.to_json(),
        }
    )
    return replace(scene, made=made), report


def stylize_scene(
    scene: Scene,
    styles: Sequence[Style | StyleInput],
    options: PaintOptions | Preset | str = PaintOptions(),
    progress: Progress = silent,
    checkpoint: Path | None = None,
    preview: Show | None = None,
    pieces: PieceSettings = PieceSettings(),
    **changes: object,
) -> tuple[Scene, Report]:
    """Stylize a scene (stage 3): paint is laid, or with the preset ``paper`` learned by matching features.

    Args:
        scene: A scene with a palette colour network; its device does the work.
        styles: Pictures (H, W, 3), sRGB in [0, 1], and inks (:class:`svv.train.paint.ink.Ink`).
            :class:`svv.train.paint.ink.StyleInput` gives styles names and masks.
        options: How to paint. The name of a preset, or custom settings, mean the default options with these settings.
            ``mapping`` is the style of each region to be painted; None gives every region that is not kept a style, in
            turn; ``"colour"`` the one whose mean colour is nearest
            (:func:`svv.train.paint.style_choice.pairs_by_colour`). With ``go_on``, regions that are not named keep
            their paint, and the preset ``paper`` refines that of the others. ``variant`` is a name that no painting of
            the scene has yet; without one, the painting is called ``styled`` and replaces one of that name, or with
            ``go_on`` the painting that is shown.
        progress: Called several times a second; stops the work when it raises.
        checkpoint: File to save to regularly, and to resume from if it exists.
        preview: Called with a copy of the painted scene when regions have one colour each, as paint is laid, and
            finally with the result; with the preset ``paper`` about every ten seconds.
        pieces: How pictures are laid in pieces.
        changes: Fields of the options to change, by name, such as ``variant="ink"``.

    Returns:
        The scene with one more variant, which is shown, and the same edits (a scene of several transfer functions has
        only one painting, which is replaced), and a report as from :func:`train_scene`. Its ``notes`` say which styles
        are unused or shared, which masks make no difference, and in which manner each style is painted; ``features``
        names the features that were matched, ``none`` if paint is laid.

    Raises:
        BadInput: There is no palette network or no style, a region or style does not exist, no region is left to style,
        a mask is empty or differs in size from its picture, a stroke size or strength is out of range, there is no
        styled network to continue with, the variant already exists, or the preset ``paper`` is to draw in ink or paint
        in another manner, or another preset to match features.

    >>> picture = np.random.default_rng(0).random((64, 64, 3), np.float32)
    >>> painted, report = svv.stylize_scene(scene, [picture], "draft", mapping={0: 0}, manner="strokes")
    >>> painted.networks, report["manner"]
    (('base', 'pcn', 'styled'), {'0': 'strokes'})
    """
    asked, chosen = given(PaintOptions, options, changes)
    inputs = [s if isinstance(s, StyleInput) else StyleInput(s) for s in styles]
    division = divided(scene, inputs, asked)
    inputs, asked = list(division.inputs), division.options
    paint = partial(_stylize_alone, chosen, pieces)
    if scene.layers:
        styled, report = stylize_layers(scene, inputs, asked, paint, progress, checkpoint, preview)
    else:
        styled, report = paint(scene, inputs, asked, progress, checkpoint, preview)
    alike = notes_on(styled) if scene.layers else []  # between its members
    report["notes"] = list(dict.fromkeys([*division.notes, *report["notes"], *alike]))
    told = scene.made.get("stylized", {}).get("divided", {}) if asked.go_on else {}
    told = {region: share for region, share in told.items() if region not in report["styles"]}
    report["divided"] = told | {str(region): share for region, share in division.shares.items()}
    styled = replace(styled, made={**styled.made, "stylized": report})
    return keep_styles(scene, styled, inputs, asked, report), report


def _stylize_alone(
    chosen: Preset,
    pieces: PieceSettings,
    scene: Scene,
    inputs: Sequence[StyleInput],
    asked: PaintOptions,
    progress: Progress,
    checkpoint: Path | None,
    preview: Show | None,
) -> tuple[Scene, Report]:
    """Stylize a scene of one transfer function; see :func:`stylize_scene`."""
    order, settings, network = ordered(scene, inputs, asked), chosen.stylize, None
    pieces = replace(pieces, size=round(pieces.size * asked.stroke_size))
    if not isinstance(settings, MatchSettings):
        order = with_hands(order, asked.manner, asked.hand)
        hands = sorted((k, hand.technique) for k, hand in order.hands.items())
        key = {"strokes": [hands, asked.stroke_size], "pieces": asdict(pieces)}
        saved = _checkpoint_of(checkpoint, scene, order, asked, {**key, "settings": asdict(settings)})
        work: Laying | Matching = Laying(scene, order, settings, pieces, asked.seed, saved, preview)
    else:
        if order.inks:
            raise BadInput("Ink is drawn, not matched: choose a preset other than 'paper', or give pictures only.")
        network = load_features(asked.features, lambda _, label: progress(0.0, label))
        loss = replace(PAPER_LOSS, style_size=round(PAPER_LOSS.style_size * asked.stroke_size))
        key = {"loss": asdict(loss), "features": network.title, "settings": asdict(settings)}
        saved = _checkpoint_of(checkpoint, scene, order, asked, key)
        work = Matching(scene, order, settings, loss, network, asked.seed, saved, preview)
    forget_gpu_peak(scene.device)
    with gpu_errors(scene.device), measured() as cost:
        field = work.run(progress)
    field.requires_grad_(False)
    styled = order.painted(scene, field)
    if preview is not None:
        preview(styled)
    alike = notes_on(styled) if work.remarks.doubtful else []
    report = report_on(styled, {**work.seconds, "total": cost.seconds}, cost, chosen, asked.seed)
    report |= Report(
        features="none" if network is None else f"{network.title}, {network.channels} channels",
        styles={str(k): order.labels[v] for k, v in order.pairs.items()},
        masked=sorted(
            {
                order.labels[v]
                for v in order.pairs.values()
                if order.masks[v] is not None and not order.inputs[v].divided
            }
        ),
        manner={str(k): order.manner(k) if network is None else "matched" for k in order.pairs},
        hand={str(k): hand.technique for k, hand in order.hands.items()},
        stroke_size=asked.stroke_size,
        strength=asked.strength,
        continued=work.refined,
        previews=[] if work.previews is None else work.previews.seconds,
        notes=[*order.notes, *work.remarks.notes, *alike, *([network.note] if network and network.note else [])],
    )
    return replace(styled, made={**scene.made, "stylized": report}), report


def _checkpoint_of(
    path: Path | None, scene: Scene, order: Order, asked: PaintOptions, settings: Mapping[str, object]
) -> Checkpoint | None:
    """Return the checkpoint of a painting; None if there is no file for it."""
    if path is None:
        return None
    key = {"scene": scene.made, "styles": [s.name if isinstance(s, Ink) else np.asarray(s) for s in order.styles],
           "masks": order.masks, "pairs": sorted(order.pairs.items()), "go_on": asked.go_on,
           "seed": asked.seed}  # fmt: skip
    return Checkpoint(path, {**key, **settings})


def key_of(views: ViewSet, chosen: Preset, limit: float | None, seed: int) -> dict[str, object]:
    """Return everything that a training run depends on: a checkpoint with another key is not resumed."""
    return {
        "cameras": [c.identity for c in views.cameras],
        "images": views.images,
        "volume": None if views.classified is None else views.classified.exponent,
        "preset": asdict(chosen),
        "limit": limit,
        "seed": seed,
    }
