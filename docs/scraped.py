"""Shows, below each block of an example, the ``picture`` that it made: a picture of Pillow, or an array."""

from __future__ import annotations

from typing import Any


def pictures(_block: Any, found: dict[str, Any], conf: dict[str, Any]) -> str:
    """Save a block's picture, which is no longer there for the next block; for sphinx-gallery."""
    import numpy as np
    from PIL import Image
    from sphinx_gallery.scrapers import figure_rst

    picture = found["example_globals"].pop("picture", None)
    if picture is None:
        return ""
    path = next(found["image_path_iterator"])
    Image.fromarray(np.asarray(picture)).save(path)
    return str(figure_rst([path], conf["src_dir"]))
