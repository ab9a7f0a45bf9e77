"""Training with a volume that has fill values: scores on unseen views, with the block of such values and without.

usage: python docs/measurements/fill_values.py
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from svv import TransferFunction, evaluate_scene, make_views, train_scene
from svv.dvr.read.grids import from_array

FILLS = (None, -999.0, -99999.0, 1e20)
"""Values of a block of 4 x 3 x 4 voxels where the volume shows nothing."""


def ball() -> np.ndarray:
    """A ball with ridges, from 0 to 1, and two corners that keep the box that of the whole volume."""
    z, y, x = np.meshgrid(*[np.linspace(-1, 1, 48)] * 3, indexing="ij")
    values = np.exp(-3 * (x * x + y * y + z * z)) + 0.1 * np.sin(6 * z) * np.sin(5 * y)
    values = ((values - values.min()) / np.ptp(values)).astype(np.float32)
    values[1, 1, 1] = values[-2, -2, -2] = 1.0
    values[38:46, 1:8, 38:46] = 0.0
    return values


def main() -> None:
    """Print a line for each fill value."""
    opacities = [(0, 0), (0.3, 0), (0.4, 0.3), (0.5, 0), (0.7, 0), (0.8, 0.8), (1, 0.8)]
    plain = TransferFunction(
        [(0, 0, 0, 1), (0.5, 0, 1, 0), (1, 1, 0, 0)], [(v, a, 0.5, 0) for v, a in opacities], unit_distance=1.0
    )
    for fill in FILLS:
        values, function = ball(), plain
        if fill is not None:
            values[40:44, 3:6, 40:44] = fill
            if fill > 0:  # not to be seen
                function = replace(plain, opacities=(*plain.opacities, (1.5, 0.8, 0.5, 0), (2, 0, 0.5, 0)))
        views, unseen = make_views(from_array(values), function, n=24, test=4, size=128, rescale=False)
        assert unseen is not None
        scene, _ = train_scene(views, "draft")
        print(f"{fill}: {evaluate_scene(scene, unseen).psnr:.1f} dB", flush=True)


if __name__ == "__main__":
    main()
