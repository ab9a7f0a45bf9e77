"""Where what can be made again is kept between runs."""

from __future__ import annotations

import os
from pathlib import Path


def cache_folder() -> Path:
    """The program's folder in the user's cache: ``$XDG_CACHE_HOME/svv``, else ``~/.cache/svv``; it may not exist."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "svv"
