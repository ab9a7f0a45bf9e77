"""What each part of the measurement does; :mod:`svv_bench.gpu.parts` says in which order and within which time."""

from __future__ import annotations

import collections
import cProfile
import gzip
import io
import itertools
import os
import platform
import pstats
import re
import shutil
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import torch

from svv.fields.devices import gpu
from svv.fields.devices.gpu_check import run_checks, run_each
from svv.fields.devices.recorded_check import check_recorded
from svv.fields.scene.scene import Scene
from svv.io.views.viewset import ViewSet
from svv.kernels.dispatch import kernels_of
from svv.train.pipeline import evaluate_scene, stylize_scene, train_scene
from svv_bench.gpu.context import SEED, Context, spread_of

PACKAGES = ("numpy", "numba", "scipy", "scikit-image", "torch", "triton", "safetensors", "typer")
SCHEDULES = ((250, 120), (400, 200), (700, 300), (1500, 600))
"""Steps of stages 1 and 2 of the chart of accuracy against time."""
SIZES = 800, 400
"""Sizes of the images that are timed."""
REPEATS = {"cpu": 5, "cuda": 20}
"""Repetitions of what is timed."""
CHECKED_SAMPLES, CHECKED_SEEDS = {"cpu": 1 << 12, "cuda": 1 << 17}, 3
"""Size and number of the inputs with which each kernel is checked."""
WHITE = 1.0, 1.0, 1.0


def versions(how: Context) -> None:
    """Which machine, card, driver and packages these are."""
    found = {"python": platform.python_version(), "cores": os.cpu_count(), "cpu": _cpu_name()}
    for name in PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "missing"
    how.say("versions", "versions", found)
    for number in range(torch.cuda.device_count() if how.device == "cuda" else 0):
        card = torch.cuda.get_device_properties(number)
        free, total = torch.cuda.mem_get_info(number)
        capability = f"{card.major}.{card.minor}"
        how.say("versions", f"card {number}", {"name": card.name, "capability": capability, "memory": total,
                "free": free, "processors": card.multi_processor_count, "cuda": torch.version.cuda})  # fmt: skip


def kernels(how: Context) -> None:
    """Whether every kernel gives what plain torch gives, in value and gradient."""
    device = how.torch_device
    own = kernels_of(device.type)
    how.say("kernels", "kernels", own.NAME)
    recorded = {"steps recorded": check_recorded} if own.TRAINING is not None and own.TRAINING.SPARE else {}
    found = run_checks(own, device, CHECKED_SAMPLES[how.device], CHECKED_SEEDS)
    for name, seconds, wrong in itertools.chain(found, run_each(recorded, own, device, 1)):
        how.say("kernels", name, {"seconds": seconds, "wrong": wrong})
        with (how.out / "tests.log").open("a", encoding="utf-8") as file:
            file.write(f"{'FAILED' if wrong else 'passed'} {name} {seconds:.2f} s {wrong}\n")


def train(how: Context) -> None:
    """Train twice, the first time with everything still to be compiled, and score both networks on unseen views."""
    begin = time.perf_counter()
    views, test = how.read("train"), how.read("test")
    how.say("train", "views", {"read_s": time.perf_counter() - begin, "train": len(views), "test": len(test),
            "size": views.images.shape[1]})  # fmt: skip
    for turn in ("cold", "warm"):
        before = _compiled()
        begin = time.perf_counter()
        scene, report = train_scene(views, how.preset(), device=how.device, seed=SEED)
        how.wait()
        keys = ("seconds", "kernels", "gpu", "peak_gpu_bytes", "peak_rss_bytes")
        wall = time.perf_counter() - begin
        how.say(
            "train",
            turn,
            {"wall_s": wall, "compiled": _compiled() - before, **{k: v for k, v in report.items() if k in keys}},
        )
        scene.save(how.scene_file(how.device))
    for network in ("base", "pcn"):
        how.say("train", f"score {network}", score(scene, test, network))


def score(scene: Scene, test: ViewSet, network: str, most: int = 16) -> dict[str, float]:
    """Score a scene on unseen views."""
    found = evaluate_scene(scene, test.take(range(min(most, len(test)))), network)
    return {"psnr": found.psnr, "foreground": found.psnr_foreground, "ssim": found.ssim, "flip": found.flip,
            "s_per_view": found.seconds_per_view, "views": min(most, len(test))}  # fmt: skip


def compare(how: Context) -> None:
    """Draw one scene on both devices, and on each by plain torch, and compare the pictures."""
    here = Scene.load(how.scene_file("cpu" if how.scene_file("cpu").exists() else how.device))
    there, cameras = here.on(how.torch_device), how.read("test").cameras[:4]
    for network in ("base", "pcn"):  # on white: the straight colour of an almost transparent pixel means nothing
        apart = [np.abs(there.render(c, network, WHITE).rgba - here.render(c, network, WHITE).rgba) for c in cameras]
        how.say("compare", f"{network} on the device and the CPU", _apart(apart))
    small = [camera.resized(200, 200) for camera in cameras[:2]]
    fast = [there.render(c, "pcn", WHITE).rgba for c in small]
    os.environ["SVV_KERNELS"] = "reference"
    kernels_of.cache_clear()
    apart = [np.abs(there.render(c, "pcn", WHITE).rgba - f) for c, f in zip(small, fast, strict=True)]
    how.say("compare", "pcn by the kernels and by plain torch", _apart(apart))


def _apart(apart: list[np.ndarray]) -> dict[str, float]:
    values = np.stack(apart)
    return {
        "mean": float(values.mean()),
        "largest": float(values.max()),
        "above_2_levels": float((values > 2 / 255).mean()),
    }


def images(how: Context) -> None:
    """Time complete images on white, as `svv evaluate` makes them, and what the device does of it."""
    scene, cameras = how.scene(), how.read("test").cameras
    for size in SIZES:
        own = [camera.resized(size, size) for camera in cameras]
        for network in ("base", "pcn"):
            turn = iter(range(1 << 30))

            def draw(
                scene: Scene = scene, network: str = network, own: list[Any] = own, turn: Iterator[int] = turn
            ) -> None:
                scene.render(own[next(turn) % len(own)], network, WHITE)

            how.seconds(draw, 3)
            found: dict[str, Any] = spread_of(how.seconds(draw, REPEATS[how.device]))
            if how.device == "cuda":
                found["device_ms"] = _by_events(draw, 10)
            how.say("images", f"{network} {size}", found)


def _by_events(work: Callable[[], object], repeats: int) -> float:
    """Return the milliseconds between two events of the GPU's own clock around some repetitions, for each of them."""
    begin, end = torch.cuda.Event(enable_timing=True), torch.cuda.Event(enable_timing=True)
    begin.record()
    for _ in range(repeats):
        work()
    end.record()
    torch.cuda.synchronize()
    return begin.elapsed_time(end) / repeats


def paint(how: Context) -> None:
    """Paint with a picture of the gallery, twice, and draw the painting."""
    from svv.styles.gallery import gallery_picture

    scene, picture = how.scene(), gallery_picture("impasto")
    for turn in ("cold", "warm"):
        begin = time.perf_counter()
        styled, report = stylize_scene(scene, [picture], how.preset("draft" if how.steps < 1 else "balanced"))
        how.wait()
        how.say("paint", turn, {"wall_s": time.perf_counter() - begin, "seconds": report["seconds"],
                "peak_gpu_bytes": report["peak_gpu_bytes"]})  # fmt: skip
    camera = how.read("test").cameras[0]
    how.say("paint", "image", spread_of(how.seconds(lambda: styled.render(camera, None, WHITE), 5)))


def chart(how: Context) -> None:
    """Train with four schedules: accuracy on unseen views against seconds, everything compiled before."""
    views, test = how.read("train"), how.read("test")
    train_scene(views, how.preset("fast", 30, 15), device=how.device, seed=SEED)
    for first, second in SCHEDULES:
        begin = time.perf_counter()
        scene, report = train_scene(views, how.preset("balanced", first, second), device=how.device, seed=SEED)
        how.wait()
        wall = time.perf_counter() - begin
        how.say(
            "chart",
            f"{first} + {second}",
            {"wall_s": wall, "seconds": report["seconds"], **score(scene, test, "pcn", 8)},
        )


def profile(how: Context) -> None:
    """Trace steps of both stages and an image: launches, waits for the device, and where the time goes."""
    from svv_bench.gpu.steps import stage_steps

    for name, step, count in stage_steps(how):
        _trace(how, name, step, count)


def _trace(how: Context, name: str, step: Callable[[], object], count: int) -> None:
    from torch.profiler import ProfilerActivity, profile

    warm = how.seconds(step, how.scaled(20))
    seconds = how.seconds(step, max(3, how.scaled(count)))
    activities = [ProfilerActivity.CPU] + ([ProfilerActivity.CUDA] if how.device == "cuda" else [])
    with profile(activities=activities) as found:
        for _ in range(5):
            step()
        how.wait()
    path = how.out / f"trace-{name}-{how.device}.json"
    found.export_chrome_trace(str(path))
    with path.open("rb") as plain, gzip.open(f"{path}.gz", "wb", 6) as packed:
        shutil.copyfileobj(plain, packed)
    path.unlink()
    rows = found.key_averages()
    on_device = sum(getattr(r, "self_device_time_total", 0.0) for r in rows if str(r.device_type).endswith("CUDA"))
    launches = sum(r.count for r in rows if re.match(r"cu(da)?LaunchKernel", r.key)) / 5
    how.say("profile", name, {**spread_of(seconds), "first_ms": 1e3 * warm[0], "device_ms": on_device / 5e3,
            "launches": launches, "waits": _waits(how, step)})  # fmt: skip
    table = rows.table(sort_by="self_cpu_time_total", row_limit=40, max_name_column_width=60)
    with (how.out / "profile.txt").open("a", encoding="utf-8") as file:
        file.write(f"\n===== {name} on {how.device}, 5 times\n{table}\n{_python_time(step, how.scaled(20))}\n")


def _python_time(step: Callable[[], object], repeats: int) -> str:
    """Return in which functions Python spends the time of some steps."""
    found, text = cProfile.Profile(), io.StringIO()
    found.enable()
    for _ in range(repeats):
        step()
    found.disable()
    pstats.Stats(found, stream=text).sort_stats("tottime").print_stats(35)
    return f"{repeats} times, with the profiler's own time:\n{text.getvalue()}"


def _waits(how: Context, step: Callable[[], object]) -> dict[str, int]:
    """Return the lines of code that wait for the GPU, and how often."""
    if how.device != "cuda":
        return {}
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        torch.cuda.set_sync_debug_mode("warn")
        try:
            step()
        finally:
            torch.cuda.set_sync_debug_mode("default")
    lines = collections.Counter(f"{Path(w.filename).name}:{w.lineno}" for w in found if "svv" in w.filename)
    return dict(lines.most_common())


def poison(how: Context) -> None:
    """Train some steps in memory that is NaN until it is written; both passes of the march must agree to the sample."""
    from svv.fields.radiance.rendering import march
    from svv_bench.gpu.steps import first_stage

    work, bad, steps = first_stage(how), collections.Counter[str](), max(5, how.scaled(60))
    with _nan_memory():
        for k in range(steps):
            loss = work.step(k, k / steps)
            rays = work.pool.batch(k, work.budget.rays).rays
            samples = march(rays, work.occupancy, work.field.density, work.marching, k + 1)
            counted = torch.bincount(samples.ray.long().clamp(0, len(samples.count) - 1), minlength=len(samples.count))
            bad["loss is no number"] += int(not bool(loss.isfinite()))
            bad["rays have other samples than counted"] += int(not torch.equal(counted, samples.count))
            bad["rays do not follow each other"] += int(bool((samples.ray[1:] < samples.ray[:-1]).any()))
            bad["positions outside"] += int(not bool(((samples.position >= 0) & (samples.position <= 1)).all()))
            bad["extinction is no number"] += int(not bool(samples.sigma.isfinite().all()))
    bad["parameters are no numbers"] = sum(int(not bool(p.isfinite().all())) for p in work.field.parameters())
    how.say("poison", "unwritten memory", {"steps": steps, **bad})


@contextmanager
def _nan_memory() -> Iterator[None]:
    """Fill memory that torch allocates with NaN, or with the largest whole number."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # operations that are not deterministic say so
        torch.use_deterministic_algorithms(True, warn_only=True)
        settings: Any = torch.utils.deterministic
        settings.fill_uninitialized_memory = True
        try:
            yield
        finally:
            torch.use_deterministic_algorithms(False)


def memory(how: Context) -> None:
    """Train on a GPU of which little memory may be used: it works, or ends with one sentence."""
    if how.device != "cuda":
        how.say("memory", "limits", "not measured on a CPU")
        return
    total = torch.cuda.get_device_properties(how.torch_device).total_memory
    views = how.read("train")
    for limit in (2 << 30, 256 << 20, 64 << 20):
        torch.cuda.empty_cache()
        torch.cuda.set_per_process_memory_fraction(limit / total)
        try:
            _, report = train_scene(views, how.preset("fast", 60, 30), device=how.device, seed=SEED)
            said = f"works, with a peak of {(report['peak_gpu_bytes'] or 0) / 1e6:.0f} MB"
        except Exception as error:  # what a user would see is the result
            said = f"{type(error).__name__}: {error}"
        how.say("memory", f"{limit >> 20} MB", said)
    torch.cuda.set_per_process_memory_fraction(1.0)


def two_cards(how: Context) -> None:
    """Train on the second GPU, if there is one, and compare its picture with the first one's."""
    if how.device != "cuda" or torch.cuda.device_count() < 2:
        how.say("two_cards", "two cards", f"{torch.cuda.device_count()} here")
        return
    scene, camera = how.scene(), how.read("test").cameras[0]
    first = scene.render(camera).rgba
    with torch.cuda.device(1):
        second = scene.on(gpu.current_gpu()).render(camera).rgba
        _, report = train_scene(how.read("train"), how.preset("fast", 60, 30), device="cuda", seed=SEED)
    how.say("two_cards", "two cards", {**_apart([np.abs(first - second)]), "gpu": report["gpu"]})


def _compiled() -> int:
    """Return how many kernels Triton has compiled into its cache."""
    folder = os.environ.get("TRITON_CACHE_DIR")
    return len(list(Path(folder).rglob("*.cubin"))) if folder and Path(folder).is_dir() else 0


def _cpu_name() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return platform.processor()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.machine())
