"""Pictures in the tooltips of ParaView's panels: its lists have words alone, but Qt shows tooltips as rich text."""

from __future__ import annotations

import re
from pathlib import Path
from xml.sax.saxutils import escape

PICTURES = Path(__file__).parent / "pictures"
"""Folder of the pictures in tooltips, which ``python -m docs.pictures`` makes."""

PICTURED = {
    "Look": "looks.jpg", "Gallery": "styles.jpg", "RegionStyle": "styles.jpg", "RegionMatCap": "matcaps.jpg",
}  # fmt: skip
"""Property, without the number of its region -> picture of what can be chosen."""


def with_picture(name: str, xml: str) -> str:
    """Return a property's XML, with a picture in its tooltip if there is one of what can be chosen.

    >>> "looks.jpg" in with_picture("Look", "<Documentation>The look.</Documentation>")
    True
    """
    picture = PICTURED.get(re.sub(r"\d", "", name))
    if picture is None:
        return xml
    shown = escape(f'<br/><img src="{PICTURES / picture}"/>')
    return xml.replace("</Documentation>", f"{shown}</Documentation>")
