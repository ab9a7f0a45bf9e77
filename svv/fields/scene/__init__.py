"""The scene: a record of values (``model``), functions on it, and ``scene.Scene``, which has them as methods.

The container on disk is :mod:`svv.io.scene_file`; training is in :mod:`svv.train`.
"""

from __future__ import annotations

import warnings
from typing import Any


def __getattr__(name: str) -> Any:
    """Return ``Scene`` from where it was before this package took the place of its module."""
    if name != "Scene":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from svv.fields.scene.scene import Scene

    warnings.warn("svv.fields.scene.Scene is now svv.Scene.", DeprecationWarning, stacklevel=2)
    return Scene
