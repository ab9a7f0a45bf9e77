"""Looks that ship, by name; they are data like any other look."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from svv.errors import BadInput
from svv.options.making import PREFIX
from svv.styles.gallery.offered import INKS


def _look(title: str, *regions: Mapping[str, str | float | tuple[float, ...]]) -> dict[str, Any]:
    """Return a look as plain values; its regions have edits, and may have a ``style``: a gallery picture or an ink."""
    told: list[dict[str, object]] = []
    styles: dict[str, dict[str, str]] = {}
    for region in regions:
        edits = dict(region)
        style = edits.pop("style", None)
        told.append({"edits": edits} if style is None else {"edits": edits, "style": style})
        if isinstance(style, str):
            kind = "ink" if style in INKS else "gallery"
            styles[style] = {kind: style}
    return {"svv_look": 1, "title": title, "regions": told, "styles": styles}


LOOKS: dict[str, dict[str, Any]] = {
    "terracotta": _look("unglazed clay", {"matcap": "clay"}),
    "sunflower": _look("thick oil paint", {"style": "impasto"}),
    "engraving": _look("pen and ink on paper", {"style": "cross-hatching", "outline": 1.0}),
    "museum": _look("bronze on porcelain", {"matcap": "porcelain"}, {"matcap": "bronze"}),
    "sea-glass": _look("jade and pearl", {"matcap": "jade"}, {"matcap": "pearl"}),
    "comic": _look(
        "flat blue and orange with outlines",
        {"matcap": "toon", "outline": 1.0, "outline_width": 2.5},
        {"edited_colour": (0.98, 0.55, 0.13), "lighting": 0.4, "outline": 1.0, "outline_width": 2.5},
    ),
    "studio": _look("porcelain, bronze and jade", {"matcap": "porcelain"}, {"matcap": "bronze"}, {"matcap": "jade"}),
    "radiograph": _look(
        "light rims, a red core", {"matcap": "x-ray"}, {"matcap": "velvet"}, {"matcap": "x-ray", "opacity": 0.7}
    ),
    "salon": _look("three hands of painters", {"style": "oil"}, {"style": "impasto"}, {"style": "watercolour"}),
    "field-notes": _look(
        "hatching, dots and a wash of watercolour",
        {"style": "hatching", "outline": 0.8}, {"style": "watercolour"}, {"style": "stippling"},
    ),
}  # fmt: skip
"""Name -> look as plain values. Their regions are handed out in turn, the largest of a scene first."""


def offered(source: str) -> dict[str, Any] | None:
    """Return the look ``gallery:NAME`` as plain values; None for other text. Raises BadInput if there is none."""
    if not source.startswith(PREFIX):
        return None
    name = source.removeprefix(PREFIX).strip().lower().replace("_", "-").replace(" ", "-")
    if name not in LOOKS:
        raise BadInput(f"There is no look '{name}' in the gallery; choose one of {', '.join(LOOKS)}.")
    return LOOKS[name]
