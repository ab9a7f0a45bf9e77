"""Looks that ship, by name; they are data like any other look."""

from __future__ import annotations

from typing import Any

from svv.errors import BadInput
from svv.options.making import PREFIX

LOOKS: dict[str, dict[str, Any]] = {}


def offered(source: str) -> dict[str, Any] | None:
    """Return the look that ``gallery:NAME`` means, as plain values; None if the text names no look of the gallery.

    Raises:
        BadInput: There is no such look.
    """
    if not source.startswith(PREFIX):
        return None
    name = source.removeprefix(PREFIX).strip().lower().replace("_", "-").replace(" ", "-")
    if name not in LOOKS:
        raise BadInput(f"There is no look '{name}' in the gallery; choose one of {', '.join(LOOKS)}.")
    return LOOKS[name]
