"""Reading of volumes in a process of its own: a reader of VTK that crashes on a damaged file ends that process alone.

It starts with the first volume (half a second) and serves all later ones; values come back through a pipe, straight
into the memory of the result, which takes 1 to 3 s a gigabyte and no further memory.
"""

from __future__ import annotations

import atexit
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from io import BufferedReader
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import create_vtk_array, get_vtk_array_type, vtk_to_numpy
from vtkmodules.vtkCommonDataModel import vtkImageData

from svv.core.json_values import Json
from svv.dvr.read.appearance import Appearance, put
from svv.dvr.read.grids import (
    assumed_of,
    grid_numbers,
    image_on,
    own_unit_distance,
    put_assumed,
    put_own_unit_distance,
    to_array,
)
from svv.dvr.read.vtk_readers import failed
from svv.errors import BadInput

START = """import json, sys
sys.path[:] = json.loads(sys.argv[1])
from svv.dvr.read.reader_process import serve
from svv.dvr.read.volumes import read_here
serve(read_here)
"""
"""What the process runs: with the path of this one, so that it finds the same packages."""

PIPE_BYTES = 1 << 20
"""Size of the pipe where the system lets it be chosen: with Linux' 64 kB, values take twice as long."""

BLOCK = 1 << 24
"""Bytes that are sent at a time."""


def can_start() -> bool:
    """Return whether a process can be started: not in ParaView's programs, which are not Python's."""
    return "paraview" not in sys.modules and Path(sys.executable or "").name.startswith("python")


class Apart:
    """The process."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._owner = 0
        """ID of the process that started it: one that was forked from that must not read from its pipe."""
        self._lock = threading.Lock()

    def read(self, path: Path, options: Json) -> vtkImageData:
        """Read a volume as :func:`svv.dvr.read.volumes.read_here` does; BadInput also if the process ended."""
        with self._lock:
            if self._owner != os.getpid():
                self._process = None
            process = self._process = self._process or self._started()
            assert process.stdin is not None and isinstance(process.stdout, BufferedReader)
            try:
                process.stdin.write(json.dumps({"path": str(path), "folder": os.getcwd(), **options}).encode() + b"\n")
                process.stdin.flush()
                return _received(process.stdout)
            except (BrokenPipeError, EOFError):
                code = process.wait()
                raise BadInput(_ended(path, code)) from None
            finally:
                if sys.exc_info()[0] not in (None, BadInput) or process.poll() is not None:
                    self.close()

    def _started(self) -> subprocess.Popen[bytes]:
        atexit.register(self.close)
        process = subprocess.Popen(
            [sys.executable, "-c", START, json.dumps(sys.path)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        self._owner = os.getpid()
        if sys.platform == "linux":
            import fcntl

            with suppress(OSError):  # a user may have as much of such memory as the system allows
                fcntl.fcntl(process.stdout, fcntl.F_SETPIPE_SZ, PIPE_BYTES)  # type: ignore[arg-type]
        return process

    def close(self) -> None:
        """End the process; the next volume starts another."""
        process, self._process = self._process, None
        atexit.unregister(self.close)
        if process is not None and self._owner == os.getpid():
            process.kill()
            process.communicate()


def serve(read: Callable[..., vtkImageData]) -> None:
    """Read one volume after another, as lines on the standard input ask for them, until it ends."""
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # readers may write anything there
    for line in sys.stdin.buffer:
        asked = json.loads(line)
        os.chdir(asked.pop("folder"))  # paths and messages stay as they were given
        path = Path(asked.pop("path"))
        try:
            image = read(path, **asked)
        except BadInput as error:
            _send(out, {"says": str(error)})
            continue
        except Exception as error:
            _send(out, {"says": str(failed(path, error))})
            continue
        values, shown = np.ascontiguousarray(to_array(image)).reshape(-1), Appearance.of(image)
        told = {
            "grid": grid_numbers(image), "dtype": values.dtype.str, "blank": shown.blank is not None,
            "name": image.GetPointData().GetScalars().GetName(), "unit": own_unit_distance(image),
            "assumed": assumed_of(image),
        }  # fmt: skip
        _send(out, told)
        content = values.data.cast("B")
        for start in range(0, len(content), BLOCK):
            out.write(content[start : start + BLOCK])
        if shown.blank is not None:
            out.write(shown.blank.tobytes())
        out.flush()
        del image, values, content


def _send(out: BinaryIO, told: Json) -> None:
    out.write(json.dumps(told).encode() + b"\n")
    out.flush()


def _received(stream: BufferedReader) -> vtkImageData:
    line = stream.readline()
    if not line.endswith(b"\n"):
        raise EOFError
    told = json.loads(line)
    if "says" in told:
        raise BadInput(told["says"])
    image = image_on(told["grid"])
    scalars = create_vtk_array(get_vtk_array_type(np.dtype(told["dtype"])))
    scalars.SetName(told["name"])
    scalars.SetNumberOfTuples(image.GetNumberOfPoints())
    _fill(vtk_to_numpy(scalars), stream)
    image.GetPointData().SetScalars(scalars)
    if told["blank"]:
        blank = np.empty(image.GetDimensions()[::-1], bool)
        _fill(blank.reshape(-1), stream)
        put(image, Appearance(blank))
    if told["unit"] is not None:
        put_own_unit_distance(image, told["unit"])
    put_assumed(image, told["assumed"])
    return image


def _fill(values: NDArray[np.number | np.bool_], stream: BufferedReader) -> None:
    """Fill an array with what comes through the pipe."""
    left = values.data.cast("B")
    while len(left):
        count = stream.readinto(left[:BLOCK])
        if not count:
            raise EOFError
        left = left[count:]


def _ended(path: Path, code: int) -> str:
    if code == -getattr(signal, "SIGKILL", 9):
        return f"Cannot read {path}: the system ended its reader, most likely because it ran out of memory."
    how = signal.Signals(-code).name if code < 0 else f"exit code {code}"
    return (
        f"Cannot read {path}: VTK's reader crashed on it ({how}), so it is damaged, or not of the type that its name "
        "suggests."
    )


apart = Apart()
"""The process of this one."""
