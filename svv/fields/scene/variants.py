"""Several paintings of one scene: variants share its base, palette and edits; each has its own colour network.

:class:`svv.fields.scene.scene.Scene` has these functions as methods.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from svv.errors import BadInput
from svv.fields.radiance.networks import UnrestrictedField
from svv.fields.scene.history import restyled
from svv.fields.scene.model import UNNAMED, Model, S, Variant
from svv.fields.scene.paint_light import mean_lights
from svv.fields.scene.region import Region
from svv.fields.scene.stroke_edits import as_laid

LONGEST_NAME = 64
"""Maximum number of characters in a variant's name."""


def with_variant(scene: S, name: str) -> S:
    """Return the scene showing this variant; raises BadInput if there is none of this name.

    Edits are kept; paint hides the edited colour of a region.
    """
    _check(scene, name)
    if name == scene.variant:
        return scene
    (chosen,) = (other for other in scene.others if other.name == name)
    rest = tuple(other for other in scene.every_variant if other.name != name)
    return _showing(scene, chosen, rest)


def without_variant(scene: S, name: str) -> S:
    """Return the scene without this variant; raises BadInput if there is none of this name.

    If it was the one shown, the first remaining variant is shown.
    """
    _check(scene, name)
    rest = tuple(other for other in scene.every_variant if other.name != name)
    if name != scene.variant:
        return replace(scene, others=tuple(o for o in scene.others if o.name != name))
    if rest:
        return _showing(scene, rest[0], rest[1:])
    made = {key: value for key, value in scene.made.items() if key != "stylized"}
    return replace(_styled(scene, None), styled=None, painting=None, others=(), made=made)


def painted(
    scene: S,
    network: UnrestrictedField,
    styles: Mapping[int, str],
    made: dict[str, Any],
    name: str | None = None,
    glazes: Mapping[int, float] | None = None,
) -> S:
    """Return the scene with a new variant, which is shown; it replaces an existing one of the same name.

    The regions get the mean light that the light on paint starts from (:mod:`svv.fields.scene.paint_light`).
    ``styles``: style name of each region that it paints; the other regions keep their palette colours; ``made``: record
    of how it was painted; ``glazes``: how far opacity follows regions' strokes unless edited, by default as laid.
    """
    name = name or UNNAMED
    rest = tuple(other for other in scene.every_variant if other.name != name)
    every = tuple(styles.get(region) for region in range(len(scene.regions)))
    anew = _painted_anew(scene, network)
    given = _glazes_laid(scene, network, anew) if glazes is None else glazes
    follows = tuple(given.get(region, 0.0) for region in range(len(scene.regions)))
    shown = _showing(scene, Variant(name, network, every, made, follows), rest)
    means = mean_lights(scene)
    lit = (replace(r, mean_light=means[root]) for r, root in zip(shown.regions, scene.roots, strict=True))
    laid = tuple(as_laid(r) if k in anew else r for k, r in enumerate(lit))
    return replace(shown, regions=laid, history=scene.history.rebased(shown.regions, laid))


def _painted_anew(scene: Model, network: UnrestrictedField) -> set[int]:
    """Return the regions with strokes other than those shown now: edits of the old strokes do not concern them."""
    before, after = ({} if n is None or n.brushed is None else n.brushed.regions for n in (scene.styled, network))
    other = {k for k, (strokes, _) in after.items() if k not in before or before[k][0] is not strokes}
    return {k for k, root in enumerate(scene.roots) if root in other}


def _glazes_laid(scene: Model, network: UnrestrictedField, anew: set[int]) -> dict[int, float]:
    """Return how far opacity is to follow strokes that were just laid, and those kept from the painting before."""
    laid = network.brushed
    if laid is None:
        return {}
    kept = {k: r.glaze for k, r in enumerate(scene.regions) if k not in anew and scene.roots[k] in laid.regions}
    return kept | {k: laid.glazes[root] for k, root in enumerate(scene.roots) if root in laid.glazes}


def free_name(scene: Model, name: str | None) -> str:
    """Return the name for a new variant; by default :data:`UNNAMED`, which may be overwritten.

    Raises BadInput if the name is taken, empty or too long, or has characters that are not printable.
    """
    if name is None:
        return UNNAMED
    if not name.strip() or len(name) > LONGEST_NAME or not name.isprintable():
        raise BadInput(f"A variant's name must be 1 to {LONGEST_NAME} printable characters, not '{name}'.")
    if name in scene.variants:
        raise BadInput(f"There is already a variant '{name}': choose another name, or drop it first.")
    return name


def _check(scene: Model, name: str) -> None:
    if name not in scene.variants:
        there = f"the scene has {', '.join(scene.variants)}" if scene.variants else "the scene was never painted"
        raise BadInput(f"There is no variant '{name}': {there}.")


def _showing(scene: S, chosen: Variant, rest: tuple[Variant, ...]) -> S:
    return replace(
        _styled(scene, chosen.styles, chosen.glazes),
        styled=chosen.network, painting=chosen.name, others=rest, made={**scene.made, "stylized": chosen.made},
    )  # fmt: skip


def _styled(scene: S, styles: Sequence[str | None] | None, glazes: Sequence[float] = ()) -> S:
    """Return the scene with these styles and glazes of its regions; parts split off since have those of the whole."""
    regions: list[Region] = []
    for number, region in enumerate(scene.every_region):
        if styles is None:
            regions.append(replace(restyled(region, None, 0.0), mean_light=None))
        elif number < len(styles) or region.part_of is None:
            regions.append(restyled(region, styles[number], glazes[number] if number < len(glazes) else 0.0))
        else:
            whole = regions[region.part_of]
            regions.append(restyled(region, whole.style, whole.glaze))
    count = len(scene.regions)
    return replace(scene, regions=tuple(regions[:count]), unsplit=tuple(regions[count:]))
