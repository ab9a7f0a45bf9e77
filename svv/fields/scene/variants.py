"""Several paintings of one scene: variants share its base, palette and edits; each has its own colour network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from svv.errors import BadInput, Progress, silent
from svv.fields.radiance.networks import UnrestrictedField
from svv.fields.radiance.occlusion import check_has_extinction
from svv.fields.radiance.paint_light import mean_lights
from svv.fields.scene.edits import EditedModel
from svv.fields.scene.history import restyled
from svv.fields.scene.parts import counted
from svv.fields.scene.region import Region, of_layer
from svv.fields.strokes.stroke_edits import as_laid
from svv.options.editing import SPLIT_LEVEL

if TYPE_CHECKING:
    from typing_extensions import Self

UNNAMED = "styled"
"""Name of a variant for which no name was given."""

LONGEST_NAME = 64
"""Maximum number of characters in a variant's name."""


@dataclass(frozen=True)
class Variant:
    """A painting of a scene that is not the one being shown."""

    name: str
    network: UnrestrictedField
    styles: tuple[str | None, ...]
    """Name of each region's style; None for a region that is not painted. Parts that were split off later have none."""
    made: dict[str, Any]
    """Record of how it was painted."""


@dataclass(frozen=True)
class PaintedModel(EditedModel):
    """A model and its paintings. The painting shown provides the network ``styled`` and the regions' styles."""

    painting: str | None = None
    """Name of the variant whose network is ``styled``."""
    others: tuple[Variant, ...] = ()
    """Variants that are not shown."""
    layers: tuple[PaintedModel, ...] = ()
    """Further scenes that are drawn with it, without regions of their own; see :mod:`svv.fields.scene.joined`."""

    @property
    def variant(self) -> str | None:
        """Name of the variant that is shown; None for a scene that was not painted."""
        return None if self.styled is None else self.painting or UNNAMED

    @property
    def variants(self) -> tuple[str, ...]:
        """Names of all variants, in alphabetical order."""
        return tuple(variant.name for variant in self.every_variant)

    def with_variant(self, name: str) -> Self:
        """Return the scene showing this variant. Edits are kept; paint hides the edited colour of a region.

        Raises:
            BadInput: There is no such variant.
        """
        self._check_variant(name)
        if name == self.variant:
            return self
        (chosen,) = (other for other in self.others if other.name == name)
        rest = tuple(other for other in self.every_variant if other.name != name)
        return self._showing(chosen, rest)

    def with_occlusion(self, amount: float, *regions: int) -> Self:
        """Return a scene in which cavities of these regions, by default of all, are darkened by an amount up to 1.

        Raises:
            BadInput: The amount is outside [0, 1], a region does not exist, or the extinction is in a hash grid.
        """
        check_has_extinction(self)
        for layer in self.layers:
            check_has_extinction(layer)
        return self._with_amount("occlusion", amount, regions, "The ambient occlusion")

    def without_variant(self, name: str) -> Self:
        """Return the scene without this variant; if it was the one shown, the first remaining variant is shown.

        Raises:
            BadInput: There is no such variant.
        """
        self._check_variant(name)
        rest = tuple(other for other in self.every_variant if other.name != name)
        if name != self.variant:
            return replace(self, others=tuple(o for o in self.others if o.name != name))
        if rest:
            return self._showing(rest[0], rest[1:])
        made = {key: value for key, value in self.made.items() if key != "stylized"}
        return replace(self._styled(None), styled=None, painting=None, others=(), made=made)

    def painted(
        self, network: UnrestrictedField, styles: Mapping[int, str], made: dict[str, Any], name: str | None = None
    ) -> Self:
        """Return the scene with a new variant, which is shown; it replaces an existing one of the same name.

        The regions get the mean light from which the light on paint is measured
        (:mod:`svv.fields.radiance.paint_light`).

        Args:
            network: The network of its diffuse colours.
            styles: Style name of each region that it paints; the other regions keep their palette colours.
            made: Record of how it was painted.
            name: Its name, by default :data:`UNNAMED`.
        """
        name = name or UNNAMED
        rest = tuple(other for other in self.every_variant if other.name != name)
        every = tuple(styles.get(region) for region in range(len(self.regions)))
        shown = self._showing(Variant(name, network, every, made), rest)
        means, anew = mean_lights(self), self._painted_anew(network)
        lit = (replace(r, mean_light=means[root]) for r, root in zip(shown.regions, self.roots, strict=True))
        return replace(shown, regions=tuple(as_laid(r) if k in anew else r for k, r in enumerate(lit)))

    def _painted_anew(self, network: UnrestrictedField) -> set[int]:
        """Return the regions with strokes other than those shown now: edits of the old strokes do not concern them."""
        before, after = ({} if n is None or n.brushed is None else n.brushed.regions for n in (self.styled, network))
        other = {k for k, (strokes, _) in after.items() if k not in before or before[k][0] is not strokes}
        return {k for k, root in enumerate(self.roots) if root in other}

    @property
    def regions_with_strokes(self) -> tuple[int, ...]:
        """Numbers of the regions that are painted by strokes."""
        found: list[int] = []
        for number, layer in enumerate((self, *self.layers)):
            own = [k for k, region in enumerate(self.regions) if region.layer == number]
            found += [own[k] for k in replace(layer, regions=of_layer(self.regions, number)).stroked]
        return tuple(sorted(found))

    def split_at(self, point: Sequence[float], level: float = SPLIT_LEVEL, progress: Progress = silent) -> Self:
        """Return the scene with a connected part as a region of its own; see :meth:`EditedModel.split_at`."""
        result, count = super().split_at(point, level, progress), len(self.regions)
        # Styles of parts that were undone must not become those of the new part.
        return replace(result, others=tuple(replace(o, styles=o.styles[:count]) for o in result.others))

    def with_parts_of(self, other: EditedModel) -> Self:
        """Return this scene with the parts of another one of the same layers."""
        theirs = other.layers if isinstance(other, PaintedModel) else ()
        layers = (replace(own, parts=layer.parts) for own, layer in zip(self.layers, theirs, strict=True))
        return replace(super().with_parts_of(other), layers=tuple(layers))

    def counted(self) -> Self:
        """Return the scene with as many active parts as its regions are, in each layer."""
        layers = (replace(s, parts=counted(s.parts, self.regions, k)) for k, s in enumerate(self.layers, start=1))
        return replace(super().counted(), layers=tuple(layers))

    def free_name(self, name: str | None) -> str:
        """Return the name for a new variant; by default :data:`UNNAMED`, which may be overwritten.

        Raises:
            BadInput: The name is taken, empty or too long, or has characters that are not printable.
        """
        if name is None:
            return UNNAMED
        if not name.strip() or len(name) > LONGEST_NAME or not name.isprintable():
            raise BadInput(f"A variant's name must be 1 to {LONGEST_NAME} printable characters, not '{name}'.")
        if name in self.variants:
            raise BadInput(f"There is already a variant '{name}': choose another name, or drop it first.")
        return name

    def _check_variant(self, name: str) -> None:
        if name not in self.variants:
            there = f"the scene has {', '.join(self.variants)}" if self.variants else "the scene was never painted"
            raise BadInput(f"There is no variant '{name}': {there}.")

    @property
    def every_variant(self) -> tuple[Variant, ...]:
        """All variants, in alphabetical order."""
        every = list(self.others)
        if self.styled is not None and self.variant is not None:
            styles = tuple(region.style for region in self.every_region)
            every.append(Variant(self.variant, self.styled, styles, self.made.get("stylized", {})))
        return tuple(sorted(every, key=lambda variant: variant.name))

    def _showing(self, chosen: Variant, rest: tuple[Variant, ...]) -> Self:
        return replace(
            self._styled(chosen.styles),
            styled=chosen.network, painting=chosen.name, others=rest, made={**self.made, "stylized": chosen.made},
        )  # fmt: skip

    def _styled(self, styles: Sequence[str | None] | None) -> Self:
        """Return the scene with these styles of its regions; parts split off since then have those of the whole."""
        regions: list[Region] = []
        for number, region in enumerate(self.every_region):
            if styles is None:
                regions.append(replace(restyled(region, None), mean_light=None))
            elif number < len(styles) or region.part_of is None:
                regions.append(restyled(region, styles[number]))
            else:
                regions.append(restyled(region, regions[region.part_of].style))
        count = len(self.regions)
        return replace(self, regions=tuple(regions[:count]), unsplit=tuple(regions[count:]))
