"""Choice of samples whose colour represents that of their neighbours on the ray: the reference for the kernels.

Letters: R rays, S samples (of all rays, one after another), K chosen samples.
"""

from __future__ import annotations

import torch
from torch import Tensor


def representatives(
    own: Tensor, skipped: Tensor, ray: Tensor, start: Tensor, count: Tensor, every: float, shift: Tensor
) -> tuple[Tensor, Tensor]:
    """Sample the weights along each ray systematically; see :func:`svv.fields.radiance.rendering.representatives`.

    ``own`` and ``skipped`` (S,): optical depth of each sample, and left out before it; ``start`` and ``count`` (R,):
    first sample and number of samples of each ray; ``every``: fraction of a pixel's weight between two cuts; ``shift``
    (R,): of each ray's cuts, in [0, 1). Returns rows of the chosen samples, ascending (K,), and for each sample the
    index in them of its representative (S,).
    """
    ray = ray.long()
    both = (skipped + own).double()
    total = both.cumsum(0)
    there = count > 0
    before = torch.zeros(len(count), dtype=torch.float64, device=ray.device)
    before[there] = (total - both)[start[there]]
    behind = total - before[ray]  # optical depth from the ray's beginning to the sample's end
    begin, end = (-torch.expm1(-tau).float() / every + shift[ray] for tau in (behind - own, behind))
    taken = end.floor() > begin.floor()
    cut = torch.zeros(len(before), dtype=torch.bool, device=ray.device)
    cut[ray[taken]] = True
    taken[(start + count - 1)[there & ~cut]] = True
    rows = torch.nonzero(taken)[:, 0]
    number = taken.cumsum(0)
    back, ahead = (number - 1).clamp(min=0), (number - taken.long()).clamp(max=len(rows) - 1)
    middle = 0.5 * (begin + end)
    passed, coming = middle - end.floor()[rows[back]], begin.floor()[rows[ahead]] + 1.0 - middle
    nearer = torch.where(passed < coming, back, ahead)
    other = back + ahead - nearer
    return rows, torch.where(taken, back, torch.where(ray[rows[nearer]] == ray, nearer, other))
