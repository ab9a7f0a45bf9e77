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
    """Most cells along the longest side of the scene's box; by default as in its finest lattice."""
    memory: Annotated[float, Setting(least=0.001, metavar="GB", slider=(0.01, 4.0))] = 0.25
    """Gigabytes that the volume may take, 4 bytes for each point; it is coarser if it would be larger."""
    light: BakedLight = "none"
    """Light in the colours: none leaves it to the other program; baked is the mean over all directions from which a
    point is seen."""
    regions: Annotated[tuple[int, ...] | None, Setting(metavar="K,...", syntax="regions", panel="")] = None
    """Numbers of the only regions in the volume; by default all that are not hidden."""
    network: Annotated[NetworkName | None, Setting(command=False, unset="last")] = None
    """Which network gives the colours: pcn (the palette, with its edits) or styled (the painting); by default the last
    that the scene has."""
    device: Annotated[DeviceName, Setting(command=False, advanced=True, result=False)] = "auto"
    """Where to run; auto takes a GPU whose kernels pass a check, 25 s on its first use, otherwise the CPU."""
