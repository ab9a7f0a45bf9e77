"""Compare direct volume rendering (DVR) with a scene's palette network (PCN) by volume size: time, memory, similarity.

A generated field is sampled at several resolutions. For each, a scene is trained on 92 views, and both sides render the
same unseen views in separate processes: DVR with VTK's ray caster on the volume, and the palette network from the scene
file alone. After Ctrl-C, the same command resumes; nothing is measured twice.

Run it with `svv pvpython`, or with a Python that has vtk and svv. The results are compare.csv, compare.md (a table) and
compare.png (a chart).
"""

import csv
import json
import shutil
import statistics
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np

from svv.errors import BadInput, Cancelled
from svv.options.arguments import add_arguments, options_of
from svv.options.making import TrainOptions
from svv.pv import scripts

EXAMPLES = (
    "svv pvpython compare_dvr_pcn.py --out compare",
    "svv pvpython compare_dvr_pcn.py --volumes 128 256 --images 400 --preset draft --out quick",
)
VIEWS = 7
"""Number of unseen views, each rendered once by each side after a warm-up; the median is taken over them."""

COLUMNS = (
    "side", "volume", "image", "seconds_median", "seconds_least", "seconds_most", "psnr", "psnr_foreground", "ssim",
    "memory_bytes", "gpu_bytes", "ready_seconds", "ready_bytes", "data_bytes", "ray_caster",
)  # fmt: skip


def main() -> None:
    """Read the arguments and measure."""
    parser = scripts.parser(__doc__, *EXAMPLES)
    parser.add_argument("--out", "-o", type=Path, required=True, help="folder for the results")
    many = {"type": int, "nargs": "+", "metavar": "N"}
    parser.add_argument("--volumes", **many, default=[128, 256, 512, 1024], help="voxels along each side")
    parser.add_argument("--images", **many, default=[400, 800, 1200], help="pixels along each side")
    training = {"preset": "--preset", "time_limit": "--time-limit", "seed": "--seed", "views_only": "--views-only"}
    add_arguments(parser, TrainOptions(preset="fast"), training)
    parser.add_argument("--views", type=int, default=92, metavar="N", help="training views of 800 x 800 pixels (92)")
    parser.add_argument("--ray-caster", default="auto", choices=("auto", "gpu", "cpu"), help="ray caster of DVR (auto)")
    parser.add_argument("--step", help="run a single step of the work (used when the script calls itself)")
    chosen = parser.parse_args()
    scripts.run(lambda: STEPS[chosen.step](chosen) if chosen.step else compare(chosen), __file__)


def compare(chosen) -> None:
    """Do every step that is not finished yet, then write table and chart."""
    from svv.job.stages import Stages

    if min(chosen.volumes) < 16 or min(chosen.images) < 16:
        raise BadInput("Volumes need at least 16 voxels along each side, and images 16 pixels.")
    stages = Stages(chosen.out)
    rows = []
    for volume in chosen.volumes:
        folder = chosen.out / str(volume)
        folder.mkdir(exist_ok=True)
        settings = {"volume": volume, "seed": chosen.seed}
        trained = {"preset": chosen.preset, "time_limit": chosen.time_limit, "views": chosen.views,
                   "ray_caster": chosen.ray_caster,
                   **({"views_only": True} if chosen.views_only else {})}  # fmt: skip
        for step, more, files, after in (
            ("generate", {}, ["volume.mha"], ()),
            ("train", trained, ["scene.svv"], ("generate",)),
            ("dvr", {"images": chosen.images}, ["dvr.json"], ("train",)),
            ("pcn", {"images": chosen.images}, ["pcn.json"], ("dvr",)),
        ):
            stages.do(
                f"{step} {volume}", step, {**settings, **more}, [folder / file for file in files],
                lambda progress, step=step, volume=volume: in_a_process(chosen, step, volume),
                [f"{name} {volume}" for name in after],
            )  # fmt: skip
        rows += [row for side in ("dvr", "pcn") for row in json.loads((folder / f"{side}.json").read_text())]
        write_results(chosen.out, rows)
    print((chosen.out / "compare.md").read_text())


def in_a_process(chosen, step: str, volume: int) -> None:
    """Run one step of this script in another process, which shows its progress on the same standard error."""
    print(f"{volume}^3: {step}", file=sys.stderr, flush=True)
    command = [
        scripts.interpreter(), __file__, "--step", step, "--out", chosen.out / str(volume), "--volumes", volume,
        "--images", *chosen.images, "--preset", chosen.preset, "--views", chosen.views,
        "--ray-caster", chosen.ray_caster, "--seed", chosen.seed,
        *(["--time-limit", chosen.time_limit] if chosen.time_limit else []),
        *(["--views-only"] if chosen.views_only else []),
    ]  # fmt: skip
    code = subprocess.run([str(part) for part in command], check=False).returncode
    if code == 130:
        raise Cancelled
    if code:
        raise BadInput(f"The step {step} for {volume}^3 voxels ended with code {code}; its messages are above.")


# --- steps, each in a separate process --------------------------------------------------------------------------------


def generate(chosen) -> None:
    """Write the volume, with one byte per voxel."""
    from vtkmodules.vtkIOImage import vtkMetaImageWriter

    from svv.dvr.demo_volume import demo_volume
    from svv.io.atomic import atomic_path

    # Not .vti: with a newer expat, ParaView 5.11 cannot read appended data, and other encodings are a third larger.
    with atomic_path(chosen.out / "volume.mha") as temporary:
        writer = vtkMetaImageWriter()
        writer.SetFileName(str(temporary))
        writer.SetInputData(demo_volume(chosen.volumes[0], levels=255))
        writer.SetCompression(False)
        writer.Write()
        if writer.GetErrorCode():
            raise BadInput(f"Cannot write {chosen.out / 'volume.mha'}: VTK's writer stopped; is the disk full?")


def train(chosen) -> None:
    """Draw the views and train the scene."""
    from svv.dvr.views import make_views
    from svv.errors import part
    from svv.progress import shown
    from svv.train.pipeline import train_scene

    with shown("Training") as progress:
        views, _ = make_views(
            chosen.out / "volume.mha", function(), n=chosen.views, mapper=chosen.ray_caster, rescale=False,
            progress=part(progress, 0.0, 0.2),
        )  # fmt: skip
        scene, _ = train_scene(views, options_of(TrainOptions, chosen), part(progress, 0.2, 1.0))
    scene.save(chosen.out / "scene.svv")


def dvr(chosen) -> None:
    """Render the volume from unseen cameras; keep the images as the ground truth for the other side."""
    from svv.dvr.mappers import Shading, choose_mapper
    from svv.dvr.stage import set_stage
    from svv.dvr.views import STEP
    from svv.dvr.volumes import read_volume
    from svv.io.atomic import write_json
    from svv.measure import measured

    file = chosen.out / "volume.mha"
    with measured() as ready:
        stage = set_stage(read_volume(file), function())
        kind = choose_mapper(chosen.ray_caster)
        mapper = kind(stage, Shading(), STEP[kind.name] * stage.voxel)
        mapper.render(unseen(chosen, 64)[0])  # the first image computes gradients and tables
    rows = []
    for size in chosen.images:
        images, row = timed(mapper.render, unseen(chosen, size))
        np.savez_compressed(chosen.out / f"truth-{size}.npz", images=np.stack(images))
        ready_now = {"ready_seconds": ready.seconds, "ready_bytes": ready.peak_rss_bytes}
        rows.append({"side": "DVR", "volume": chosen.volumes[0], "image": size, **row, **ready_now,
                     "data_bytes": file.stat().st_size, "ray_caster": kind.name})  # fmt: skip
    write_json(chosen.out / "dvr.json", rows)


def pcn(chosen) -> None:
    """Render the scene from the same cameras, and compare the images."""
    from svv.core.colour import over
    from svv.core.metrics import WHITE, Likeness
    from svv.fields.scene import Scene
    from svv.io.atomic import write_json
    from svv.measure import measured

    file = chosen.out / "scene.svv"
    with measured() as ready:
        scene = Scene.load(file)
        scene.render(unseen(chosen, 64)[0], "pcn")
    rows = []
    for size in chosen.images:
        shown, row = timed(lambda camera: scene.render(camera, "pcn").rgba, unseen(chosen, size))
        truth = np.load(chosen.out / f"truth-{size}.npz")["images"]
        views = [Likeness.of(over(rgba, WHITE), true) for rgba, true in zip(shown, truth, strict=True)]
        likeness = asdict(Likeness.mean(views))
        ready_now = {"ready_seconds": ready.seconds, "ready_bytes": ready.peak_rss_bytes}
        rows.append({"side": "PCN", "volume": chosen.volumes[0], "image": size, **row, **ready_now, **likeness,
                     "data_bytes": file.stat().st_size})  # fmt: skip
    write_json(chosen.out / "pcn.json", rows)


STEPS = {"generate": generate, "train": train, "dvr": dvr, "pcn": pcn}


def function():
    """Return the demo's transfer function for integer values from 0 to 255."""
    from svv.dvr.demo_volume import demo_transfer_function

    return demo_transfer_function().mapped(255.0, 0.0)


def unseen(chosen, size: int) -> list:
    """Return cameras on the orbit, none of which is a training view's."""
    from svv.fields.scene import Scene
    from svv.render.frames import orbit

    path = orbit(Scene.load(chosen.out / "scene.svv"), 181, size, size)
    return [path[int(k)] for k in np.linspace(0, 180, VIEWS + 2).round()[1:-1]]


def timed(render, cameras) -> tuple[list, dict]:
    """Return the images from all cameras, and their cost: seconds per image, and the peak memory of the process."""
    import time

    from svv.measure import measured

    render(cameras[0])  # warm-up
    images, seconds = [], []
    with measured() as cost:
        for camera in cameras:
            start = time.perf_counter()
            images.append(render(camera))
            seconds.append(time.perf_counter() - start)
    return images, {
        "seconds_median": statistics.median(seconds), "seconds_least": min(seconds), "seconds_most": max(seconds),
        "memory_bytes": cost.peak_rss_bytes, "gpu_bytes": gpu_bytes(),
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


def write_results(out: Path, rows: list[dict]) -> None:
    """Write all rows as CSV, as a table and as a chart."""
    from svv.io.atomic import atomic_path

    with atomic_path(out / "compare.csv") as temporary, temporary.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, restval="")
        writer.writeheader()
        writer.writerows(rows)
    with atomic_path(out / "compare.md") as temporary:
        temporary.write_text(table(rows), encoding="utf-8")
    with atomic_path(out / "compare.png") as temporary:
        draw_chart(rows, temporary)


def table(rows: list[dict]) -> str:
    """Return a table with both sides in one line per size, as in the paper, and the sizes at which they cross."""
    head = ["volume", "image", "DVR time", "DVR memory", "volume file", "PCN time", "PCN memory", "scene file"]
    head += ["PSNR", "foreground", "SSIM"]
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for one in (row for row in rows if row["side"] == "DVR"):
        other = next(r for r in rows if (r["side"], r["volume"], r["image"]) == ("PCN", one["volume"], one["image"]))
        cells = [f"{one['volume']}^3", f"{one['image']}^2", *costs(one), *costs(other)]
        cells += [f"{other['psnr']:.2f} dB", f"{other['psnr_foreground']:.2f} dB", f"{other['ssim']:.4f}"]
        lines.append(f"| {' | '.join(cells)} |")
    crossings = [crossing(rows, key, name) for key, name in (("seconds_median", "time"), ("memory_bytes", "memory"))]
    return "\n".join([*lines, "", *crossings, ""])


def costs(row: dict) -> list[str]:
    """Return one side's time with its range, memory, and file size, as texts."""
    seconds = [1e3 * row[f"seconds_{name}"] for name in ("median", "least", "most")]
    return [
        f"{seconds[0]:.0f} ms ({seconds[1]:.0f} to {seconds[2]:.0f})", f"{row['memory_bytes'] / 1e9:.2f} GB",
        f"{row['data_bytes'] / 1e6:.1f} MB",
    ]  # fmt: skip


def crossing(rows: list[dict], key: str, name: str) -> str:
    """Return a sentence about the volume size at which the two sides' curves cross, for the largest image."""
    image = max(row["image"] for row in rows)
    sides = [{r["volume"]: r[key] for r in rows if (r["side"], r["image"]) == (side, image)} for side in ("DVR", "PCN")]
    volumes = sorted(sides[0])
    ratio = np.log([sides[0][n] / sides[1][n] for n in volumes])
    where = f"In {name}, at {image}^2 pixels,"
    for k in range(len(volumes) - 1):
        if ratio[k] < 0 <= ratio[k + 1]:
            share = ratio[k] / (ratio[k] - ratio[k + 1])
            size = np.exp((1 - share) * np.log(volumes[k]) + share * np.log(volumes[k + 1]))
            return f"{where} DVR passes the PCN at about {size:.0f}^3 voxels (between those measured)."
    less = "the PCN" if ratio[0] >= 0 else "DVR"
    return f"{where} {less} takes less at all volumes that were measured, {volumes[0]}^3 to {volumes[-1]}^3."


def draw_chart(rows: list[dict], path: Path) -> None:
    """Draw time and memory over the size of the volume, on logarithmic axes, with VTK's charts, which ParaView has."""
    from vtkmodules.vtkCommonDataModel import vtkRectf
    from vtkmodules.vtkIOImage import vtkPNGWriter
    from vtkmodules.vtkRenderingCore import vtkWindowToImageFilter
    from vtkmodules.vtkViewsContext2D import vtkContextView

    from svv.dvr.mappers import off_screen_window

    window = off_screen_window()
    window.SetSize(1280, 520)
    window.SetMultiSamples(8)
    view = vtkContextView()
    view.SetRenderWindow(window)
    view.GetRenderer().SetBackground(1.0, 1.0, 1.0)
    panels = ("seconds_median", "seconds for an image"), ("memory_bytes", "bytes of memory while rendering")
    for place, (key, title) in enumerate(panels):
        chart = chart_of(rows, key, title)
        chart.SetSize(vtkRectf(640 * place, 0, 630, 510))
        view.GetScene().AddItem(chart)
    window.Render()
    taken = vtkWindowToImageFilter()
    taken.SetInput(window)
    taken.ReadFrontBufferOff()
    writer = vtkPNGWriter()
    writer.SetFileName(str(path))
    writer.SetInputConnection(taken.GetOutputPort())
    writer.Write()
    window.Finalize()


def chart_of(rows: list[dict], key: str, title: str):
    """Return a chart with DVR in red and the PCN in blue, darker for larger images."""
    from vtkmodules.vtkChartsCore import vtkAxis, vtkChart, vtkChartLegend, vtkChartXY
    from vtkmodules.vtkCommonDataModel import vtkTable

    chart = vtkChartXY()
    chart.SetAutoSize(False)
    chart.SetShowLegend(True)
    chart.GetLegend().SetVerticalAlignment(vtkChartLegend.TOP)
    chart.GetLegend().SetHorizontalAlignment(vtkChartLegend.LEFT)
    images = sorted({row["image"] for row in rows})
    numbers = [row[key] for row in rows]
    for side, colour in (("DVR", (200, 30, 30)), ("PCN", (20, 70, 190))):
        for step, image in enumerate(images):
            points = sorted((r["volume"], r[key]) for r in rows if (r["side"], r["image"]) == (side, image))
            data = vtkTable()
            data.AddColumn(column("x", np.log2([point[0] for point in points])))
            data.AddColumn(column(f"{side}, {image}^2", np.log10([point[1] for point in points])))
            light = 0.55 * (len(images) - 1 - step) / max(len(images) - 1, 1)
            line = chart.AddPlot(vtkChart.LINE if len(points) > 1 else vtkChart.POINTS)  # VTK warns of one-point lines
            line.SetInputData(data, 0, 1)
            line.SetColor(*(int(c + (255 - c) * light) for c in colour), 255)
            line.SetWidth(2.5)
            line.SetMarkerStyle(4)  # a disc
            line.SetMarkerSize(9.0)
    volumes = sorted({row["volume"] for row in rows})
    low, high = np.floor(np.log10(min(numbers))), np.ceil(np.log10(max(numbers)) + 0.7)  # room for the legend
    for side, name, least, most, ticks in (
        (vtkAxis.BOTTOM, "voxels along a side", np.log2(volumes[0]) - 0.2, np.log2(volumes[-1]) + 0.2,
         {float(np.log2(n)): str(n) for n in volumes}),
        (vtkAxis.LEFT, title, low, high, {float(k): f"{10.0**k:g}" for k in np.arange(low, high + 1)}),
    ):  # fmt: skip
        axis = chart.GetAxis(side)
        axis.SetTitle(name)
        axis.SetBehavior(vtkAxis.FIXED)
        axis.SetRange(float(least), float(most))
        axis.SetCustomTickPositions(column("", list(ticks)), words(ticks.values()))
        axis.GetLabelProperties().SetFontSize(14)
        axis.GetTitleProperties().SetFontSize(15)
    return chart


def column(name: str, values):
    """Return numbers as a VTK array."""
    from vtkmodules.vtkCommonCore import vtkDoubleArray

    array = vtkDoubleArray()
    array.SetName(name)
    for value in values:
        array.InsertNextValue(float(value))
    return array


def words(texts):
    """Return texts as a VTK array."""
    from vtkmodules.vtkCommonCore import vtkStringArray

    array = vtkStringArray()
    for text in texts:
        array.InsertNextValue(text)
    return array


if __name__ == "__main__":
    main()
