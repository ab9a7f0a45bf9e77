"""Whether processes have ended."""

from __future__ import annotations

import time
from pathlib import Path


def has_ended(process: int, within: float = 30.0) -> bool:
    """Whether a process ends within a time, in seconds; zombies have ended."""
    until = time.monotonic() + within
    while time.monotonic() < until:
        try:
            if Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z":
                return True
        except OSError:
            return True
        time.sleep(0.02)
    return False
