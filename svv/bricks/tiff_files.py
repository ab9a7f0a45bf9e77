"""What the readers of TIFF stacks share."""

from __future__ import annotations

import re
from pathlib import Path

TIFFFILE_DECODES = (1, 8, 32773, 32946)
"""TIFF compressions that tifffile decodes by itself: none, deflate, PackBits, and the old number of deflate."""


def in_order(folder: Path) -> list[Path]:
    """Return the TIFF files of a folder, slice_2 before slice_10, whether or not the numbers are padded."""
    files = [f for f in folder.iterdir() if f.suffix.lower() in (".tif", ".tiff")]
    return sorted(files, key=lambda f: [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", f.name)])
