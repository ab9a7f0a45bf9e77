"""Make stylized images of a volume as ParaView shows it: views, a scene, paintings, an orbit, and a report page.

Run it with `svv pvpython`, or, for a volume that is divided among ranks, with `mpiexec -n 4 svv pvbatch`. After Ctrl-C,
the same command resumes.
"""

from pathlib import Path

from svv.options.arguments import add_arguments, options_of
from svv.options.making import OrbitOptions, TrainOptions, ViewOptions
from svv.pv import scripts

EXAMPLES = (
    "svv pvpython stylize_volume.py foot.vti --tf bones.json --style brush.jpg --out foot",
    "svv pvpython stylize_volume.py session.pvsm --style a.png --style b.png --preset balanced --out result",
    "svv pvpython stylize_volume.py head.mhd --out head            # no style: scene and recolouring only",
)


def main() -> None:
    """Read the arguments and do the job."""
    parser = scripts.parser(__doc__, *EXAMPLES)
    parser.add_argument("volume", type=Path, help="a volume that ParaView reads, or a state (.pvsm) that shows one")
    parser.add_argument("--out", "-o", type=Path, required=True, help="folder for the results")
    parser.add_argument("--tf", type=Path, help="transfer function, a ParaView preset; by default as it is shown")
    parser.add_argument("--array", help="name of the array, if the file has several")
    parser.add_argument("--style", type=Path, action="append", default=[], help="a style picture; may be repeated")
    training = {"preset": "--preset", "time_limit": "--time-limit", "seed": "--seed", "lighting": "--lighting",
                "views_only": "--views-only"}  # fmt: skip
    add_arguments(parser, TrainOptions(preset="fast"), training)
    add_arguments(parser, ViewOptions(test=8), {"n": "--views", "test": "--test", "size": "--size"})
    add_arguments(parser, OrbitOptions(), {"orbit": "--orbit", "orbit_size": "--orbit-size"})
    chosen = parser.parse_args()
    scripts.run(lambda: stylize(chosen), __file__)


def stylize(chosen) -> None:
    """Do the job, then render the scene from the camera of the view."""
    from svv.fields.scene.scene import Scene
    from svv.job.run import run_job
    from svv.job.steps import JobSettings
    from svv.progress import shown
    from svv.render.frames import write_view

    display, view = scripts.open_volume(chosen.volume, chosen.tf, chosen.array)
    drawing, training = options_of(ViewOptions, chosen), options_of(TrainOptions, chosen)
    settings = JobSettings(drawing, training, options_of(OrbitOptions, chosen), recolour=not chosen.style)
    page = scripts.with_volume(display, lambda volume: run_job(volume, chosen.style, chosen.out, settings, shown))
    scene = Scene.load(chosen.out / ("styled.svv" if chosen.style else "scene.svv"))
    camera = scripts.camera_of_view(view, chosen.size, chosen.size)
    for name in ("image.vti", "image.png"):
        write_view(chosen.out / name, scene, camera)
    print(page)


if __name__ == "__main__":
    main()
