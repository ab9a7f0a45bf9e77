"""The Triton kernels become machine code for a GPU, which takes none: what the interpreter lets pass is found here."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

TYPES = {
    "*fp32": "x g_out scales table out gradient first second rotations positions focal origins directions tail "
    "position skipped sigma values transmittance weights g_transmittance g_sigma g_values",
    "*i64": "shapes bases resolutions offsets pixels start count",
    "*i32": "index age ray",
    "*u8": "used distance",
    "fp32": "rate beta1 beta2 epsilon pull cells extent_x extent_y extent_z step ceiling least_weight keep stop fade",
    "i32": "samples rows finer width height rays nx ny nz seed",
}
"""Triton's names of types -> arguments of our kernels that have them."""
TYPE_OF = {name: kind for kind, names in TYPES.items() for name in names.split()}
TABLE = {"LEVELS": 4, "FEATURES": 3, "WIDE": 4, "BLOCK": 128}
RAYS = {"CHANNELS": 6, "WIDE": 8, "BLOCK": 32}
FULL = {"LEVELS": 2, "KEEPS": True, "MERGE": False, "JITTERS": True, "BLOCK": 32}
IMAGE = {"LEVELS": 1, "KEEPS": False, "MERGE": True, "JITTERS": False, "BLOCK": 32}
KERNELS: list[tuple[str, dict[str, Any]]] = [
    ("lattice_encode", TABLE),
    ("lattice_backward", TABLE),
    ("hash_encode", TABLE),
    ("hash_backward", TABLE),
    ("adam", {"FEATURES": 3, "WIDE": 4, "BLOCK": 128}),
    ("pixel_rays", {"BLOCK": 128}),
    ("march", {**FULL, "WRITES": False}),
    ("march", {**IMAGE, "WRITES": True}),
    ("composite", RAYS),
    ("composite_backward", RAYS),
]
HOPPER = 90


def compile_all() -> None:
    """Compile every kernel; raises what Triton raises."""
    import triton
    from triton.backends.compiler import GPUTarget
    from triton.compiler import ASTSource

    from svv.kernels import fused_rays, fused_tables

    for name, constants in KERNELS:
        kernel = getattr(fused_tables, name, None) or getattr(fused_rays, name)
        signature = {k: "constexpr" if k in constants else TYPE_OF[k] for k in kernel.arg_names}
        source = ASTSource(kernel, signature, constants)
        warps = 1 if constants["BLOCK"] == 32 else 4
        done = triton.compile(source, target=GPUTarget("cuda", HOPPER, 32), options={"num_warps": warps})
        print(name, len(done.asm["cubin"]))


def test_every_kernel_compiles(tmp_path: Path) -> None:
    root = Path(__file__).resolve().parents[1]
    environment = {k: v for k, v in os.environ.items() if k != "TRITON_INTERPRET"}
    environment |= {"TRITON_CACHE_DIR": str(tmp_path), "PYTHONPATH": str(root)}
    done = subprocess.run([sys.executable, __file__], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-3000:]
    assert [line.split()[0] for line in done.stdout.splitlines()] == [name for name, _ in KERNELS]


if __name__ == "__main__":
    compile_all()
