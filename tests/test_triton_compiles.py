"""The Triton kernels compile to GPU machine code, which needs no GPU and finds errors that the interpreter accepts."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

TYPES = {
    "*fp32": "x g_out scales table out gradient first second rotations positions lenses origins directions tail "
    "position skipped sigma values transmittance weights g_transmittance g_sigma g_values first middle last g_x parts "
    "begin end passed shift",
    "*i64": "shapes bases index resolutions offsets pixels start count own chosen place taken",
    "*i32": "age ray",
    "*u8": "used distance known nearest",
    "fp32": "rate beta1 beta2 epsilon pull cells extent_x extent_y extent_z step ceiling least_weight keep stop fade "
    "cuts merge",
    "i32": "samples levels rows finer width height rays channels nx ny nz seed first_ray inputs outputs size stride "
    "length side",
}
"""Triton's names of types -> arguments of our kernels that have them."""
TYPE_OF = {name: kind for kind, names in TYPES.items() for name in names.split()}
TABLE = {"FEATURES": 3, "WIDE": 4, "BLOCK": 128}
RAYS = {"WIDE": 8, "BLOCK": 32}
NETWORK = {"WIDE_IN": 64, "WIDE": 64, "WIDE_OUT": 64, "DEEP": True}
PALETTE = {"WIDE_IN": 16, "WIDE": 64, "WIDE_OUT": 16, "DEEP": False}
NETWORKS: list[tuple[str, dict[str, Any]]] = [
    ("network", NETWORK),
    ("network", PALETTE),
    ("network_backward", {**NETWORK, "INWARD": True}),
    ("network_backward", {**PALETTE, "INWARD": False}),
]
KERNELS: list[tuple[str, dict[str, Any]]] = [
    ("lattice_encode", TABLE),
    ("lattice_backward", TABLE),
    ("hash_encode", TABLE),
    ("hash_backward", TABLE),
    ("adam", {"FEATURES": 3, "WIDE": 4, "BLOCK": 128}),
    ("pixel_rays", {"BLOCK": 128}),
    ("march", {"LEVELS": 2, "WRITES": False, "BLOCK": 32}),
    ("march", {"LEVELS": 1, "WRITES": True, "BLOCK": 32}),
    ("composite", RAYS),
    ("composite_backward", RAYS),
    ("cuts_of_rays", {"BLOCK": 32}),
    ("representatives", {"BLOCK": 32}),
    ("harmonics", {"BLOCK": 128}),
    ("nearest_along", {"BLOCK": 128}),
]
SHARED = 65536
"""Bytes of shared memory that a program of the networks may use: what every GPU from Ampere on has."""
HOPPER, AMPERE = 90, 80


def compile_all() -> None:
    """Compile every kernel; raises what Triton raises."""
    import triton
    from triton.backends.compiler import GPUTarget
    from triton.compiler import ASTSource

    from svv.kernels.triton import networks as triton_networks
    from svv.kernels.triton import rays as triton_rays
    from svv.kernels.triton import tables as triton_tables

    blocks = {"network": triton_networks.FORWARD.block, "network_backward": triton_networks.BACKWARD.block}
    for name, values in [*KERNELS, *NETWORKS]:
        kernel = next(getattr(m, name) for m in (triton_tables, triton_rays, triton_networks) if hasattr(m, name))
        constants = values if name not in blocks else {**values, "BLOCK": blocks[name]}
        signature = {k: "constexpr" if k in constants else TYPE_OF[k] for k in kernel.arg_names}
        source = ASTSource(kernel, signature, constants)
        options = {"num_warps": 1 if constants["BLOCK"] == 32 else 4} | ({"num_stages": 1} if name in blocks else {})
        for capability in (HOPPER, AMPERE) if name in blocks else (HOPPER,):
            done = triton.compile(source, target=GPUTarget("cuda", capability, 32), options=options)
            products = done.asm["ptx"].count("wgmma.mma_async") + done.asm["ptx"].count("mma.sync")
            print(name, len(done.asm["cubin"]), done.metadata.shared, products)


@pytest.mark.slow
def test_every_kernel_compiles(tmp_path: Path) -> None:
    root = Path(__file__).resolve().parents[1]
    environment = {k: v for k, v in os.environ.items() if k != "TRITON_INTERPRET"}
    environment |= {"TRITON_CACHE_DIR": str(tmp_path), "PYTHONPATH": str(root)}
    done = subprocess.run([sys.executable, __file__], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-3000:]
    made = [line.split() for line in done.stdout.splitlines()]
    networks = [line for line in made if line[0].startswith("network")]
    assert [name for name, *_ in made if not name.startswith("network")] == [name for name, _ in KERNELS]
    assert [line[0] for line in networks] == [name for name, _ in NETWORKS for _ in (HOPPER, AMPERE)]
    assert all(int(shared) <= SHARED and int(products) > 0 for _, _, shared, products in networks)


if __name__ == "__main__":
    compile_all()
