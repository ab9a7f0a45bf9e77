"""3D Gaussian splats: the record that fitting makes and that files hold.

Kerbl, Kopanas, Leimkühler and Drettakis, "3D Gaussian Splatting for Real-Time Radiance Field Rendering", ACM TOG 2023.
Letters: N splats, K harmonics.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from svv.errors import BadInput

Floats = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Splats:
    """Gaussians that are drawn sorted by depth, each over those behind it.

    >>> splats = svv.Splats(
    ...     centres=np.zeros((2, 3), "f4"), scales=np.ones((2, 3), "f4"), rotations=np.eye(4, dtype="f4")[[0, 0]],
    ...     opacities=np.ones(2, "f4"), harmonics=np.zeros((2, 1, 3), "f4"), regions=np.zeros(2, "i2"),
    ...     names=("bone",), background=(1.0, 1.0, 1.0))
    >>> len(splats)
    2
    """

    centres: Floats
    """In world units. (N, 3)"""
    scales: Floats
    """Standard deviations along the splat's axes, in world units, above 0. (N, 3)"""
    rotations: Floats
    """Unit quaternions w, x, y, z that turn the splat's axes into the world's. (N, 4)"""
    opacities: Floats
    """Opacity of a pixel at the centre, in [0, 1]. (N,)"""
    harmonics: Floats
    """Coefficients c_k of real spherical harmonics: the sRGB colour seen along a unit direction d, from the eye to the
    centre, is 0.5 + sum c_k Y_k(d), at least 0, with the basis and signs of 3DGS. K is 1, 4, 9 or 16. (N, K, 3)"""
    regions: NDArray[np.int16]
    """Number of the scene's region to which each belongs. (N,)"""
    names: tuple[str, ...]
    """Names of the regions."""
    background: tuple[float, float, float]
    """Colour behind the splats, sRGB in [0, 1]."""

    def __len__(self) -> int:
        return len(self.centres)

    def hidden(self, *regions: int | str) -> Splats:
        """Return the splats without those of some regions, by number or name; raises BadInput if there is no such one.

        Splats are where pictures showed something: to see what a region covers, hide it in the scene instead.

        >>> two = Splats(
        ...     centres=np.zeros((2, 3), "f4"), scales=np.ones((2, 3), "f4"), rotations=np.eye(4, dtype="f4")[[0, 0]],
        ...     opacities=np.ones(2, "f4"), harmonics=np.zeros((2, 1, 3), "f4"), regions=np.array([0, 1], "i2"),
        ...     names=("bone", "skin"), background=(1.0, 1.0, 1.0))
        >>> two.hidden("skin").regions.tolist()
        [0]
        """
        kept = np.ones(len(self), np.bool_)
        for region in regions:
            numbers = [k for k, name in enumerate(self.names) if region in (k, name)]
            if not numbers:
                raise BadInput(f"There is no region {region!r} among these splats, only {', '.join(self.names)}.")
            kept &= ~np.isin(self.regions, numbers)
        arrays = ("centres", "scales", "rotations", "opacities", "harmonics", "regions")
        return replace(self, **{name: getattr(self, name)[kept] for name in arrays})
