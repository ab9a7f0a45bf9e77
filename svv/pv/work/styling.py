"""Turn the panel of StyleRF Stylize into the regions' pictures, and paint scenes with them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

from svv.errors import BadInput, Progress
from svv.pv.panel.groups import REGIONS
from svv.pv.panel_values import Values, region_row
from svv.pv.results.keys import digest_of_scene
from svv.pv.results.stored import describe_parts
from svv.pv.work.style_masks import NO_PICTURE, asks_for_part, mask_for, source_of, sources_of

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene
    from svv.job.request import Styles
    from svv.train.paint.ink import StyleInput


@dataclass(frozen=True)
class Painting:
    """A painting on a scene."""

    base: str
    """Hash of what that scene has learned; its edits do not count."""
    scene: Scene
    name: str
    """Name under which the painting is kept."""

    def describe(self) -> str:
        """Return one line about the painting."""
        report = self.scene.made["stylized"]
        sentences = [f"Painted in {report['seconds']['total']:.0f} s.", *report["notes"], describe_parts(self.scene)]
        return " ".join(filter(None, sentences))


def goes_on(scene: Scene, last: Painting | None, values: Values) -> tuple[bool, str]:
    """Return whether painting continues from an existing painting, and its name; '' if it is the scene's own."""
    if values["Continue"] and last is not None and last.base == digest_of_scene(scene):
        return True, last.name
    return bool(values["Continue"]) and scene.styled is not None, ""


def starts_from(scene: Scene, last: Painting | None, values: Values) -> tuple[Scene, bool]:
    """Return the scene to paint on, and whether its painting goes on: the last of this name, if Continue is on."""
    go_on, name = goes_on(scene, last, values)
    return (last.scene if last is not None and name else scene), go_on


def paintings_on(scene: Scene, paintings: Mapping[str, Painting], shown: str, name: str) -> Scene:
    """Return a scene with its own edits and all paintings, by the panel's names, showing ``shown`` or the last."""
    from svv.fields.following.followed_scene import on_cells_of

    base, own = digest_of_scene(scene), {}
    if scene.layers:
        if shown and shown not in paintings:
            raise BadInput(f"There is no painting '{shown}': a joined scene shows one that this filter has painted.")
        chosen = paintings.get(shown or name)
        if chosen is None or chosen.base != base:
            return scene
        return _layers_painted(scene, chosen.scene)
    for given, painting in paintings.items():
        if painting.base != base:
            continue
        (variant,) = (v for v in painting.scene.every_variant if v.name == painting.scene.variant)
        styles = {region: style for region, style in enumerate(variant.styles) if style is not None}
        network = on_cells_of(scene, variant.network, painting.scene)
        scene = scene.painted(network, styles, variant.made, variant.name, dict(enumerate(variant.glazes)))
        own[given] = variant.name
    variant_shown = shown or own.get(name)
    if variant_shown is None:
        return scene
    return scene.with_variant(variant_shown)


def _layers_painted(scene: Scene, painting: Scene) -> Scene:
    """Return a joined scene with the paint that another one of the same layers shows, and with its own edits."""
    from svv.fields.scene.joined import members, with_members

    changed = []
    for own, its in zip(members(scene), members(painting), strict=True):
        if its.styled is not None:
            styles = {region: r.style for region, r in enumerate(its.regions) if r.style is not None}
            glazes = {region: r.glaze for region, r in enumerate(its.regions)}
            own = own.painted(its.styled, styles, its.made.get("stylized", {}), its.variant, glazes)
        changed.append(own)
    return with_members(scene, changed)


def styles_of(scene: Scene, values: Values, progress: Progress) -> Styles:
    """Return the styles that the panel asks for; raise BadInput for pictures, rows and masks that cannot be used."""
    from svv.job.request import Styles
    from svv.train.paint.ink import StyleInput, picture_of, style_named
    from svv.train.paint.style_choice import pairs_by_colour

    opened = cache(lambda source: style_named(source, progress))
    count, common = len(scene.regions), sources_of(values)
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
        pictures = [opened(source)[1] for source in common]
        rest = set(range(count)) - set(free)
        rows |= {region: common[k] for region, k in pairs_by_colour(scene.regions, pictures, None, rest).items()}
    else:
        rows |= {region: common[k % len(common)] for k, region in enumerate(free)}
    given: list[StyleInput] = []
    numbers: dict[tuple[str, int | None], int] = {}
    mapping: dict[int, int | str] = {}  # number of what is given, with the name of a part behind a colon if any
    for region, source in [(region, rows.get(region)) for region in range(count)]:
        if source:
            name, style = opened(source)
            mask = mask_for(values, region, source, picture_of(style))[0] if asks_for_part(values, region) else None
            key = source, None if mask is None else region
            if key not in numbers:
                numbers[key] = len(given)
                given.append(StyleInput(style, name if mask is None else f"{name} (region {region})", mask))
            share = region_row(values, region).get("Share", "").strip()
            mapping[region] = f"{numbers[key]}:{share}" if share else numbers[key]
    if not mapping:
        raise BadInput("No region is left to paint, because all stay as they are: choose a picture for at least one.")
    unused = [source for source in dict.fromkeys(common) if source not in rows.values()]
    notes = [f"{source} is not used, because there are more pictures than regions." for source in unused]
    return Styles(given, mapping, notes)
