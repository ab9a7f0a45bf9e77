"""Keys of measurements: those of results, and the code that is measured (:mod:`svv.io.files.keyed_results`)."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import svv
from svv.io.files.keyed_results import digest, key_of

CALCULATES = ("core", "dvr", "fields", "io", "kernels", "render", "styles", "train")
"""Layers of the package ``svv`` whose code affects measurements."""

MEASURES = ("styles/flow.py", "styles/lines.py")
"""Modules of this package with which pictures are measured."""


def key_of_measure(*parts: object) -> str:
    """Return the :func:`~svv.io.files.keyed_results.key_of` of these values and of the code that is measured."""
    return key_of(code(), *parts)


@cache
def code() -> str:
    """Return a hash of the code of what is measured and of the measures, because the version seldom changes."""
    root, here = Path(svv.__file__).parent, Path(__file__).parent
    files = {path.relative_to(root).as_posix(): path for layer in CALCULATES for path in (root / layer).rglob("*.py")}
    files |= {f"{here.name}/{name}": here / name for name in MEASURES}
    return digest(dict(sorted(files.items())))
