"""Opacity functions that ParaView's Cinema-Volumetric extractor writes beside its images."""

from __future__ import annotations

from pathlib import Path

from svv.core.json_values import Json, parsed
from svv.errors import BadInput


def opacity_function(folder: Path, number: str) -> Json | None:
    """Return a sweep's transfer function as a ParaView preset, if it has one; raises BadInput if it is damaged."""
    file = folder / f"cinemavolume_{number}.json"
    if not file.is_file():
        return None
    try:
        content = parsed(file.read_bytes())
    except (OSError, ValueError) as error:
        raise BadInput(f"Cannot read {file} ({error}); delete it to go on without the transfer function.") from error
    preset = content[0] if isinstance(content, list) and content else content
    # Only a preset with both functions says how a volume looks.
    whole = isinstance(preset, dict) and {"RGBPoints", "Points"} <= set(preset)
    return {"Name": "cinemavolume", **preset} if whole else None
