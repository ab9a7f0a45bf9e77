"""Training on several processes; with :mod:`svv.train.run.gradients`, all that knows ``torch.distributed``.

``torchrun`` numbers the processes, the ranks. Each takes its part of the rays of a batch, and gradients are summed, so
all take the same step. What is short, or decides something, the first rank does and sends to the others (:func:`once`),
and only it reads and writes files. Without ``torchrun``, every function returns at once.
"""

from __future__ import annotations

import os
import pickle
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from svv.core.sharing import ALONE, Sharing
from svv.errors import BadInput, Cancelled, Elsewhere

if TYPE_CHECKING:
    import torch
    from torch import Tensor
    from torch.distributed.distributed_c10d import Store


T = TypeVar("T")

LOST = (
    "Another process of this run has ended or cannot be reached, so this one stops, too; run the same command again to "
    "resume from the last checkpoint."
)


@dataclass(frozen=True)
class Place:
    """Where this process stands among those that were started together."""

    rank: int = 0
    """Number of this process."""
    count: int = 1
    """Number of processes."""
    local: int = 0
    """Number of this process among those of its machine."""
    local_count: int = 1
    """Number of processes of its machine."""


def place() -> Place:
    """Return where this process stands by torchrun's variables, or alone; raises BadInput if these are wrong."""
    if not all(os.environ.get(name) for name in ("RANK", "WORLD_SIZE", "MASTER_ADDR", "MASTER_PORT")):
        return Place()
    try:
        rank, count = int(os.environ["RANK"]), int(os.environ["WORLD_SIZE"])
        found = Place(
            rank, count, int(os.environ.get("LOCAL_RANK", rank)), int(os.environ.get("LOCAL_WORLD_SIZE", count))
        )
    except ValueError:
        found = Place(count=0)
    if not 0 <= found.rank < found.count:
        raise BadInput("RANK and WORLD_SIZE are not those of a process that torchrun started; unset them or use it.")
    return found


@dataclass
class _Group:
    """The ranks of this run, as long as :func:`joined` lasts."""

    place: Place
    store: Store
    """What all ranks can write to without waiting for each other."""


_group: _Group | None = None


def many() -> bool:
    """Return whether several ranks work together."""
    return _group is not None


def count() -> int:
    """Return the number of ranks that work together."""
    return 1 if _group is None else _group.place.count


def sharing() -> Sharing:
    """Return how the ranks share work that needs no gradients, such as drawing views into a folder."""
    return ALONE if _group is None else Sharing(_group.place.rank, _group.place.count, once, lambda: total(1.0))


def is_first() -> bool:
    """Return whether this is the rank that shows progress, and reads and writes files."""
    return _group is None or _group.place.rank == 0


def part(number: int) -> slice:
    """Return this rank's part of ``number`` things; together, the parts of the ranks are all of them."""
    if _group is None:
        return slice(0, number)
    rank, ranks = _group.place.rank, _group.place.count
    return slice(number * rank // ranks, number * (rank + 1) // ranks)


@contextmanager
def joined(device: str = "cpu") -> Iterator[None]:
    """Work together with the other ranks in the body; alone, this does nothing.

    If a rank ends early, the others end, too (Elsewhere), and one says why. Unless the ``device`` is the CPU, each rank
    of a machine gets one of its GPUs, which is then the only one that it sees: call this before anything uses a GPU.
    Raises BadInput if this torch cannot do that, or the other ranks cannot be reached.
    """
    global _group
    where = place()
    if where.count == 1:
        yield
        return
    _group = _Group(where, _connected(where, device))
    try:
        with _ended_by_launcher():
            yield
    except (Cancelled, KeyboardInterrupt):
        _signal("stopped", 1)
        if is_first():
            raise
        raise Elsewhere(130) from None
    except (BadInput, MemoryError, OSError) as error:
        if _signal("stopped", 0):
            raise (Cancelled() if is_first() else Elsewhere(130)) from error
        if _signal("said", 1) > 1:
            raise Elsewhere(2) from error
        raise
    finally:
        _group = None
        _leave()


def _leave() -> None:
    """Leave the group, after an error, too: its threads, left to the end of the interpreter, sometimes abort it."""
    import torch.distributed as dist

    if dist.is_initialized():
        with suppress(RuntimeError):  # another rank has gone, so nothing is left to tell it
            dist.destroy_process_group()


def _connected(where: Place, device: str) -> Store:
    """Form the group of all ranks and return its store."""
    import torch
    import torch.distributed as dist

    if not dist.is_available():
        raise BadInput("This build of torch has no torch.distributed; train in one process, without torchrun.")
    gpus = take_share(where, device)
    if torch.cuda.device_count() == 0:
        device = "cpu"
    from torch.distributed import distributed_c10d
    from torch.distributed.rendezvous import rendezvous

    try:
        store, rank, ranks = next(rendezvous("env://"))
        dist.init_process_group(
            f"cpu:gloo,cuda:{gpus}" if device != "cpu" else "gloo",
            store=distributed_c10d.PrefixStore("svv", store), rank=rank, world_size=ranks,
        )  # fmt: skip
    except (RuntimeError, ValueError) as error:
        address = f"{os.environ['MASTER_ADDR']}:{os.environ['MASTER_PORT']}"
        raise BadInput(
            f"The processes that train together do not meet at {address}; check the address, and that nothing between "
            "the machines blocks it."
        ) from error
    return distributed_c10d.PrefixStore("svv-said", store)


def take_share(where: Place, device: str) -> str:
    """Take this process's share of its machine, and return what sums numbers on GPUs: ``nccl``, or ``gloo``.

    numba gets as many threads as torch, which has them from ``OMP_NUM_THREADS``; torchrun sets it to 1. With a
    ``device`` other than ``cpu``, the process sees only one of the GPUs from now on.
    """
    import numba
    import torch
    import torch.distributed as dist

    numba.set_num_threads(max(1, min(torch.get_num_threads(), numba.config.NUMBA_NUM_THREADS)))
    if device == "cpu":
        return "gloo"
    known = [name for name in os.environ.get("CUDA_VISIBLE_DEVICES", "").split(",") if name]
    names = known or [str(k) for k in range(torch.cuda.device_count())]
    if names:
        os.environ["CUDA_VISIBLE_DEVICES"] = names[where.local % len(names)]
    own = where.local_count <= len(names)  # NCCL refuses ranks that share a GPU
    return "nccl" if own and dist.is_available() and dist.is_nccl_available() else "gloo"


class _Ended(BaseException):
    """SIGTERM has come. It is no Exception, which whoever reads a file at this moment would take for the file's."""


@contextmanager
def _ended_by_launcher() -> Iterator[None]:
    """Turn SIGTERM, by which torchrun ends the other ranks if one has died, into an error."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def ended(number: int, frame: object) -> None:
        raise _Ended

    before = signal.signal(signal.SIGTERM, ended)
    try:
        yield
    except _Ended:
        raise BadInput(LOST) from None
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL if before is None else before)


def _signal(what: str, more: int) -> int:
    """Let all ranks know something ``more`` times; returns how often they were told, ``more`` without the first."""
    assert _group is not None
    try:
        return int(_group.store.add(what, more))
    except RuntimeError:  # the store has gone with the first rank
        return more


@contextmanager
def all_there() -> Iterator[None]:
    """Turn the error of torch about a rank that does not answer into one sentence."""
    try:
        yield
    except RuntimeError as error:
        raise BadInput(LOST) from error


def once(work: Callable[[], T]) -> T:
    """Return the result of work that the first rank does and sends to the others; they raise Elsewhere if it fails.

    Processes of one run trust each other, so results are pickled, unlike those in files.
    """
    if _group is None:
        return work()
    if not is_first():
        code, result = _broadcast(None)
        if code:
            raise Elsewhere(code)
        return result
    try:
        result = work()
    except BaseException as error:
        _broadcast((130 if isinstance(error, Cancelled | KeyboardInterrupt) else 2, None))
        raise
    _broadcast((0, result))
    return result


def _broadcast(thing: Any) -> Any:
    """Send a thing from the first rank to the others, its arrays without copying them; returns it."""
    import torch
    import torch.distributed as dist

    buffers: list[pickle.PickleBuffer] = []
    parts: list[bytearray | memoryview] = []
    if is_first():
        content = pickle.dumps(thing, protocol=5, buffer_callback=buffers.append)
        parts = [bytearray(content), *(memoryview(b.raw()) for b in buffers)]
        parts = [bytearray(p) if isinstance(p, memoryview) and p.readonly else p for p in parts]
    with all_there():
        number = torch.tensor([len(parts)])
        dist.broadcast(number, 0)
        sizes = torch.tensor([len(p) for p in parts]) if parts else torch.empty(int(number), dtype=torch.int64)
        dist.broadcast(sizes, 0)
        parts = parts or [bytearray(int(size)) for size in sizes]
        for piece in parts:
            if len(piece):
                dist.broadcast(torch.frombuffer(piece, dtype=torch.uint8), 0)
    return thing if is_first() else pickle.loads(parts[0], buffers=parts[1:])


def agreed(fraction: float, stop: bool) -> float:
    """Return the first rank's ``fraction``; raises Cancelled in all ranks at once if one was told to ``stop``."""
    if _group is None:
        return fraction
    import torch

    both = torch.tensor([fraction if is_first() else 0.0, float(stop)], dtype=torch.float64)
    add_up(both)
    if both[1] > 0:
        raise Cancelled
    return float(both[0])


def total(number: float) -> float:
    """Return the sum of a number over the ranks."""
    if _group is None:
        return number
    import torch

    both = torch.tensor([number], dtype=torch.float64)
    add_up(both)
    return float(both)


def summed(tensor: Tensor) -> Tensor:
    """Return the sum of a tensor over the ranks, without a graph."""
    if _group is None:
        return tensor
    result = tensor.detach().clone()
    add_up(result)
    return result


def alike(module: torch.nn.Module) -> None:
    """Give the module of every rank the parameters of the first rank's."""
    if _group is None:
        return
    import torch
    import torch.distributed as dist

    with all_there(), torch.no_grad():
        for parameter in module.parameters():
            dist.broadcast(parameter.detach(), 0)


def add_up(tensor: Tensor) -> None:
    """Replace a tensor by its sum over the ranks, of which there are several."""
    import torch.distributed as dist

    with all_there():
        dist.all_reduce(tensor)
