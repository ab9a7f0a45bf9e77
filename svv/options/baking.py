"""Options for baking a scene into a volume that other programs draw."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from svv.options.described import Setting
from svv.options.making import DeviceName, NetworkName

BakedLight = Literal["none", "baked"]


@dataclass(frozen=True)
class BakeOptions:
    """How a scene becomes a volume of colours and extinctions."""

    resolution: Annotated[
        int | None, Setting(least=8, metavar="N", slider=(0, 1024), unset=0, unset_says="0: as fine as the scene.")
    ] = None
    """Most cells along the longest side; by default as in the scene's finest lattice."""
    memory: Annotated[float, Setting(least=0.001, metavar="GB", slider=(0.01, 4.0))] = 0.25
    """Gigabytes that the volume may take, 4 bytes a point; beyond it, the volume is coarser."""
    light: BakedLight = "none"
    """Light in the colours: none leaves it to the other program; baked is the mean over all directions that see a
    point."""
    regions: Annotated[tuple[int, ...] | None, Setting(metavar="K,...", syntax="regions", panel="")] = None
    """The only regions in the volume; by default all that are not hidden."""
    network: Annotated[NetworkName | None, Setting(command=False, unset="last")] = None
    """Network of the colours: pcn (palette and edits) or styled (painting); by default the scene's last."""
    device: Annotated[DeviceName, Setting(command=False, advanced=True, result=False)] = "auto"
    """Where to run; auto takes a GPU that passes a check (25 s on its first use), otherwise the CPU."""
