"""Restore ``inspect.getargspec``, removed in Python 3.11, for ParaView before 5.12: no Python plugin loads without it.

ParaView uses it before it loads any plugin, so this module must run first, from a folder on PYTHONPATH.
"""

import importlib.util
import inspect
import os
import sys
from importlib.machinery import PathFinder

if not hasattr(inspect, "getargspec"):
    inspect.getargspec = inspect.getfullargspec  # type: ignore[attr-defined]  # ParaView only asks it for .args


def _run_the_next() -> None:
    """Run the sitecustomize module that this one hides, because Python imports only the first one on its path."""
    here = os.path.dirname(os.path.realpath(__file__))
    others = [folder for folder in sys.path if os.path.realpath(folder) != here]
    spec = PathFinder.find_spec("sitecustomize", others)
    if spec is not None and spec.loader is not None:
        spec.loader.exec_module(importlib.util.module_from_spec(spec))


_run_the_next()
