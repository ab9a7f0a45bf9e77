"""Options of reading values off a scene (:mod:`svv.fields.scene.probing`)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from svv.options.described import Setting
from svv.options.making import DeviceName, NetworkName


@dataclass(frozen=True)
class ProbeOptions:
    """In which picture of a scene pixels are read off, and in which units."""

    at: Annotated[tuple[str, ...], Setting(metavar="X,Y", panel="")] = ()
    """Read off the pixel in this column from the left and row from the top; may be repeated."""
    camera: Annotated[Path | None, Setting(metavar="CAMERA.json", panel="")] = None
    """Camera of the picture, as in `svv render`; by default the orbit's middle, from the front."""
    frame: Annotated[int | None, Setting(least=0, panel="")] = None
    """Number of the picture's view, if the camera's file has several."""
    view: Annotated[str | None, Setting(metavar="AZ,EL", panel="")] = None
    """Side from which the picture is taken: degrees to the right of the front and above it."""
    size: Annotated[tuple[int, int] | None, Setting(metavar="N|WxH", syntax="size", panel="")] = None
    """Size of the picture in pixels; 800 by default."""
    network: Annotated[NetworkName | None, Setting(panel="")] = None
    """Network of the picture, as in `svv render`; by default the scene's last."""
    variant: Annotated[str | None, Setting(metavar="NAME", panel="")] = None
    """Painting that the picture shows; by default the scene's own."""
    time: Annotated[float | None, Setting(metavar="TIME", panel="")] = None
    """Time of a scene that has time steps."""
    unit: Annotated[str | None, Setting(metavar="UNIT")] = None
    """Unit of the volume's lengths, such as mm or µm."""
    value_unit: Annotated[str | None, Setting(metavar="UNIT")] = None
    """Unit of the volume's values, such as HU."""
    device: Annotated[DeviceName, Setting(result=False, panel="")] = "auto"
    """Where to run; auto takes a GPU that passes a check (25 s on its first use), otherwise the CPU."""
