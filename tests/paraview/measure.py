"""Measure what the plugin costs inside ParaView, compared with the same work outside: start, filters, images, memory.

This is a benchmark, not a test, and takes about ten minutes on two cores. Each pair of figures is measured in one run.

    python tests/paraview/measure.py --volume head.vti --tf head.json --style painting.jpg --json plugin.json
"""

import argparse
import itertools
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAIRS = 5
"""Starts with and without the plugin, in turn."""
SIZE = 400
"""Width and height of the images, pixels."""

START = """
import time, sys
import paraview.simple as simple
simple._DisableFirstRenderCameraReset()
simple.Sphere().UpdatePipeline()
assert hasattr(simple, 'StyleRFTrain') == (sys.argv[1] == 'with')
"""

INSIDE = """
import json, statistics, sys, time
from pathlib import Path
from paraview import simple
from svv.pv import scripts

def rss():
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096

volume, tf, style, out, preset, views, size, pixels = sys.argv[1:9]
display, view = scripts.open_volume(Path(volume), Path(tf) if tf != "-" else None)
simple.Render(view)

def stylized(styles, **more):
    return simple.StyleRFStylizedView(Input=display.Input, StyleFiles=styles, **more)

small = stylized([], Preset="draft", TimeLimit=2.0, Views=12, ViewSize=64, ImageSize=[32, 32])
scripts.update(small)  # what is compiled and loaded once
simple.Delete(small)
before = rss()
filter = stylized([style], Preset=preset, Views=int(views), ViewSize=int(size), ImageSize=[int(pixels)] * 2)
start = time.perf_counter()
scripts.update(filter)
whole = time.perf_counter() - start
after = rss()
seconds = []
for step in range(10, 150, 20):  # another camera each time
    filter.Frame = step
    start = time.perf_counter()
    filter.UpdatePipeline()
    seconds.append(time.perf_counter() - start)
simple.Delete(filter)
del filter
time.sleep(1)
json.dump({"stylized_view_seconds": whole, "image_seconds": seconds, "rss_before": before, "rss_trained": after,
           "rss_deleted": rss()}, open(out, "w"))
"""


def main() -> None:
    """Measure, print, and write what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--volume", type=Path, help="an image that ParaView reads (default: the demo's)")
    parser.add_argument("--tf", type=Path, help="its transfer function, a ParaView preset")
    parser.add_argument("--style", type=Path, help="a picture (default: impasto of the gallery)")
    parser.add_argument("--preset", default="fast")
    parser.add_argument("--views", type=int, default=92)
    parser.add_argument("--size", type=int, default=800, help="of the views, pixels")
    parser.add_argument("--json", type=Path, help="file for the figures")
    parser.add_argument("--outside", type=Path, help=argparse.SUPPRESS)  # the script calls itself
    chosen = parser.parse_args()
    if chosen.outside:
        return outside(chosen)
    with tempfile.TemporaryDirectory() as folder:
        figures = measure(chosen, Path(folder))
    text = json.dumps(figures, indent=2)
    print(text)
    if chosen.json:
        chosen.json.write_text(text + "\n")


def measure(chosen: argparse.Namespace, folder: Path) -> dict[str, object]:
    """All figures."""
    from svv.job.demo import generate
    from svv.pv.launch import programs

    generate(folder)
    if chosen.volume is None:
        chosen.volume, chosen.tf = folder / "volume.vti", folder / "tf.json"
    chosen.style = chosen.style or folder / "impasto.png"
    paraview = programs.find()
    program = str(paraview.program("pvpython"))
    display, name = programs.start_display()
    try:
        environ = {**programs.environ_for(paraview), "DISPLAY": name, "SVV_CACHE": str(folder / "kept")}
        figures: dict[str, object] = {"paraview": ".".join(map(str, paraview.version))}
        figures |= starts(program, environ, folder)
        here = folder / "outside.json"
        arguments = [f"--volume={chosen.volume}", f"--tf={chosen.tf or '-'}", f"--style={chosen.style}"]
        arguments += [f"--preset={chosen.preset}", f"--views={chosen.views}", f"--size={chosen.size}"]
        subprocess.run([sys.executable, __file__, *arguments, f"--outside={here}"], check=True)
        script, there = folder / "inside.py", folder / "inside.json"
        script.write_text(INSIDE)
        values = chosen.volume, chosen.tf or "-", chosen.style, there, chosen.preset, chosen.views, chosen.size, SIZE
        subprocess.run([program, script, *map(str, values)], env=environ, check=True)
    finally:
        display.terminate()
    one, other = json.loads(here.read_text()), json.loads(there.read_text())
    return figures | {
        "volume": chosen.volume.name,
        "outside_seconds": one["seconds"],
        "stylized_view_seconds": other["stylized_view_seconds"],
        "stylized_view_ratio": other["stylized_view_seconds"] / one["seconds"]["total"],
        "image_seconds_median": statistics.median(other["image_seconds"]),
        "image_seconds": other["image_seconds"],
        "outside_image_seconds_median": statistics.median(one["image_seconds"]),
        "memory_trained_bytes": other["rss_trained"] - other["rss_before"],
        "memory_left_bytes": other["rss_deleted"] - other["rss_before"],
    }


def starts(program: str, environ: dict[str, str], folder: Path) -> dict[str, object]:
    """Seconds that pvpython takes to start and make a sphere, with the plugin and without."""
    script = folder / "start.py"
    script.write_text(START)
    plain = {k: v for k, v in environ.items() if k not in ("PV_PLUGIN_PATH", "PYTHONPATH")}
    seconds: dict[str, list[float]] = {"without": [], "with": []}
    for _ in range(PAIRS + 1):
        for kind, variables in (("without", plain), ("with", environ)):
            begin = time.perf_counter()
            subprocess.run([program, script, kind], env=variables, check=True)
            seconds[kind].append(time.perf_counter() - begin)
    medians = {kind: statistics.median(taken[1:]) for kind, taken in seconds.items()}  # the first warms the disk
    return {"start_seconds": medians, "start_added_seconds": medians["with"] - medians["without"]}


def outside(chosen: argparse.Namespace) -> None:
    """The work of Stylized View in this process, which has no ParaView."""
    from svv.dvr.draw.views import make_views
    from svv.fields.scene.scene import Scene
    from svv.io.pictures.style_picture import read_style
    from svv.render.frames import orbit
    from svv.train.pipeline import stylize_scene, train_scene

    style = read_style(chosen.style)
    tf = None if str(chosen.tf) == "-" else chosen.tf

    def work(
        views: int, size: int, preset: str, limit: float | None, pixels: int, styles: list
    ) -> tuple[Scene, dict[str, float]]:
        times = [time.perf_counter()]
        drawn, _ = make_views(chosen.volume, tf, n=views, size=size)
        times.append(time.perf_counter())
        scene, _ = train_scene(drawn, preset, time_limit=limit)
        times.append(time.perf_counter())
        if styles:
            scene, _ = stylize_scene(scene, styles, preset)
        scene.render(orbit(scene, 181, pixels, pixels)[0])
        times.append(time.perf_counter())
        named = zip(("views", "train", "stylize"), itertools.pairwise(times), strict=True)
        return scene, {"total": times[-1] - times[0], **{name: end - begin for name, (begin, end) in named}}

    work(12, 64, "draft", 2.0, 32, [])
    scene, seconds = work(chosen.views, chosen.size, chosen.preset, None, SIZE, [style])
    images = []
    for camera in orbit(scene, 181, SIZE, SIZE)[10:150:20]:
        begin = time.perf_counter()
        scene.render(camera)
        images.append(time.perf_counter() - begin)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    chosen.outside.write_text(json.dumps({"seconds": seconds, "image_seconds": images, "peak_rss_bytes": peak}))


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    os.environ["PYTHONPATH"] = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
    main()
