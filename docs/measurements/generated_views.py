"""Draw views of a generated volume of any size, of which nothing but the bricks in view is ever made.

usage: generated_views.py [SIDE [VIEWS [SIZE]]]     8192 voxels a side, 4 views, 800 pixels by default
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

from svv.dvr.draw.large import LargeVolume
from svv.dvr.draw.views import make_views
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.measure import measured
from svv_bench.volume_size.generated import GeneratedSource

SHELLS = (
    {"centre": 60, "width": 40, "opacity": 0.04, "colour": (0.15, 0.5, 1.0)},
    {"centre": 140, "width": 40, "opacity": 0.4, "colour": (0.9, 0.15, 0.35)},
    {"centre": 225, "width": 70, "opacity": 0.9, "colour": (1.0, 0.75, 0.2)},
)


def main() -> None:
    given = sys.argv[1:4]
    side, views, size = (int(text) for text in (*given, *("8192", "4", "800")[len(given) :]))
    with measured() as cost:
        volume = LargeVolume(GeneratedSource(side), 1_000_000_000)
        function = TransferFunction.from_bumps(SHELLS, "shells", 2.0 / 64)
        began = time.process_time()
        made, _ = make_views(volume, function, n=max(views, 3), test=0, size=size, rescale=False)
    made.write(Path(f"generated-{side}"), "train")
    print(
        f"{side}^3 voxels, {len(made.cameras)} views of {size} x {size}: {cost.seconds:.1f} s, "
        f"{time.process_time() - began:.1f} CPU s, {cost.peak_rss_bytes / 1e9:.2f} GB"
    )


if __name__ == "__main__":
    main()
