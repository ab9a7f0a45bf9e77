"""What the panel of StyleRF Stylize means: the pictures of the regions, and the paintings that come of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from svv.errors import BadInput, Progress, part
from svv.io.mask_file import Mask
from svv.options.making import DeviceOptions, PaintOptions
from svv.pv.identity import digest_of_scene
from svv.pv.masks import NO_PICTURE, asks_for_part, mask_for, source_of, sources_of
from svv.pv.option_panel import options_in
from svv.pv.panels import REGIONS

if TYPE_CHECKING:
    from svv.fields.scene import Scene
    from svv.train.ink import Style, StyleInput

Values = Mapping[str, Any]


@dataclass(frozen=True)
class Painting:
    """What was painted on a scene."""

    base: str
    """Hash of what that scene has learned: its edits do not count."""
    scene: Scene
    """The scene with its painting, which is shown."""
    name: str
    """Under which it is kept."""

    def told(self) -> str:
        """One line about it."""
        report = self.scene.made["stylized"]
        return " ".join([f"Painted in {report['seconds']['total']:.0f} s.", *report["notes"]])


def goes_on(scene: Scene, last: Painting | None, values: Values) -> tuple[bool, str]:
    """Whether painting goes on from a painting, and what that depends on: '' where it is that of the scene."""
    if values["Continue"] and last is not None and last.base == digest_of_scene(scene):
        return True, last.name
    return bool(values["Continue"]) and scene.styled is not None, ""


def painted(scene: Scene, last: Painting | None, values: Values, progress: Progress) -> Scene:
    """Paint a scene as the panel says.

    Args:
        scene: With a palette network.
        last: What was painted under this name before, to go on from where the panel says Continue.
        values: The panel's.
        progress: Called several times a second.

    Raises:
        BadInput, Cancelled: as :func:`stylize`.
    """
    go_on, name = goes_on(scene, last, values)
    start = last.scene if last is not None and name else scene
    return stylize(start, values, progress, go_on)


def paintings_on(scene: Scene, paintings: Mapping[str, Painting], shown: str, name: str) -> Scene:
    """A scene with all that was painted on it, under its own edits.

    Args:
        scene: As it is now.
        paintings: By the name that the panel gave them.
        shown: The variant to be shown; without one that of ``name``, the panel's name.
        name: Of the last painting, '' without one.

    Raises:
        BadInput: there is no variant ``shown``.
    """
    base, own = digest_of_scene(scene), {}
    for given, painting in paintings.items():
        if painting.base != base:
            continue
        (variant,) = (v for v in painting.scene.every_variant if v.name == painting.scene.variant)
        styles = {region: style for region, style in enumerate(variant.styles) if style is not None}
        scene = scene.painted(variant.network, styles, variant.made, variant.name)
        own[given] = variant.name
    chosen = shown or own.get(name)
    return scene if chosen is None else scene.with_variant(chosen)


@dataclass
class Styles:
    """Pictures as :func:`svv.train.pipeline.stylize_scene` takes them, and the style of each region."""

    given: list[StyleInput] = field(default_factory=list)
    mapping: dict[int, int] = field(default_factory=dict)
    opened: dict[str, tuple[str, Style]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    _numbers: dict[tuple[str, int | None], int] = field(default_factory=dict)

    def add(self, source: str, mask: Mask | None, region: int, progress: Progress) -> None:
        """Give a region a picture, or the part of it that a mask shows."""
        from svv.train.ink import StyleInput

        name, picture = self.open(source, progress)
        key = source, None if mask is None else region
        if key not in self._numbers:
            self._numbers[key] = len(self.given)
            self.given.append(StyleInput(picture, name if mask is None else f"{name} (region {region})", mask))
        self.mapping[region] = self._numbers[key]

    def open(self, source: str, progress: Progress) -> tuple[str, Style]:
        """Name, and picture or ink, read once."""
        from svv.train.ink import style_named

        if source not in self.opened:
            self.opened[source] = style_named(source, progress)
        return self.opened[source]


def styles_of(scene: Scene, values: Values, progress: Progress) -> Styles:
    """What the panel asks for.

    Raises:
        BadInput: no picture, one that cannot be used, a row for a region that the scene lacks, or a mask that cannot
            be (:func:`mask_for`).
    """
    from svv.train.ink import picture_of
    from svv.train.style_choice import pairs_by_colour

    count, common, styles = len(scene.regions), sources_of(values), Styles()
    rows = {region: source_of(values, region) for region in range(REGIONS)}
    for region, source in rows.items():
        if region >= count and (source is not None or asks_for_part(values, region)):
            raise BadInput(f"There is no region {region}: the scene has the regions 0 to {count - 1}.")
    free = [region for region in range(count) if rows.get(region) is None]
    if not common and not any(rows.values()):
        raise BadInput(NO_PICTURE)
    if not common:
        for region in free:
            rows[region] = ""
            if asks_for_part(values, region):
                raise BadInput(f"Region {region} has points or a mask, but no picture: choose one in its row.")
    elif values.get("Mapping") == "by colour":
        pictures = [styles.open(source, progress)[1] for source in common]
        rest = set(range(count)) - set(free)
        rows |= {region: common[k] for region, k in pairs_by_colour(scene.regions, pictures, None, rest).items()}
    else:
        rows |= {region: common[k % len(common)] for k, region in enumerate(free)}
    for region in range(count):
        source = rows.get(region)
        if source:
            style = styles.open(source, progress)[1]
            mask = mask_for(values, region, source, picture_of(style))[0] if asks_for_part(values, region) else None
            styles.add(source, mask, region, progress)
    if not styles.mapping:
        raise BadInput("No region is left to paint: every one stays as it is.")
    for source in dict.fromkeys(common):
        if source not in rows.values():
            styles.notes.append(f"{source} has no region and is not used; there are more pictures than regions.")
    return styles


def stylize(scene: Scene, values: Values, progress: Progress, go_on: bool = False) -> Scene:
    """The scene with its regions painted as the panel says, as a variant that is shown.

    Args:
        scene: With a palette network.
        values: The panel's; those that it lacks are at their defaults.
        progress: Called several times a second.
        go_on: Go on with the painting that the scene shows.

    Raises:
        BadInput: any reason of :func:`styles_of` or :func:`svv.train.pipeline.stylize_scene`.
        Cancelled: ``progress`` raised it.
    """
    from svv.kernels.dispatch import device_named
    from svv.train.pipeline import stylize_scene

    device = device_named(options_in(DeviceOptions, values).device)
    file = values.get("PreviewFile")
    preview, progress = (None, progress) if not file else told_of(Path(file), progress)
    styles = styles_of(scene, values, part(progress, 0.0, 0.02))
    variant = None if go_on else values.get("Variant") or None
    options = options_in(PaintOptions, values, mapping=styles.mapping, go_on=go_on, variant=variant)
    painting = part(progress, 0.02, 1.0)
    styled, report = stylize_scene(scene.on(device), styles.given, options, painting, preview=preview)
    notes = {**report, "notes": [*styles.notes, *report["notes"]]}
    return replace(styled, made={**styled.made, "stylized": notes})


def told_of(file: Path, progress: Progress) -> tuple[Callable[[Scene], None], Progress]:
    """What keeps a picture of the painting in a file, and a progress that says so once it is there.

    Raises:
        BadInput: the file is no .png, or cannot be written.
    """
    from svv.render.frames import previews_in

    write, there = previews_in(file), []

    def show(scene: Scene) -> None:
        write(scene)
        there.append(scene.variant)

    return show, lambda fraction, label: progress(fraction, f"{label}; see {file}" if there else label)
