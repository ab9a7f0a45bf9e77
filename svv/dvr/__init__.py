"""Direct volume rendering with VTK: volumes, transfer functions and the views that a scene is trained on."""

from __future__ import annotations

from importlib.util import find_spec

from svv.errors import BadInput

if find_spec("vtkmodules") is None:
    raise BadInput("Volumes need VTK, which is not installed; install it with: pip install 'svv[standalone]'.")
