"""Gives ParaView before 5.12 back ``inspect.getargspec``, which Python 3.11 removed: without it no Python plugin loads.

ParaView imports its own use of it before any plugin, so this has to run first, from a folder on PYTHONPATH.
"""

import importlib.util
import inspect
import os
import sys
from importlib.machinery import PathFinder

if not hasattr(inspect, "getargspec"):
    inspect.getargspec = inspect.getfullargspec  # type: ignore[attr-defined]  # ParaView only asks it for .args


def _run_the_next() -> None:
    """Run the sitecustomize that this one hides: Python takes only the first on its path."""
    here = os.path.dirname(os.path.realpath(__file__))
    others = [folder for folder in sys.path if os.path.realpath(folder) != here]
    spec = PathFinder.find_spec("sitecustomize", others)
    if spec is not None and spec.loader is not None:
        spec.loader.exec_module(importlib.util.module_from_spec(spec))


_run_the_next()
