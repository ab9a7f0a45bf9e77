"""A Python that has OpenVDB's module, which no package on PyPI brings: it runs :mod:`svv.io.openvdb_script`."""

from __future__ import annotations

import os
import subprocess
import sys

from svv.errors import BadInput

PYTHON = "SVV_OPENVDB_PYTHON"
"""Environment variable that names a Python with OpenVDB's module."""

SYSTEM = "/usr/bin/python3"
"""The Python for which Linux distributions package the module."""

MISSING = (
    "OpenVDB's files (.vdb) need its Python module, which {} not have: install it (Debian, Ubuntu: sudo apt-get "
    f"install python3-openvdb), or let {PYTHON} name a Python that has it."
)


def python_with_openvdb() -> str:
    """Return the path of a Python that has OpenVDB's module; raises BadInput if there is none."""
    named = os.environ.get(PYTHON)
    candidates = [named] if named else list(dict.fromkeys([sys.executable, SYSTEM]))
    find = "import importlib.util as u, sys; sys.exit(not any(map(u.find_spec, ('openvdb', 'pyopenvdb'))))"
    for python in candidates:
        try:
            if subprocess.run([python, "-c", find], capture_output=True).returncode == 0:
                return python
        except OSError:
            continue  # there is no such program
    raise BadInput(MISSING.format(f"{' and '.join(candidates)} do{'es' * (len(candidates) == 1)}"))
