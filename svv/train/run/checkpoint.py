"""Checkpoints of a training run, in the scene container's format, so that they are data and never code.

A file belongs to one set of views, settings and seed, and holds finished stages and the state of one in progress.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from svv.errors import BadInput, is_lack_of_memory
from svv.fields.radiance.encodings import LatticeAdam
from svv.io.files.keyed_results import key_of
from svv.io.scene_file import read_scene_file, write_scene_file
from svv.train.run import ranks
from svv.train.run.network_adam import NetworkAdam

Arrays = dict[str, NDArray[np.generic]]


class Checkpoint:
    """The checkpoint file of one run."""

    def __init__(self, path: Path, key: Mapping[str, object]) -> None:
        """Read the file, if it exists and its ``key`` is the same: everything that the run depends on (``key_of``)."""
        self.path = path
        self.key = key_of(key)
        self.finished: dict[str, dict[str, Any]] = {}
        self.arrays: Arrays = {}
        self._progress: dict[str, Any] = {}
        self._state: Arrays = {}
        if path.exists():
            self._read()

    def _read(self) -> None:
        try:
            header, arrays = read_scene_file(self.path)
        except BadInput:
            return  # a foreign or damaged file is not a checkpoint of this run; it will be replaced
        if header.get("key") != self.key:
            return
        finished, progress = header.get("finished"), header.get("progress")
        if not isinstance(finished, dict) or not isinstance(progress, dict):
            return
        self.finished, self._progress = finished, progress
        self.arrays = {k[5:]: v for k, v in arrays.items() if k.startswith("done.")}
        self._state = {k[6:]: v for k, v in arrays.items() if k.startswith("state.")}

    def finish(self, stage: str, values: dict[str, object], arrays: Arrays) -> None:
        """Record that a stage is done, with its results, which replace those of the previous stages."""
        self.finished[stage] = values
        self.arrays, self._state, self._progress = arrays, {}, {}
        self.write({}, {})

    def stage(
        self, name: str, network: nn.Module, optimiser: torch.optim.Optimizer | NetworkAdam, tables: LatticeAdam
    ) -> StageState:
        """Return the state of a stage in progress, restored if the file holds a stage of that name."""
        return StageState(self, name, network, optimiser, tables)

    def extra(self, name: str) -> Arrays | None:
        """Return what was saved besides the parameters of a stage; None if that stage is not in progress."""
        if self._progress.get("stage") != name:
            return None
        return {k[6:]: v for k, v in self._state.items() if k.startswith("extra.")}

    def write(self, progress: Mapping[str, object], state: Mapping[str, NDArray[np.generic]]) -> None:
        """Write the file, with the state of a stage in progress, which is not kept: it is as large as the scene."""
        if not ranks.is_first():
            return
        header = {"key": self.key, "finished": self.finished, "progress": progress}
        arrays = {f"done.{k}": v for k, v in self.arrays.items()} | {f"state.{k}": v for k, v in state.items()}
        write_scene_file(self.path, header, arrays)

    def remove(self) -> None:
        """Delete the file: the run's result is safe elsewhere."""
        self.path.unlink(missing_ok=True)


class StageState:
    """Parameters and optimisers of one stage."""

    def __init__(
        self, checkpoint: Checkpoint, name: str, network: nn.Module,
        optimiser: torch.optim.Optimizer | NetworkAdam, tables: LatticeAdam,
    ) -> None:  # fmt: skip
        self.checkpoint, self.name = checkpoint, name
        self.network, self.optimiser, self.tables = network, optimiser, tables
        self.restored: tuple[int, float] | None = None
        """Steps done and seconds spent before, if the stage was resumed; otherwise None."""
        progress = checkpoint._progress
        if progress.get("stage") == name:
            try:
                self._restore(checkpoint._state)
                self.restored = int(progress["done"]), float(progress["spent"])
            except (KeyError, TypeError, ValueError, RuntimeError, OverflowError) as error:
                if is_lack_of_memory(error):
                    raise
                raise BadInput(
                    f"The checkpoint {checkpoint.path} is damaged ({error}): delete it, and training starts afresh."
                ) from error

    def _restore(self, state: Arrays) -> None:
        tensors = {k[8:]: torch.from_numpy(v.copy()) for k, v in state.items() if k.startswith("network.")}
        self.network.load_state_dict(tensors)
        self.tables.load({k[7:]: v for k, v in state.items() if k.startswith("tables.")})
        saved = self.optimiser.state_dict()
        for number, _ in enumerate(p for g in self.optimiser.param_groups for p in g["params"]):
            prefix = f"adam.{number}."
            parts = {k[len(prefix) :]: torch.from_numpy(v.copy()) for k, v in state.items() if k.startswith(prefix)}
            if parts:
                saved["state"][number] = parts
        self.optimiser.load_state_dict(saved)

    def save(self, done: int, spent: float, extra: Arrays) -> None:
        """Write the state after ``done`` steps; it is the same on all ranks, and the first one writes it."""
        if not ranks.is_first():
            return
        state: Arrays = {f"network.{k}": v.cpu().numpy() for k, v in self.network.state_dict().items()}
        state |= {f"tables.{k}": v for k, v in self.tables.state().items()}
        state |= {f"extra.{k}": v for k, v in extra.items()}
        for number, parts in self.optimiser.state_dict()["state"].items():
            state |= {f"adam.{number}.{k}": v.cpu().numpy() for k, v in parts.items()}
        self.checkpoint.write({"stage": self.name, "done": done, "spent": spent}, state)
