"""Several paintings of one scene: variants share its base, palette and edits, and have a colour network each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from svv.errors import BadInput
from svv.fields.edits import EditedModel, restyled
from svv.fields.networks import UnrestrictedField
from svv.fields.paint_light import mean_lights
from svv.fields.region import Region

if TYPE_CHECKING:
    from typing_extensions import Self

UNNAMED = "styled"
"""Name of the variant that was given none."""

LONGEST_NAME = 64
"""Characters of a variant's name at most."""


@dataclass(frozen=True)
class Variant:
    """A painting of a scene that is not the one being shown."""

    name: str
    network: UnrestrictedField
    styles: tuple[str | None, ...]
    """Name of each region's style; None where the palette holds its colour."""
    made: dict[str, Any]
    """How it was painted."""


@dataclass(frozen=True)
class PaintedModel(EditedModel):
    """A model and its paintings. One is shown: its network is ``styled``, its styles are the regions'."""

    painting: str | None = None
    """Name of the variant whose network is ``styled``, and"""
    others: tuple[Variant, ...] = ()
    """the variants that are not shown."""

    @property
    def variant(self) -> str | None:
        """Name of the variant that is shown; None for a scene that was not painted."""
        return None if self.styled is None else self.painting or UNNAMED

    @property
    def variants(self) -> tuple[str, ...]:
        """Names of all variants, in alphabetical order."""
        return tuple(variant.name for variant in self.every_variant)

    def with_variant(self, name: str) -> Self:
        """The scene with this variant shown. The edits stay; where it paints, a region's edited colour is not seen.

        Raises:
            BadInput: there is no such variant.
        """
        self._check_variant(name)
        if name == self.variant:
            return self
        (chosen,) = (other for other in self.others if other.name == name)
        rest = tuple(other for other in self.every_variant if other.name != name)
        return self._showing(chosen, rest)

    def without_variant(self, name: str) -> Self:
        """The scene without this variant; if it was shown, the first of the others is.

        Raises:
            BadInput: there is no such variant.
        """
        self._check_variant(name)
        rest = tuple(other for other in self.every_variant if other.name != name)
        if name != self.variant:
            return replace(self, others=tuple(o for o in self.others if o.name != name))
        if rest:
            return self._showing(rest[0], rest[1:])
        made = {key: value for key, value in self.made.items() if key != "stylized"}
        return replace(self, styled=None, painting=None, others=(), regions=self._styled(None), made=made)

    def painted(
        self, network: UnrestrictedField, styles: Mapping[int, str], made: dict[str, Any], name: str | None = None
    ) -> Self:
        """The scene with one more variant, which is shown; one of this name is replaced.

        The regions get the mean light that light on paint counts from (:mod:`svv.fields.paint_light`).

        Args:
            network: Its diffuse colours.
            styles: Name of the style of each region that it paints; the palette holds the colours of the others.
            made: How it was painted.
            name: What to call it.
        """
        name = name or UNNAMED
        rest = tuple(other for other in self.every_variant if other.name != name)
        every = tuple(styles.get(region) for region in range(len(self.regions)))
        shown = self._showing(Variant(name, network, every, made), rest)
        lit = zip(shown.regions, mean_lights(self), strict=True)
        return replace(shown, regions=tuple(replace(region, mean_light=mean) for region, mean in lit))

    def free_name(self, name: str | None) -> str:
        """The name of a variant to be painted; without one it is :data:`UNNAMED`, which may be painted over.

        Raises:
            BadInput: a variant has that name, or it is empty, too long, or not to be printed.
        """
        if name is None:
            return UNNAMED
        if not name.strip() or len(name) > LONGEST_NAME or not name.isprintable():
            raise BadInput(f"A variant's name must be 1 to {LONGEST_NAME} printable characters, not '{name}'.")
        if name in self.variants:
            raise BadInput(f"There is a variant '{name}' already: choose another name, or drop it first.")
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
            styles = tuple(region.style for region in self.regions)
            every.append(Variant(self.variant, self.styled, styles, self.made.get("stylized", {})))
        return tuple(sorted(every, key=lambda variant: variant.name))

    def _showing(self, chosen: Variant, rest: tuple[Variant, ...]) -> Self:
        return replace(
            self,
            styled=chosen.network, painting=chosen.name, others=rest, regions=self._styled(chosen.styles),
            made={**self.made, "stylized": chosen.made},
        )  # fmt: skip

    def _styled(self, styles: tuple[str | None, ...] | None) -> tuple[Region, ...]:
        if styles is None:
            return tuple(replace(restyled(region, None), mean_light=None) for region in self.regions)
        return tuple(restyled(region, name) for region, name in zip(self.regions, styles, strict=True))
