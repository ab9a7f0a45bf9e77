"""Compile the kernels before they are needed, in a process beside the drawing of views, which needs none.

numba takes most of a minute on a fresh installation, and keeps what it compiles. A whole small job compiles what any
job needs, without a list of kernels that would go out of date.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from contextlib import ExitStack, suppress
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

from svv._version import __version__
from svv.core.geometry.cameras import sphere_cameras
from svv.errors import BadInput
from svv.io.files.cache import cache_folder
from svv.io.files.keyed_results import key_of
from svv.io.files.locks import alone
from svv.io.files.memory import memory_there
from svv.io.views.viewset import ViewSet
from svv.options.making import MannerName

SWITCH = "SVV_COMPILE_AHEAD"
"""Environment variable; 0 turns it off."""

SIDE, STEPS = 32, 6
"""Pixels along the side of the small views, and steps of stage 2; stage 1 takes ten times as many to see the light."""

POLITE = 10
"""Added to the niceness of the process: the command that started it comes first."""

LEAST_MEMORY = 4 << 30
"""Bytes of memory from which there is room for the process, which takes half a gigabyte, beside any other."""

_started: list[subprocess.Popen[bytes]] = []


def compile_beside() -> None:
    """Start compiling in another process, unless that was done, is turned off, or there is little memory for two.

    The process ends by itself, and after Ctrl-C with this one. If it fails, kernels are compiled when they are needed.
    """
    if os.environ.get(SWITCH) == "0" or memory_there() < LEAST_MEMORY or _marker().exists():
        return
    nowhere, command = subprocess.DEVNULL, [sys.executable, "-m", "svv.job.compile_ahead"]
    with suppress(OSError):  # no more processes, or no memory for one: there is no harm in compiling later
        _started.append(subprocess.Popen(command, stdin=nowhere, stdout=nowhere, stderr=nowhere))


def ball_views() -> ViewSet:
    """Return six small views of a ball in the light of a lamp at the camera, red on one side and blue on the other."""
    cameras = sphere_cameras(6, (0.0, 0.0, 0.0), 4.0, float(np.radians(30.0)), SIDE)
    images = np.zeros((6, SIDE, SIDE, 4), np.uint8)
    y, x = np.mgrid[:SIDE, :SIDE] - (SIDE - 1) / 2
    radius = np.hypot(x, y) / 9.0
    images[..., :3] = np.where((x < 0)[..., None], (40, 80, 200), (200, 60, 40))
    images[..., :3] = images[..., :3] * np.sqrt(np.clip(1.0 - radius**2, 0.0, 1.0))[..., None]
    images[:, radius < 1.0, 3] = 255
    return ViewSet(tuple(cameras), images, tuple(f"r_{k:04d}" for k in range(6)))


def compile_all() -> None:
    """Train on a ball, render it with both kinds of light, paint it, and make splats of it, in a few steps each."""
    from svv.kernels.numba.bricks import keep_bricks
    from svv.options.splats import SplatOptions
    from svv.train.pipeline import stylize_scene, train_scene
    from svv.train.run.config import preset
    from svv.train.splats.fit import fit_splats

    views, draft = ball_views(), preset("draft")
    few = replace(
        draft,
        reconstruct=replace(draft.reconstruct, iterations=10 * STEPS, cells=SIDE),
        recolour=replace(draft.recolour, iterations=STEPS),
        stylize=replace(draft.stylize, style_views=4, style_size=64),
    )
    for lighting in ("network", "phong"):
        scene, _ = train_scene(views, replace(few, lighting=lighting))
        scene.render(views.cameras[0])
        scene.render(views.cameras[0].resized(6 * SIDE, 6 * SIDE))  # many samples may take kernels of their own
    density = scene.base.density
    assert density is not None
    for table in (density.table.clone(), density.unpacked(density.packed())):  # as it was trained, and as it is loaded
        density.table.copy_(table)
        keep_bricks(density.layout, density.table, np.inf)  # so few vertices would have none
        scene.render(views.cameras[0])
    picture = np.random.default_rng(0).random((64, 64, 3)).astype(np.float32)
    manners: tuple[MannerName, ...] = ("strokes", "pieces")
    for manner in manners:
        painted, _ = stylize_scene(scene, [picture], few, manner=manner)
        painted.render(views.cameras[0])
    fit_splats(scene, SplatOptions(count=500, steps=2))


def _marker() -> Path:
    """Return the empty file whose existence says that this code was compiled with these versions for this CPU."""
    package = Path(__file__).resolve().parents[1]
    kernels = sorted({*(package / "kernels").rglob("*.py"), *package.rglob("*_kernels.py")})
    files = [[str(file), file.stat().st_mtime_ns] for file in kernels]
    versions = [__version__, sys.version, version("numba"), version("numpy")]
    return cache_folder() / "compiled" / key_of(versions, files, _cpu())


def _cpu() -> str:
    """Return the model of the CPU: compiled code fits no other."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return platform.processor()
    return "\n".join(next((line for line in lines if line.startswith(key)), "") for key in ("model name", "flags"))


def main() -> None:
    """Compile everything, at low priority and on one thread, and leave the marker; one process at a time does."""
    if hasattr(os, "nice"):
        os.nice(POLITE)
    marker = _marker()
    marker.parent.mkdir(parents=True, exist_ok=True)
    with ExitStack() as held:
        try:
            held.enter_context(alone(marker))
        except BadInput:  # that of an earlier command is still at work
            return
        if not marker.exists():
            compile_all()
            marker.touch()


if __name__ == "__main__":
    os.environ.update(OMP_NUM_THREADS="1", NUMBA_NUM_THREADS="1", OMP_WAIT_POLICY="passive")
    main()
