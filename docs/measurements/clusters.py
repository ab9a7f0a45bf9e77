"""Predict what nodes of a cluster need for a volume, from figures that were measured on two cores.

usage: clusters.py     prints the table of clusters.md
"""

from __future__ import annotations

from dataclasses import dataclass

VOXELS = 8192**3
VIEWS = 108

PYRAMID_CPU = 8.0 / 2048**3
"""CPU seconds per voxel of one byte for the pyramid."""
BRICK_CPU = 12.2 / 26_000
"""CPU seconds to read and prepare a brick."""
VIEW_CPU = 2.0
"""CPU seconds of a view of 800 x 800 whose bricks are there."""
BRICKS = 32_000
"""Bricks of the level that views of 800 x 800 need, whatever the volume's size."""
CLASSIFY_CPU = 3.6
"""CPU seconds for visible part and classified volume, from the level of at most 512 voxels a side."""
TRAIN_CPU = 600.0
"""CPU seconds of training with the preset balanced."""
STEPS = 3000
"""Steps of both stages together."""
SERIAL = 0.3
"""Part of a step that does not become less with more ranks (two ranks need 20 to 49 % more CPU than one)."""


STEP_BYTES = 2e6
"""Bytes of gradients that a rank contributes to a step: ten times those of a ball of fog (processes.md)."""


@dataclass(frozen=True)
class Cluster:
    """Nodes of two cores, as measured, each with a network interface; the storage is shared."""

    nodes: int
    network: float = 1.25e9
    """Bytes per second of a node's interface (10 Gbit/s)."""
    storage: float = 10e9
    """Bytes per second of the shared storage, all nodes together."""
    latency: float = 50e-6
    """Seconds of a message."""

    def pyramid(self) -> tuple[float, str]:
        """Seconds for the pyramid, and what limits it."""
        compute = VOXELS * PYRAMID_CPU / (2 * self.nodes)
        reading = VOXELS / min(self.storage, self.nodes * self.network)
        slowest = "the storage" if self.nodes * self.network > self.storage else "the nodes' network"
        return max(compute, reading), "the nodes' cores" if compute > reading else slowest

    def views(self) -> tuple[float, str]:
        """Seconds for all views, divided among the nodes, each of which reads the bricks for its own."""
        share = -(-VIEWS // self.nodes)
        compute = (BRICKS * BRICK_CPU + share * VIEW_CPU) / 2
        reading = self.nodes * BRICKS * 35**3 / self.storage
        if reading > compute:
            return reading, "every node reads the same bricks"
        return compute, "every node prepares the same bricks" if BRICKS * BRICK_CPU > share * VIEW_CPU else "casting"

    def training(self, step_bytes: float) -> tuple[float, str]:
        """Seconds for training with rays divided among the nodes."""
        step = TRAIN_CPU / STEPS / 2
        compute = step * (SERIAL + (1.0 - SERIAL) / self.nodes)
        rounds = 2.0 * (self.nodes - 1) / self.nodes
        sending = rounds * step_bytes / self.network + 2.0 * (self.nodes - 1).bit_length() * self.latency
        return STEPS * (compute + sending), "the network" if sending > compute else "the cores"


def main() -> None:
    print("| nodes | pyramid | limit | views | limit | training | limit |\n" + "|---" * 7 + "|")
    for nodes in (1, 8, 64, 1024):
        cluster, cells = Cluster(nodes), [f"{nodes:,}"]
        for seconds, limit in (cluster.pyramid(), cluster.views(), cluster.training(STEP_BYTES)):
            cells += [f"{seconds:,.0f} s", limit]
        print(f"| {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
