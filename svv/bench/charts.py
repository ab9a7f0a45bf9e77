"""What charts need beside the rest of the package."""

from __future__ import annotations

from importlib.util import find_spec

from svv.errors import BadInput


def need_matplotlib() -> None:
    """The base installation has none, since it stands inside ParaView.

    Raises:
        BadInput: matplotlib is missing.
    """
    if find_spec("matplotlib") is None:
        raise BadInput("Charts need matplotlib, which is not installed; install it with: pip install 'svv[bench]'.")
