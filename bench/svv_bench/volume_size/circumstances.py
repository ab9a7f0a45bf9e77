"""Under which circumstances was measured: the machine, and the versions of what ran on it."""

from __future__ import annotations

import os
import platform
import sys

from vtkmodules.vtkCommonCore import vtkVersion

from svv._version import __version__
from svv.measure import usable_cpus
from svv_bench.results import commit, processor


def circumstances() -> dict[str, str | int]:
    """Return processor, cores that this process may use, bytes of memory, system, and versions; '' for what is missing.

    Example:
        >>> list(circumstances())[:3]
        ['processor', 'cores', 'memory_bytes']
    """
    import torch

    cards = [torch.cuda.get_device_name(number) for number in range(torch.cuda.device_count())]
    return {
        "processor": processor(), "cores": usable_cpus(), "memory_bytes": _memory(), "gpu": ", ".join(cards),
        "system": _system(), "python": platform.python_version(), "svv": __version__, "commit": commit(),
        "vtk": vtkVersion.GetVTKVersion(), "paraview": _paraview(), "torch": torch.__version__,
    }  # fmt: skip


def _memory() -> int:
    """Return the machine's bytes of memory."""
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def _system() -> str:
    """Return the operating system's name."""
    try:
        name = platform.freedesktop_os_release()["PRETTY_NAME"]
    except (OSError, KeyError):  # not Linux, or a system without that file
        name = platform.platform()
    return f"{name}, {platform.machine()}"


def _paraview() -> str:
    """Return ParaView's version if this is its Python."""
    return str(getattr(sys.modules.get("paraview"), "__version__", ""))
