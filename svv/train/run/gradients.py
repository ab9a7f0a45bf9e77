"""Gradients that several ranks sum (:mod:`svv.train.run.ranks`)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch
import torch.distributed as dist
from torch import Tensor

from svv.fields.radiance.encodings import Encoding
from svv.kernels.dispatch import kernels_for
from svv.train.run.ranks import add_up, all_there, many


def sum_gradients(loss: Tensor, parameters: Sequence[Tensor], encodings: Sequence[Encoding]) -> Tensor:
    """Sum gradients over the ranks, of tables only the rows that any rank has used; returns the summed loss, a scalar.

    First the marks of used rows are joined, one bit a row; then the gradients of these rows, in the buffers of
    ``encodings``, and of the networks' ``parameters`` are summed in one piece.
    """
    if not many():
        return loss.detach()
    buffers = [encoding.buffers_for_gradient() for encoding in encodings]
    _join_marks([used for _, used in buffers])
    rows = [kernels_for(used).marked_rows(used) for _, used in buffers]
    shapes = [tuple(p.shape) for p in parameters]
    shapes += [(len(its), gradient.shape[1]) for (gradient, _), its in zip(buffers, rows, strict=True)]
    sizes = [math.prod(shape) for shape in shapes]
    every = loss.new_empty(sum(sizes) + 1)
    parts = [part.view(shape) for part, shape in zip(every[:-1].split(sizes), shapes, strict=True)]
    networks, tables = parts[: len(parameters)], parts[len(parameters) :]
    for parameter, part in zip(parameters, networks, strict=True):
        part.copy_(parameter.grad) if parameter.grad is not None else part.zero_()
    for (gradient, _), its, part in zip(buffers, rows, tables, strict=True):
        torch.index_select(gradient, 0, its, out=part)
    every[-1] = loss.detach()
    add_up(every)
    for parameter, part in zip(parameters, networks, strict=True):
        parameter.grad = part
    for (gradient, _), its, part in zip(buffers, rows, tables, strict=True):
        gradient.index_copy_(0, its, part)
    return every[-1]


def _join_marks(marks: Sequence[Tensor]) -> None:
    """Mark the rows that are marked in any rank."""
    joined, sizes = torch.cat(tuple(marks)), [len(mark) for mark in marks]
    with all_there():
        if joined.is_cuda:  # NCCL has no logical operations
            dist.all_reduce(joined, dist.ReduceOp.MAX)
        else:
            bits = torch.from_numpy(np.packbits(joined.numpy()))
            dist.all_reduce(bits, dist.ReduceOp.BOR)
            joined = torch.from_numpy(np.unpackbits(bits.numpy(), count=len(joined)))
    for mark, own in zip(marks, joined.split(sizes), strict=True):
        mark.copy_(own)
