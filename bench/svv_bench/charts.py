"""Requirements of charts besides those of the package."""

from __future__ import annotations

from importlib.util import find_spec

from svv.errors import BadInput


def need_matplotlib() -> None:
    """Check that matplotlib is installed; a checkout may be used without it, as on a GPU machine.

    Raises:
        BadInput: matplotlib is missing.
    """
    if find_spec("matplotlib") is None:
        raise BadInput("Charts need matplotlib, which is not installed; install it with: pip install matplotlib.")
