"""Compare direct volume rendering (DVR) with a scene's palette network (PCN) by volume size: time, memory, similarity.

A volume is taken at several resolutions: your own (--volume, with coarser levels of it), or a generated field. For
each, a scene is trained on 92 views, and three sides render the same unseen views in separate processes: VTK's ray
caster and our own, which reads bricks, on the volume; and the palette network from the scene file alone. Volumes that
do not fit into half of the memory are left out for VTK's. After Ctrl-C, the same command resumes; nothing is measured
twice on the same machine with the same versions.

Run it with `svv pvpython`, or with a Python that has vtk and svv. The results are compare.json, compare.csv, compare.md
(a table) and compare.pdf, .svg and .png (a chart), all with processor, versions and settings.
"""

import csv
import json
import shutil
import statistics
import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1]))  # ParaView's Python knows no svv_bench, which lies beside us

from svv.errors import BadInput, Cancelled
from svv.options.arguments import add_arguments, options_of
from svv.options.making import TrainOptions, VolumeOptions
from svv.pv import scripts

EXAMPLES = (
    "svv pvpython compare_dvr_pcn.py --out compare",
    "svv pvpython compare_dvr_pcn.py --volumes 128 256 --images 400 --preset draft --out quick",
    "svv pvpython compare_dvr_pcn.py --volume head.vti --tf head.json --out head",
)
FIELD = (
    {"centre": 60, "width": 40, "opacity": 0.04, "colour": (0.15, 0.5, 1.0)},
    {"centre": 140, "width": 40, "opacity": 0.4, "colour": (0.9, 0.15, 0.35)},
    {"centre": 225, "width": 70, "opacity": 0.9, "colour": (1.0, 0.75, 0.2)},
)
"""What is visible of the generated field: a faint sphere, and two shells of a torus."""

READING = {"tf": "--tf", "array": "--array", "dims": "--dims", "dtype": "--dtype", "spacing": "--spacing"}
"""Arguments that say how the volume is read and shown."""

LEAST = 64
"""Minimum number of voxels along the longest side of the levels of a volume that are compared."""

VIEWS = 7
"""Number of unseen views, which each side renders in turn, after a warm-up and as often as is asked."""

SIDE = 800
"""Pixels along each side of training views."""

COLUMNS = (
    "side", "volume", "image", "seconds_median", "seconds_least", "seconds_most", "psnr", "psnr_foreground", "ssim",
    "lpips", "own_bytes", "idle_bytes", "memory_bytes", "gpu_bytes", "ready_seconds", "ready_bytes", "data_bytes",
    "ray_caster",
)  # fmt: skip


def main() -> None:
    """Read the arguments and measure."""
    parser = scripts.parser(__doc__, *EXAMPLES)
    parser.add_argument("--out", "-o", type=Path, required=True, help="folder for the results")
    many = {"type": int, "nargs": "+", "metavar": "N"}
    parser.add_argument("--volumes", **many, default=[128, 256, 512, 1024], help="voxels of the field along each side")
    parser.add_argument("--volume", type=Path, metavar="FILE", help="a volume of your own, at its levels' sizes")
    add_arguments(parser, VolumeOptions(), READING)
    parser.add_argument("--images", **many, default=[400, 800, 1200], help="pixels along each side")
    training = {"preset": "--preset", "time_limit": "--time-limit", "seed": "--seed", "views_only": "--views-only"}
    add_arguments(parser, TrainOptions(preset="fast"), training)
    parser.add_argument("--repeats", type=int, default=5, metavar="N", help="times that each side draws the views (5)")
    parser.add_argument("--views", type=int, default=92, metavar="N", help="training views of 800 x 800 pixels (92)")
    parser.add_argument("--ray-caster", default="auto", choices=("auto", "gpu", "cpu"), help="VTK's ray caster (auto)")
    parser.add_argument("--step", help="run a single step of the work (used when the script calls itself)")
    chosen = parser.parse_args()
    scripts.run(lambda: STEPS[chosen.step](chosen) if chosen.step else compare(chosen), __file__)


def compare(chosen) -> None:
    """Do every step that is not finished yet, then write table and chart."""
    from svv.job.stages import Stages, fingerprint
    from svv.styles.weights import load
    from svv_bench.volume_size.circumstances import circumstances

    if min(chosen.volumes) < 16 or min(chosen.images) < 16:
        raise BadInput("Volumes need at least 16 voxels along each side, and images 16 pixels.")
    if chosen.repeats < 2:
        raise BadInput(f"A spread needs at least 2 repeats, not {chosen.repeats}.")
    if chosen.volume is not None:
        if not chosen.volume.exists():
            raise BadInput(f"There is no volume {chosen.volume}; check the path.")
        from svv.progress import shown

        with shown("Reading") as progress:
            levels = source_of(chosen, progress).levels
        chosen.volumes = sorted(max(level.shape) for level in levels if max(level.shape) >= LEAST) or [
            max(levels[0].shape)
        ]
    draw_chart("-c", "import svv_bench.volume_size.chart")  # whether it can be drawn is known before all that work
    stages, here = Stages(chosen.out), circumstances()
    rows, dates = [], set()
    for volume in chosen.volumes:
        folder = chosen.out / str(volume)
        folder.mkdir(exist_ok=True)
        complete_or_say_so(folder)
        settings = {"volume": volume, "seed": chosen.seed}
        if chosen.volume is not None:
            settings["file"] = fingerprint(chosen.volume)
        trained = {"preset": chosen.preset, "time_limit": chosen.time_limit, "views": chosen.views,
                   **({"views_only": True} if chosen.views_only else {})}  # fmt: skip
        measured = {"images": chosen.images, "repeats": chosen.repeats, "here": here}
        likened = {"lpips": load("alexnet") is not None}
        for step, more, files, after in (
            ("generate", {}, ["volume.mha", "tf.json"], ()),
            ("train", trained, ["scene.svv"], ("generate",)),
            ("dvr", {**measured, "ray_caster": chosen.ray_caster}, ["dvr.json"], ("train",)),
            ("bricks", measured, ["bricks.json"], ("train",)),
            ("pcn", {**measured, **likened}, ["pcn.json"], ("bricks",)),
        ):
            stages.do(
                f"{step} {volume}", step, {**settings, **more}, [folder / file for file in files],
                lambda progress, step=step, volume=volume: in_a_process(chosen, step, volume),
                [f"{name} {volume}" for name in after],
            )  # fmt: skip
        told = [json.loads((folder / f"{side}.json").read_text()) for side in ("dvr", "bricks", "pcn")]
        rows += [row for one in told for row in one["rows"]]
        dates |= {one["date"] for one in told}
        write_results(
            chosen.out, rows, {**here, **settings_of(chosen), "date": " to ".join(sorted({min(dates), max(dates)}))}
        )
    print((chosen.out / "compare.md").read_text())


def complete_or_say_so(folder: Path) -> None:
    """Say that what an earlier version measured is measured again: it kept neither the machine nor repeats."""
    old = [side for side in ("dvr", "bricks", "pcn") if isinstance(read_json(folder / f"{side}.json"), list)]
    for side in old:
        (folder / f"{side}.json").unlink()
    if old:
        print(
            f"{folder.name}: what an earlier version measured ({', '.join(old)}) lacks processor, versions and "
            "repeats: it is measured again.",
            file=sys.stderr,
        )


def read_json(path: Path) -> object:
    """Return the content of a JSON file; None if there is none, or it is damaged."""
    try:
        return json.loads(path.read_text())
    except (OSError, ValueError):
        return None


def settings_of(chosen) -> dict[str, object]:
    """Return the settings on which the figures depend."""
    return {
        "volume": "generated field" if chosen.volume is None else chosen.volume.name, "preset": chosen.preset,
        "time_limit": chosen.time_limit, "learned_from": "views only" if chosen.views_only else "volume and views",
        "views": chosen.views, "views_side": SIDE, "images": chosen.images, "unseen_views": VIEWS,
        "repeats": chosen.repeats, "seed": chosen.seed, "ray_caster": chosen.ray_caster,
    }  # fmt: skip


def in_a_process(chosen, step: str, volume: int) -> None:
    """Run one step of this script in another process, which shows its progress on the same standard error."""
    print(f"{volume}: {step}", file=sys.stderr, flush=True)
    given = {name: getattr(chosen, name) for name in ("volume", *READING, "time_limit")}
    command = [
        scripts.interpreter(), __file__, "--step", step, "--out", chosen.out / str(volume), "--volumes", volume,
        "--images", *chosen.images, "--repeats", chosen.repeats, "--preset", chosen.preset, "--views", chosen.views,
        "--ray-caster", chosen.ray_caster, "--seed", chosen.seed, *(["--views-only"] if chosen.views_only else []),
        *(part for name, value in given.items() if value for part in (f"--{name.replace('_', '-')}", value)),
    ]  # fmt: skip
    code = subprocess.run([str(part) for part in command], check=False).returncode
    if code == 130:
        raise Cancelled
    if code:
        raise BadInput(f"The step {step} for {volume} voxels a side ended with code {code}; its messages are above.")


# --- steps, each in a separate process --------------------------------------------------------------------------------


def source_of(chosen, progress):
    """Return the volume with its levels: the user's, or the generated field."""
    from svv.bricks.formats.source import ArraySource
    from svv.bricks.opened import open_bricks
    from svv.bricks.pyramid import with_pyramid
    from svv.cli.options import parse_dims, parse_numbers
    from svv.dvr.read.grids import level_of_image, to_array
    from svv.dvr.read.volumes import read_volume
    from svv_bench.volume_size.generated import GeneratedSource

    if chosen.volume is None:
        return GeneratedSource(chosen.volumes[0])
    dims = parse_dims(chosen.dims) if chosen.dims else None
    spacing = parse_numbers(chosen.spacing, "--spacing") if chosen.spacing else None
    how = dims, chosen.dtype, spacing, None, VolumeOptions(array=tuple(chosen.array)).only_array
    opened = open_bricks(chosen.volume, *how)
    if opened is None:  # a format that is only read as a whole
        image = read_volume(chosen.volume, *how)
        grid = level_of_image(image)
        opened = ArraySource(to_array(image), grid.axes, grid.origin, chosen.volume.name)
    return opened if len(opened.levels) > 1 else with_pyramid(opened, chosen.volume, progress)


def generate(chosen) -> None:
    """Write the volume at one size, and the transfer function, whose unit distance is the same at all sizes."""
    from svv.dvr.draw.large import LargeVolume
    from svv.dvr.functions.histogram import default_transfer_function
    from svv.dvr.functions.transfer_functions import TransferFunction, unit_distance_for
    from svv.io.files.atomic import write_json
    from svv.progress import shown
    from svv_bench.volume_size.written import write_meta

    with shown("Volume") as progress:
        source = source_of(chosen, progress)
        large = LargeVolume(source, 1 << 30, source.name)
        if chosen.volume is None:
            function = TransferFunction.from_bumps(FIELD, "shells", 2.0 / 64)
        else:
            given = TransferFunction.read(chosen.tf) if chosen.tf else default_transfer_function(large.overview)
            function = given.fitted(*large.range)
            unit = function.unit_distance or unit_distance_for(source.levels[0])
            function = replace(function, unit_distance=unit)
        number = next(k for k, level in enumerate(source.levels) if max(level.shape) == chosen.volumes[0])
        write_json(chosen.out / "tf.json", function.to_dict())
        write_meta(chosen.out / "volume.mha", source, number, progress)


def function_of(chosen):
    """Return the transfer function."""
    from svv.dvr.functions.transfer_functions import TransferFunction

    return TransferFunction.read(chosen.out / "tf.json")


def train(chosen) -> None:
    """Draw the views and train the scene."""
    from svv.dvr.draw.views import make_views
    from svv.errors import part
    from svv.progress import shown
    from svv.train.pipeline import train_scene

    with shown("Training") as progress:
        views, _ = make_views(
            chosen.out / "volume.mha", function_of(chosen), n=chosen.views, test=0, size=SIDE, mapper="bricks",
            rescale=False, progress=part(progress, 0.0, 0.2),
        )  # fmt: skip
        scene, _ = train_scene(views, options_of(TrainOptions, chosen), part(progress, 0.2, 1.0))
    scene.save(chosen.out / "scene.svv")


def dvr(chosen) -> None:
    """Render the volume from unseen cameras with VTK's ray caster, if it fits into memory."""
    from svv.bricks.opened import open_bricks
    from svv.dvr.draw.casters import choose_mapper
    from svv.dvr.draw.large import memory_allowed, vtk_bytes

    if vtk_bytes(open_bricks(chosen.out / "volume.mha")) > memory_allowed(None):
        write_step(chosen, "dvr", [])
        return
    cast(chosen, "DVR", choose_mapper(chosen.ray_caster).name)


def bricks(chosen) -> None:
    """Render it with our own; keep the images as the ground truth for the palette network."""
    cast(chosen, "bricks", "bricks")


def cast(chosen, side: str, mapper: str) -> None:
    """Render the volume from unseen cameras with one ray caster."""
    from svv.core.colour.shading import Shading
    from svv.dvr.draw.frame import set_stage
    from svv.dvr.draw.large import Opened, open_volume
    from svv.dvr.draw.views import open_caster
    from svv.measure import measured

    file, function = chosen.out / "volume.mha", function_of(chosen)
    cameras = {size: unseen(chosen, size) for size in (64, *chosen.images)}
    held = idle_bytes()
    with measured() as ready:
        opened = Opened.of(open_volume(file, mapper=mapper), mapper, None)
        caster, _ = open_caster(set_stage(opened.image, function), mapper, Shading(), 0.5, opened.caster(function))
        caster.render(cameras[64][0])  # the first image computes gradients and tables
    rows = []
    for size in chosen.images:
        images, row = timed(caster.render, cameras[size], chosen.repeats, held)
        if side == "bricks":
            np.savez_compressed(chosen.out / f"truth-{size}.npz", images=np.stack(images))
        ready_now = {"ready_seconds": ready.seconds, "ready_bytes": ready.peak_rss_bytes}
        rows.append({"side": side, "volume": chosen.volumes[0], "image": size, **row, **ready_now,
                     "data_bytes": file.stat().st_size, "ray_caster": mapper})  # fmt: skip
    write_step(chosen, side.lower(), rows)


def pcn(chosen) -> None:
    """Render the scene from the same cameras, and compare the images."""
    from svv.core.colour.colour import over
    from svv.core.images.metrics import WHITE, Likeness
    from svv.fields.scene.scene import Scene
    from svv.fields.scene.view_cache import disable_view_cache
    from svv.measure import measured
    from svv.train.lpips import load_lpips, lpips

    file = chosen.out / "scene.svv"
    cameras = {size: unseen(chosen, size) for size in (64, *chosen.images)}
    held = idle_bytes()
    with measured() as ready:
        scene = Scene.load(file)
        scene.render(cameras[64][0], "pcn")
    with disable_view_cache():  # the others do not keep anything of a view that they have drawn either
        drawn = {
            size: timed(lambda camera: scene.render(camera, "pcn").rgba, cameras[size], chosen.repeats, held)
            for size in chosen.images
        }
    rows, network = [], load_lpips()  # only now, so that it is no memory of the scene's
    for size, (shown, row) in drawn.items():
        truth = np.load(chosen.out / f"truth-{size}.npz")["images"]
        views = [Likeness.of(over(rgba, WHITE), true) for rgba, true in zip(shown, truth, strict=True)]
        likeness = asdict(Likeness.mean(views))
        if network is not None:
            pairs = [(over(rgba, WHITE), over(true / np.float32(255.0), WHITE)) for rgba, true in zip(shown, truth)]
            likeness["lpips"] = float(np.mean([lpips(network, one, other) for one, other in pairs]))
        ready_now = {"ready_seconds": ready.seconds, "ready_bytes": ready.peak_rss_bytes}
        rows.append({"side": "PCN", "volume": chosen.volumes[0], "image": size, **row, **ready_now, **likeness,
                     "data_bytes": file.stat().st_size})  # fmt: skip
    write_step(chosen, "pcn", rows)


STEPS = {"generate": generate, "train": train, "dvr": dvr, "bricks": bricks, "pcn": pcn}


def unseen(chosen, size: int) -> list:
    """Return cameras on the orbit, none of which is a training view's."""
    from svv.fields.scene.scene import Scene
    from svv.render.frames import orbit

    path = orbit(Scene.load(chosen.out / "scene.svv"), 181, size, size)
    return [path[int(k)] for k in np.linspace(0, 180, VIEWS + 2).round()[1:-1]]


def idle_bytes() -> int:
    """Return the bytes of memory that this process holds now, when it has loaded its libraries and nothing else."""
    from svv.measure import give_memory_back, measured

    give_memory_back()
    with measured() as now:
        pass
    return now.peak_rss_bytes


def timed(render, cameras, repeats: int, held: int) -> tuple[list, dict]:
    """Return the images from all cameras, and their cost: seconds per image in each repeat, and the peak of memory.

    ``held`` are the bytes that the process held before it opened what it renders.
    """
    import time

    from svv.measure import measured

    render(cameras[0])  # warm-up
    seconds, images = [], []
    with measured() as cost:
        for _ in range(repeats):
            images.clear()  # before there are others
            start = time.perf_counter()
            images += [render(camera) for camera in cameras]
            seconds.append((time.perf_counter() - start) / len(cameras))
    return images, {
        "seconds_median": statistics.median(seconds), "seconds_least": min(seconds), "seconds_most": max(seconds),
        "seconds": seconds, "memory_bytes": cost.peak_rss_bytes, "idle_bytes": held,
        "own_bytes": max(cost.peak_rss_bytes - held, 0), "gpu_bytes": gpu_bytes(),
    }  # fmt: skip


def gpu_bytes() -> int | None:
    """Return the GPU memory of this process in bytes; None if nvidia-smi does not report it."""
    import os

    tool = shutil.which("nvidia-smi")
    if tool is None:
        return None
    asked = [tool, "--query-compute-apps=pid,used_memory", "--format=csv,noheader,nounits"]
    lines = subprocess.run(asked, capture_output=True, text=True, check=False).stdout.splitlines()
    held = [int(line.split(",")[1]) for line in lines if line.split(",")[0].strip() == str(os.getpid())]
    return sum(held) << 20 if held else None


# --- results ----------------------------------------------------------------------------------------------------------


def write_step(chosen, step: str, rows: list[dict]) -> None:
    """Write what a step has measured, with the day."""
    from datetime import date

    from svv.io.files.atomic import write_json

    write_json(chosen.out / f"{step}.json", {"date": date.today().isoformat(), "rows": rows})


def write_results(out: Path, rows: list[dict], about: dict[str, object]) -> None:
    """Write all rows as JSON, as CSV below its circumstances, as a table and as a chart."""
    from svv.io.files.atomic import atomic_path, write_json
    from svv_bench.volume_size.comparison import table

    write_json(out / "compare.json", {"about": about, "rows": rows})
    with atomic_path(out / "compare.csv") as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        file.writelines(f"# {name}: {' '.join(str(value).split())}\n" for name, value in about.items())
        writer = csv.DictWriter(file, COLUMNS, restval="", extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)
    with atomic_path(out / "compare.md") as temporary:
        temporary.write_text(table(rows, about), encoding="utf-8")
    draw_chart("-m", "svv_bench.volume_size.chart", str(out.absolute()))


def draw_chart(*words: str) -> None:
    """Run a program that draws the chart outside ParaView, whose Python must not load matplotlib."""
    import svv_bench
    from svv.errors import silent
    from svv.pv.filters.figures import run_outside

    run_outside(words, silent, [Path(svv_bench.__file__).resolve().parents[1]])


if __name__ == "__main__":
    main()
