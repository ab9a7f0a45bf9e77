"""Transfer functions by the names of colour maps and opacities, as PyVista's ``add_volume`` takes them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from svv.errors import BadInput
from svv.render.show import need_pyvista

if TYPE_CHECKING:
    import pyvista

ENTRIES = 256
"""Number of colours, as ``add_volume`` has them by default."""


def colour_map(cmap: Any = None, opacity: Any = "linear", span: Sequence[float] = (0.0, 1.0)) -> pyvista.VolumeProperty:
    """Return the property that ``pyvista.Plotter.add_volume`` gives a volume of one number per voxel.

    ``cmap`` is a name, a list of colours, or a ``matplotlib.colors.Colormap``, by default that of PyVista's theme; a
    ``pyvista.LookupTable`` is used as it is. ``opacity`` is as ``add_volume`` takes it; ``span`` are the values of the
    first and the last colour, ascending. Raises BadInput if PyVista is missing, or does not know the colour map or
    opacity.
    """
    found = need_pyvista()
    if isinstance(cmap, found.LookupTable):
        return found.VolumeProperty(lookup_table=cmap)
    table = found.LookupTable()
    try:
        table.apply_cmap(found.get_cmap_safe(found.global_theme.cmap if cmap is None else cmap), ENTRIES)
        table.apply_opacity(opacity)
    except (ImportError, RuntimeError, TypeError, ValueError) as error:
        reason = str(error).splitlines()[0].rstrip(".")
        raise BadInput(
            f"PyVista has no transfer function of cmap={cmap!r} and opacity={opacity!r}: {reason}."
        ) from None
    table.scalar_range = tuple(float(value) for value in span)
    return found.VolumeProperty(lookup_table=table)
