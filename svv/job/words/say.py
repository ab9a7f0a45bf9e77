"""Apply what a sentence says to a scene, as one edit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from svv.errors import BadInput, Progress, silent
from svv.fields.scene.region import label_of, swatches
from svv.job.words.colours import changed
from svv.job.words.grammar import Clause, understood
from svv.options.making import PREFIX, PaintOptions, PresetName
from svv.train.paint.ink import StyleInput, style_named

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene


@dataclass(frozen=True)
class Spoken:
    """A scene as a sentence asks for it, and how the sentence was understood, a line each."""

    scene: Scene
    understood: tuple[str, ...]


def say(
    scene: Scene,
    text: str,
    progress: Progress = silent,
    checkpoint: Path | None = None,
    preset: PresetName = "balanced",
    paints: bool = True,
) -> Spoken:
    """Return a scene as a sentence asks for it.

    Args:
        scene: A scene with regions; names make them easy to speak of.
        text: Such as "make the shell pale jade, thinner, hide the ring".
        progress: Called while regions are painted, if the sentence asks for styles.
        checkpoint: File to save a painting to regularly, and to resume from.
        preset: How to paint.
        paints: Whether styles are painted, which takes long; otherwise they are refused.

    Returns:
        The scene, with one more step in its history, and what was understood.

    Raises:
        BadInput: The sentence was not understood, wants a style that is not to be painted, or an edit cannot be made.

    >>> said = svv.say(scene.edited(0, name="core"), "make the core pale jade")
    >>> said.understood
    ('core: colour pale jade (#9ad5b6)',)
    """
    if not scene.regions:
        raise BadInput("The scene has no regions because it holds no palette network; train it again.")
    clauses = understood(text, scene.regions)
    lines = [_describe_clause(scene, clause) for clause in clauses]
    if wanted := [str(clause.wants["style"]) for clause in clauses if "style" in clause.wants and not paints]:
        name = wanted[0].removeprefix(PREFIX)
        raise BadInput(
            f"The style {name} takes painting, which is not done here: use StyleRF Stylize or svv edit --say for it, "
            "and leave it out."
        )
    result = _painted(scene, clauses, progress, checkpoint, preset)
    if result is not scene:
        told = result.made["stylized"]["divided"]
        lines += [label for _, label in swatches(told, result.regions)]
    before = result
    for clause in clauses:
        result = _edited(result, clause)
    progress(1.0, "words")
    return Spoken(result.as_one_step(before), tuple(lines))


def _describe_clause(scene: Scene, clause: Clause) -> str:
    wanted = ", ".join(clause.texts)
    if set(clause.wants) <= {"light", "intensity"}:
        return wanted
    return f"{', '.join(label_of(scene.regions, k) for k in clause.regions)}: {wanted}"


def _edited(scene: Scene, clause: Clause) -> Scene:
    """Return the scene with what one clause wants, apart from styles."""
    wants: dict[str, Any] = clause.wants
    visible = wants.get("visible")
    if visible is not None:
        act = {"hide": scene.hidden, "show": scene.shown, "only": scene.isolated}[visible]
        scene = act(*clause.regions)
    for region in clause.regions:
        changes = _changes(scene, region, wants)
        if changes:
            scene = scene.edited(region, **changes)
    if "outline" in wants:
        scene = scene.with_outline(wants["outline"], *clause.regions)
    if "light" in wants or "intensity" in wants:
        place = {name: getattr(scene.lamp, name) for name in ("azimuth", "elevation", "direction")}
        if "light" in wants:
            azimuth, elevation = wants["light"]
            place = {"azimuth": azimuth, "elevation": elevation, "direction": None}
        scene = scene.with_light(**place, intensity=scene.lamp.intensity * wants.get("intensity", 1.0))
    return scene


def _changes(scene: Scene, region: int, wants: dict[str, Any]) -> dict[str, Any]:
    """Return the edits of one region."""
    own = scene.regions[region]
    found: dict[str, Any] = {name: wants[name] for name in ("colour", "lighting", "opacity", "matcap") if name in wants}
    if "change" in wants:
        found["colour"] = changed(found.get("colour", own.edited_colour or own.colour), wants["change"])
    if "factor" in wants:
        found["opacity"] = found.get("opacity", own.opacity) * wants["factor"]
    if "colour" in found and own.matcap is not None and "matcap" not in found:
        found["matcap"] = "none"  # a colour that a MatCap hides would not be seen
    return found


def _painted(
    scene: Scene, clauses: Sequence[Clause], progress: Progress, checkpoint: Path | None, preset: PresetName
) -> Scene:
    """Return the scene with the styles that the clauses want, beside the paint that it has."""
    wanted = {k: str(clause.wants["style"]) for clause in clauses if "style" in clause.wants for k in clause.regions}
    if not wanted:
        return scene
    from svv.train.pipeline import stylize_scene

    names = sorted(set(wanted.values()))
    styles = []
    for name in names:
        label, style = style_named(name, progress)
        styles.append(StyleInput(style, label))
    mapping = {region: names.index(name) for region, name in wanted.items()}
    options = PaintOptions(mapping=mapping, preset=preset, go_on=scene.styled is not None)
    return stylize_scene(scene, styles, options, progress, checkpoint)[0]
