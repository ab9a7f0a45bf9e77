"""The small networks in half precision, on CPUs that multiply bfloat16 matrices (AMX).

Inputs, outputs and trained weights are float32; activations in between are bfloat16 (8 bits of mantissa, the exponent
range of float32), and products are accumulated in float32. S samples.
"""

from __future__ import annotations

import os
from functools import cache

import torch
from torch import Tensor

from svv.kernels.types import Context

LEAST_SAMPLES = 4096
"""Fewest samples for which bfloat16 is faster; fewer are multiplied in float32."""

SAMPLES_MULTIPLE = 1024
"""Number to whose multiples the number of samples is rounded up: a product is prepared for each new shape of its
matrices, which takes longer than the product itself."""


@cache
def cpu_has_bfloat16() -> bool:
    """Return whether this CPU multiplies bfloat16 matrices in hardware and torch can use that."""
    ask = getattr(torch.cpu, "get_capabilities", None)  # missing before torch 2.7
    if ask is None or not ask().get("amx_bf16") or not hasattr(torch.ops.mkldnn, "_linear_pointwise"):
        return False
    # oneDNN cannot be asked what it may use. Held to AVX-512, it multiplies these matrices all the same, slowly. It
    # takes names in any case, and all instructions for a name that it does not know.
    most = os.environ.get("ONEDNN_MAX_CPU_ISA") or os.environ.get("DNNL_MAX_CPU_ISA") or ""
    return "AMX" in most.upper() or not most.upper().startswith(("SSE", "AVX"))


class HalfNetwork(torch.autograd.Function):
    """Linear layers without biases, with ReLU between them: x (S, I) and weights (O, I) each -> (S, O)."""

    @staticmethod
    def forward(ctx: Context, x: Tensor, *weights: Tensor) -> Tensor:
        halves = [w.bfloat16() for w in weights]
        inputs = [_padded(x)]
        for w in halves[:-1]:
            inputs.append(torch.ops.mkldnn._linear_pointwise(inputs[-1], w, None, "relu", [], ""))
        out = torch.ops.mkldnn._linear_pointwise(inputs[-1], halves[-1], None, "none", [], "")
        ctx.save_for_backward(*inputs, *halves)
        return out[: len(x)].float()

    @staticmethod
    def backward(ctx: Context, upstream: Tensor) -> tuple[Tensor | None, ...]:
        saved = ctx.saved_tensors
        count = len(saved) // 2
        g, gradients = _padded(upstream), []
        for k in range(count - 1, -1, -1):
            x, w = saved[k], saved[count + k]
            gradients.append((g.T @ x).float())
            if k:
                g = torch.ops.aten.threshold_backward(g @ w, x, 0)
        of_input = (g @ saved[count])[: len(upstream)].float() if ctx.needs_input_grad[0] else None
        return (of_input, *gradients[::-1])


def _padded(x: Tensor) -> Tensor:
    """Convert to bfloat16 and pad with zero rows."""
    out = torch.empty(-(-len(x) // SAMPLES_MULTIPLE) * SAMPLES_MULTIPLE, x.shape[1], dtype=torch.bfloat16)
    out[: len(x)] = x
    out[len(x) :] = 0.0
    return out
