"""How far rays may leap over empty cells, in Triton; see :func:`svv.core.rays.cells.leaps`."""

from __future__ import annotations

import triton
import triton.language as tl


@triton.jit(do_not_specialize=["known", "nearest", "size", "stride", "length", "side"])
def nearest_along(known, nearest, size, stride, length, side, BLOCK: tl.constexpr):  # type: ignore[no-untyped-def]
    """Extend chessboard distances ``known`` for the previous axes along one more, ``length`` cells long.

    Only cells that follow (``side`` 1) or come before (-1) count; see :func:`svv.core.rays.cells.leaps`.
    """
    i = tl.program_id(0) * BLOCK + tl.arange(0, BLOCK)
    place = (i // stride) % length
    first = known + i - place * stride
    least = tl.full((BLOCK,), 255, tl.int32)
    for k in range(length):
        beyond = tl.load(first + k * stride, mask=i < size, other=255).to(tl.int32)
        apart = (k - place) * side
        least = tl.minimum(least, tl.where(apart >= 0, tl.maximum(apart, beyond), 255))
    tl.store(nearest + i, least.to(tl.uint8), mask=i < size)
