"""Turn the panel of StyleRF Stylize into the regions' pictures, and paint scenes with them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from svv.errors import BadInput, Progress
from svv.io.pictures.mask_file import Mask
from svv.pv.panel.groups import REGIONS
from svv.pv.panel_values import Values, region_row
from svv.pv.results.keys import digest_of_scene
from svv.pv.results.stored import describe_parts
from svv.pv.work.style_masks import NO_PICTURE, asks_for_part, mask_for, source_of, sources_of

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene
    from svv.job.request import Styles
    from svv.train.paint.ink import Style, StyleInput


@dataclass(frozen=True)
class Painting:
    """A painting on a scene."""

    base: str
    """Hash of what that scene has learned; its edits do not count."""
    scene: Scene
    """The scene, which shows the painting."""
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


@dataclass
class _Chosen:
    """The pictures that are chosen so far, and the style of each region."""

    given: list[StyleInput] = field(default_factory=list)
    """Pictures or inks, with their masks."""
    mapping: dict[int, int | str] = field(default_factory=dict)
    """Region -> index into ``given``, with the name of a part behind a colon if one is asked for."""
    opened: dict[str, tuple[str, Style]] = field(default_factory=dict)
    """Source -> name and style; each is read once."""
    _numbers: dict[tuple[str, int | None], int] = field(default_factory=dict)

    def add(self, source: str, mask: Mask | None, region: int, share: str, progress: Progress) -> None:
        """Assign a picture, or the part of it inside a mask, to a region; ``share`` names what it has of it, if any."""
        from svv.train.paint.ink import StyleInput

        name, picture = self.open(source, progress)
        key = source, None if mask is None else region
        if key not in self._numbers:
            self._numbers[key] = len(self.given)
            self.given.append(StyleInput(picture, name if mask is None else f"{name} (region {region})", mask))
        self.mapping[region] = f"{self._numbers[key]}:{share}" if share else self._numbers[key]

    def open(self, source: str, progress: Progress) -> tuple[str, Style]:
        """Return the name and the picture or ink of a source; each source is read once."""
        from svv.train.paint.ink import style_named

        if source not in self.opened:
            self.opened[source] = style_named(source, progress)
        return self.opened[source]


def styles_of(scene: Scene, values: Values, progress: Progress) -> Styles:
    """Return the styles that the panel asks for; raise BadInput for pictures, rows and masks that cannot be used."""
    from svv.job.request import Styles
    from svv.train.paint.ink import picture_of
    from svv.train.paint.style_choice import pairs_by_colour

    count, common, styles = len(scene.regions), sources_of(values), _Chosen()
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
            styles.add(source, mask, region, region_row(values, region).get("Share", "").strip(), progress)
    if not styles.mapping:
        raise BadInput("No region is left to paint, because all stay as they are: choose a picture for at least one.")
    unused = [source for source in dict.fromkeys(common) if source not in rows.values()]
    notes = [f"{source} is not used, because there are more pictures than regions." for source in unused]
    return Styles(styles.given, styles.mapping, notes)
