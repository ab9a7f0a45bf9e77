"""The Triton kernels compiled to GPU machine code, which needs no GPU and nothing of the tests."""

from __future__ import annotations

import sys
from typing import Any

TYPES = {
    "*fp32": "x g_out scales table out gradient first second rotations positions lenses origins directions tail "
    "position skipped sigma values transmittance weights g_transmittance g_sigma g_values first middle last g_x parts "
    "begin end passed shift where place around points strokes noise look tint covered below left harmonics tables lit "
    "plain raw colours diffuse paint share colour followed lights facing toward half normals coefficients opacity rgba "
    "depth images sums weight shown rate pull penalties g_values g_weights g_raw g_light light each g_density "
    "begins finishes pixel cosine along member error root ahead following",
    "*i64": "shapes bases index resolutions offsets pixels start count own chosen taken region ends dropped",
    "*fp64": "apart shares",
    "*i32": "seed age ray number entries of seeds vertices vertex neighbours",
    "*i16": "seen",
    "*u8": "used distance known nearest near levels",
    "fp32": "beta1 beta2 epsilon cells extent_x extent_y extent_z step ceiling least_weight keep stop fade "
    "cuts merge brightness bare floor intensity scale soft rim grazing faint bright gleam "
    "kept least smoothness momentum",
    "i32": "samples rows finer width height rays channels nx ny nz first_ray inputs outputs size stride length "
    "side before until regions total most columns pieces",
}
"""Triton's names of types -> arguments of our kernels that have them."""
TYPE_OF = {name: kind for kind, names in TYPES.items() for name in names.split()}
LEVELS, COUNT = {"levels": "i32"}, {"count": "i32"}
AT_VERTICES = {"first": "*i32"}
OWN_TYPES = {
    "lattice_encode": LEVELS,
    "lattice_backward": LEVELS,
    "hash_encode": LEVELS,
    "hash_backward": LEVELS,
    "features": LEVELS,
    "phong": {**LEVELS, **COUNT, "shift": "fp32", "each": "i32"},
    "representatives": {"place": "*i64"},
    "ground": {"cells": "i32", "first": "*i64", "offsets": "*i32"},
    "material": {**COUNT, "shift": "fp32"},
    "light": {"shift": "fp32"},
    "depths": {"shift": "fp32"},
    "carved": {
        **dict.fromkeys(("rotations", "positions", "lenses", "sizes"), "*fp64"),
        **dict.fromkeys(("number", "count"), "i32"),
        "tables": "*i32",
        "occupied": "*u8",
    },
    "image_composite": {"size": "fp32"},
    "projected_back": {**COUNT, "number": "i32"},
    "mix": COUNT,
    "mix_backward": {**COUNT, "number": "*i64", "owner": "*i64", "foreign": "fp32"},
    "count_owned": {**COUNT, "number": "*i64", "owner": "*i64"},
    "draw": {"index": "*i32", "first": "*i64", "ends": "*fp64"},
    "march": {"total": "*i64"},
    "learn": {"place": "*i64", "alpha": "fp32"},
    "errors_of_rays": {**COUNT, **AT_VERTICES},
    "descend_at_vertices": {**COUNT, **AT_VERTICES, "step": "*fp32", "vertices": "i32"},
}
"""Those whose type is another one in a kernel."""
COUNTED_THERE = {
    "lattice_encode",
    "lattice_backward",
    "features",
    "network",
    "network_backward",
    "mix",
    "mix_backward",
    "count_owned",
}
"""Kernels that take the number of samples from the GPU in most steps of a training; as a number it is simpler."""
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
    ("lattice_backward", {**TABLE, "CHOSEN": True, "ALIKE": False}),
    ("lattice_backward", {**TABLE, "CHOSEN": False, "ALIKE": True}),
    ("hash_encode", TABLE),
    ("hash_backward", TABLE),
    ("adam", {"FEATURES": 3, "WIDE": 4, "BLOCK": 128}),
    ("pixel_rays", {"BLOCK": 128}),
    ("march", {"LEVELS": 2, "WRITES": False, "MARKED": True, "DIVIDED": True, "BLOCK": 32}),
    ("march", {"LEVELS": 1, "WRITES": True, "MARKED": False, "DIVIDED": False, "BLOCK": 32}),
    ("composite", RAYS),
    ("composite_backward", RAYS),
    ("cuts_of_rays", {"BLOCK": 32}),
    ("representatives", {"BLOCK": 32}),
    ("harmonics", {"BLOCK": 128}),
    ("nearest_along", {"BLOCK": 128}),
    ("draw", {"STEPS": 8, "BLOCK": 128}),
    ("end", {"BLOCK": 128}),
    ("features", {"FEATURES": 4, "WIDE": 8, "BOTH": True, "CHOSEN": False, "BLOCK": 128}),
    ("features", {"FEATURES": 4, "WIDE": 4, "BOTH": False, "CHOSEN": True, "BLOCK": 128}),
    ("material", {"BLOCK": 128}),
    ("overpaint", {"BLOCK": 128}),
    ("light", {"OUTPUTS": 2, "BLOCK": 128}),
    ("phong", {"BLOCK": 128}),
    ("image_composite", {"WIDE": 4, "BLOCK": 32}),
    ("sheets", {"WRITES": False, "BLOCK": 32}),
    ("sheets", {"WRITES": True, "BLOCK": 32}),
    ("paint", {"WASHES": False, "TOOTH": False, "BLOCK": 32}),
    ("paint", {"WASHES": True, "TOOTH": True, "BLOCK": 32}),
    ("ground", {"TINTED": False, "BLOCK": 32}),
    ("ground", {"TINTED": True, "BLOCK": 32}),
    ("cover", {"FLAT": True, "BLOCK": 128}),
    ("carved", {"FAR": 1 << 30, "MOST": 255, "BLOCK": 128}),
    ("depths", {"BLOCK": 32}),
    ("projected_back", {"BLOCK": 128}),
    ("mix", {"OUTPUTS": 2, "BLOCK": 128}),
    ("mix_backward", {"OUTPUTS": 2, "OWNED": True, "BLOCK": 128}),
    ("mix_backward", {"OUTPUTS": 1, "OWNED": False, "BLOCK": 128}),
    ("count_owned", {"BLOCK": 128}),
    ("learn", {"BASE": True, "CHANNELS": 3, "WIDE": 4, "BLOCK": 32}),
    ("learn", {"BASE": False, "CHANNELS": 6, "WIDE": 8, "BLOCK": 32}),
    ("error", {"ALPHA": True, "WIDE": 4, "BLOCK": 128}),
    ("error", {"ALPHA": False, "WIDE": 8, "BLOCK": 128}),
    ("errors_of_rays", {"WIDE": 8, "BLOCK": 32}),
    ("descend_at_vertices", {"WIDE": 8, "BLOCK": 32}),
]
SHARED = 65536
"""Bytes of shared memory that a program of the networks may use: what every GPU from Ampere on has."""
DESKTOP, BLACKWELL, HOPPER, AMPERE = 120, 100, 90, 80
EVERYWHERE = BLACKWELL, HOPPER, AMPERE
TARGETS = dict.fromkeys(("network", "network_backward"), EVERYWHERE)
"""GPUs for which the largest kernels are compiled; the others only for Hopper, or, slowly, all of them for more."""


def _found(places: tuple[Any, ...], name: str) -> Any:
    return next(getattr(place, name) for place in places if hasattr(place, name))


def targets_of(name: str, others: tuple[int, ...]) -> tuple[int, ...]:
    """Return the GPUs for which a kernel is compiled: ``others``, and its own."""
    return tuple(dict.fromkeys((*TARGETS.get(name, ()), *others)))


def compile_all(others: tuple[int, ...]) -> None:
    """Compile every kernel for ``others``, and some for more; raises what Triton raises."""
    import triton
    from triton.backends.compiler import GPUTarget
    from triton.compiler import ASTSource

    from svv.kernels.triton import (
        cells,
        image,
        learning,
        networks,
        pixels,
        rays,
        regions,
        sheets,
        strokes,
        tables,
        tomography,
        training,
    )

    blocks = {"network": networks.FORWARD.block, "network_backward": networks.BACKWARD.block}
    places = cells, tables, rays, networks, image, pixels, sheets, strokes, tomography, training, learning, regions
    for name, values in [*KERNELS, *NETWORKS]:
        kernel = image.composite if name == "image_composite" else _found(places, name)
        constants = values if name not in blocks else {**values, "BLOCK": blocks[name]}
        types = {**TYPE_OF, **OWN_TYPES.get(name, {}), **({"samples": "*i64"} if name in COUNTED_THERE else {})}
        signature = {k: "constexpr" if k in constants else types[k] for k in kernel.arg_names}
        source = ASTSource(kernel, signature, constants)
        for capability in targets_of(name, others):
            options = {"num_warps": 1 if constants["BLOCK"] == 32 else 4}
            if name in blocks:
                warps = networks.warps_for(divmod(capability, 10)) if name == "network_backward" else networks.WARPS
                options = {"num_warps": warps, "num_stages": 1}
            done = triton.compile(source, target=GPUTarget("cuda", capability, 32), options=options)
            products = sum(done.asm["ptx"].count(name) for name in ("tcgen05.mma", "wgmma.mma_async", "mma.sync"))
            print(name, len(done.asm["cubin"]), done.metadata.shared, products)


if __name__ == "__main__":
    compile_all(tuple(map(int, sys.argv[1:])))
