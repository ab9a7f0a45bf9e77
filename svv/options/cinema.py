"""Options for reading views from a Cinema database, and for writing a scene as one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from svv.options.described import Setting
from svv.options.making import DeviceName, NetworkName


@dataclass(frozen=True)
class DatabaseOptions:
    """Which images of a Cinema database become views, and what it does not say about their cameras."""

    select: Annotated[tuple[str, ...], Setting(metavar="COLUMN=VALUE")] = ()
    """Use the images with this value of a parameter, such as time=0.5; by default the first value."""
    black: Annotated[str | None, Setting(metavar="DATABASE|PRODUCER")] = None
    """The same images over black, if DATABASE has them over white: the two give exact alpha."""
    cameras: Annotated[Path | None, Setting(metavar="FILE")] = None
    """ParaView state (.pvsm), Python or Catalyst script, or camera.json, with the view that was extracted."""
    focal_point: Annotated[tuple[float, float, float] | None, Setting(metavar="X,Y,Z", syntax="point")] = None
    """Point that the cameras look at, in world units; the origin by default."""
    distance: Annotated[float | None, Setting(metavar="D")] = None
    """Distance of the cameras from it in world units; 1 by default."""
    view_angle: Annotated[float | None, Setting(least=0.01, most=179, metavar="DEGREES")] = None
    """Full vertical angle of view; by default estimated from the silhouettes."""
    parallel_scale: Annotated[float | None, Setting(metavar="S")] = None
    """Half the height of the images in world units, if the cameras are orthographic."""
    alpha: Literal["auto", "straight", "premultiplied"] = "auto"
    """Whether colours are multiplied by alpha (premultiplied); auto looks at all translucent pixels."""
    ignore_fixed: Annotated[bool, Setting("--ignore-fixed")] = False
    """Leave out what stands still on the screen: colour bars, axes, logos, text."""
    n: Annotated[int, Setting(least=3)] = 200
    """Use at most this many training views, spread evenly."""
    test: Annotated[int | None, Setting(least=0)] = None
    """Number of views to keep for the scores; by default one in eight, at most 16."""


@dataclass(frozen=True)
class ExportOptions:
    """Which views of a scene a Cinema database contains."""

    phi: Annotated[int, Setting(least=1, most=360)] = 12
    """For .cdb: number of directions about the y axis."""
    theta: Annotated[int, Setting(least=1, most=180)] = 8
    """For .cdb: number of latitudes, evenly spread without the poles."""
    size: Annotated[int, Setting(least=16)] = 800
    """For .cdb: width and height of the images in pixels."""
    layers: Annotated[bool, Setting("--layers/--no-layers")] = True
    """For .cdb: also write depth and an image of each region."""
    network: NetworkName | None = None
    """Network of the colours: base, pcn or styled; by default the scene's last."""
    device: Annotated[DeviceName, Setting(result=False)] = "auto"
    """Where to run; auto takes a GPU that passes a check (25 s on its first use), otherwise the CPU."""
