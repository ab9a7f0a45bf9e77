"""Options for fitting Gaussian splats to a scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from svv.options.described import Setting
from svv.options.making import NetworkName, TimeLimit

DegreeName = Literal["auto", "0", "1", "2", "3"]

MOST_SPLATS = 10_000_000
"""Beyond it, no viewer shows them."""


@dataclass(frozen=True)
class SplatOptions:
    """How a scene becomes Gaussian splats.

    >>> svv.SplatOptions(count=20_000).degree
    'auto'
    """

    count: Annotated[
        int, Setting("--splats", least=100, most=MOST_SPLATS, metavar="N", panel="Splats", slider=(1_000, 200_000))
    ] = 60_000
    """For splats: how many at most; more are sharper and take more memory and time."""
    degree: DegreeName = "auto"
    """For splats: degree of the harmonics with which colours follow the viewer; auto tries what they gain."""
    steps: Annotated[int, Setting(least=1, slider=(1, 2_000))] = 500
    """For splats: number of pictures that they are fitted to, one after the other, again and again."""
    time_limit: TimeLimit = None
    """For splats: fit for at most this many seconds."""
    seed: Annotated[int, Setting(least=0, advanced=True)] = 0
    """For splats: the same seed gives the same ones, unless a time limit ends the fit."""
    network: Annotated[NetworkName | None, Setting(panel="", command=False)] = None
    """Network of the colours: base, pcn (palette and edits) or styled (painting); by default the scene's last."""
