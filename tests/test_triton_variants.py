"""How many variants of the kernels a training compiles: each takes seconds on its first use."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from torch import Tensor

from svv.job.compile_ahead import ball_views
from svv.kernels import dispatch, reference
from svv.kernels.types import Kernels
from svv.train.pipeline import train_scene
from svv.train.run.config import changed, preset
from tests.interpreted import GPU, triton_cells, triton_kernels, triton_networks, triton_rays, triton_tables

MOST = 25
"""Variants of all kernels that a cold training with an image may compile."""


NEEDED = ("march", "count"), ("cuts_of_rays", "taken")
"""Results without which the next launch would not take place."""


class Recorded:
    """A kernel that only records what Triton would compile it for: constants, types, and what it specializes."""

    def __init__(self, kernel: Any, found: set[tuple[Any, ...]]) -> None:
        self.kernel, self.found = kernel, found
        self.parameters = inspect.signature(kernel.fn).parameters
        self.plain = set(kernel.kwargs.get("do_not_specialize") or ())

    def __getitem__(self, grid: Any) -> Any:
        def launch(*arguments: Any, **options: Any) -> None:
            self.found.add((self.kernel.fn.__name__, *map(self.key, self.parameters.values(), arguments)))
            for name, value in zip(self.parameters, arguments, strict=False):
                if (self.kernel.fn.__name__, name) in NEEDED:
                    value.fill_(1)

        return launch

    def key(self, parameter: inspect.Parameter, value: Any) -> Any:
        if "constexpr" in str(parameter.annotation):
            return value
        if torch.is_tensor(value):
            return value.dtype, parameter.name in self.plain or value.data_ptr() % 16 == 0
        if isinstance(value, float):
            return float
        wide = int(value).bit_length() > 31
        return wide if parameter.name in self.plain else (wide, value == 1, value % 16 == 0)


def recorded(found: set[tuple[Any, ...]], patch: pytest.MonkeyPatch) -> Any:
    """Return kernels that compute with plain torch and record what Triton would launch for the same arguments."""
    for module in (triton_tables, triton_rays, triton_cells, triton_networks):
        for name, kernel in list(vars(module).items()):
            if hasattr(kernel, "fn") and kernel.fn.__module__ == module.__name__:
                patch.setattr(module, name, Recorded(kernel, found))

    def both(name: str) -> Callable[..., Any]:
        def run(*arguments: Any) -> Any:
            if name not in ("leaps", "network"):
                getattr(triton_kernels, name)(*arguments)
            return getattr(reference, name)(*arguments)

        return run

    def network(x: Tensor, weights: Sequence[Tensor], rough: bool) -> Tensor:
        leaves = [t.detach().requires_grad_(t.requires_grad and torch.is_grad_enabled()) for t in (x, *weights)]
        out = triton_kernels.network(leaves[0], leaves[1:], rough)
        if out.requires_grad:
            torch.autograd.grad(out.sum(), [leaf for leaf in leaves if leaf.requires_grad])
        return reference.network(x, weights, rough)

    def leaps(occupied: Tensor) -> Tensor:
        triton_kernels.leaps(occupied)
        return reference.leaps(occupied)

    names = [name for name, value in vars(reference).items() if inspect.isfunction(value) and hasattr(Kernels, name)]
    return SimpleNamespace(
        **{**vars(reference), **{name: both(name) for name in names}, "network": network, "leaps": leaps}
    )


@pytest.mark.slow
@pytest.mark.skipif(GPU, reason="records launches in the interpreter; svv bench gpu counts what a GPU compiles")
def test_a_training_compiles_few_variants(monkeypatch: pytest.MonkeyPatch) -> None:
    """A whole training from views, whose batches have all sizes, and images of an edited scene."""
    found: set[tuple[Any, ...]] = set()
    kernels = recorded(found, monkeypatch)
    monkeypatch.setattr(dispatch, "kernels_of", lambda kind: kernels)
    views = ball_views()
    few = changed(preset("draft"), ["reconstruct.iterations=60", "recolour.iterations=6", "reconstruct.cells=32"])
    scene, _ = train_scene(views, few)
    for size in (9, 16):
        scene.edited(0, opacity=0.5).render(views.cameras[3].resized(size, size))
    names = [name for name, *_ in found]
    said = "\n".join(map(str, sorted(found, key=str)))
    assert len(found) <= MOST, said
    assert {"march", "lattice_backward", "network_backward", "composite_backward", "adam", "representatives"} <= set(
        names
    )
    assert names.count("harmonics") == names.count("pixel_rays") == names.count("representatives") == 1, said
