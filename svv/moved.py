"""Modules that the documentation named and that have moved: their old names work for one release, with a warning."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_loader
from types import ModuleType

MOVED = {
    "svv.core.cameras": "svv.core.geometry.cameras",
    "svv.core.correction": "svv.core.colour.correction",
    "svv.dvr.transfer_functions": "svv.dvr.functions.transfer_functions",
    "svv.dvr.views": "svv.dvr.draw.views",
    "svv.fields.region": "svv.fields.scene.region",
    "svv.io.atomic": "svv.io.files.atomic",
    "svv.io.images": "svv.io.pictures.style_picture",
    "svv.io.output": "svv.io.pictures.output",
    "svv.io.viewset": "svv.io.views.viewset",
    "svv.pv.orbit": "svv.pv.client.orbit",
    "svv.render.baked": "svv.render.baking.baked",
    "svv.render.openvdb": "svv.render.baking.openvdb",
    "svv.train.ink": "svv.train.paint.ink",
}
"""Old name -> new name."""


class MovedModules(MetaPathFinder, Loader):
    """Finds moved modules by their old names, after everything else has been tried."""

    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        """Return where a module is, if this is the old name of one."""
        return spec_from_loader(name, self) if name in MOVED else None

    def exec_module(self, module: ModuleType) -> None:
        """Put the module itself in the place of its old name."""
        old = module.__name__
        warnings.warn(f"{old} is now {MOVED[old]}.", DeprecationWarning, stacklevel=2)
        sys.modules[old] = import_module(MOVED[old])
