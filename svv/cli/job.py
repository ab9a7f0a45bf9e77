"""The commands that start from a volume: ``svv demo``, ``svv run`` and ``svv views``; see :mod:`svv.cli.app`."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from svv.cli.option_group import spread
from svv.cli.options import Out
from svv.errors import BadInput
from svv.options.making import OrbitOptions, SharingOptions, ShownVolumeOptions, TrainOptions, ViewOptions
from svv.progress import duration, shown

if TYPE_CHECKING:
    from svv.io.views.view_meta import ViewMeta
    from svv.job.source import ViewSource, VolumeSource

DEMO = ("svv demo", "svv demo --out my-demo --preset balanced", "svv demo --resolution 64 --size 400")
RUN = (
    "svv run foot.vti --tf bones.json --style brush.jpg --out foot",
    "svv run engine_256x256x128_uint8.raw --out engine --preset fast",
    "svv run next.vti --tf bones.json --look look.json --out next",
    "svv run views --style a.png --style gallery:mosaic --lighting auto --out result",
)
VIEWS = (
    "svv views foot.vti --tf bones.json --out views",
    "svv views head.nrrd --tf presets.xml:CT-Bone --out views",
    "svv views head.nrrd --tf viridis --out views",
    "svv views foot.vti --tf bones.json --tf skin.json --out views",
    "svv views flow.vti --array speed --array pressure --tf speed.json --tf pressure.json --out views",
    "svv views member_1.vti member_2.vti member_3.vti --tf rain.json --out views",
    "svv views pressure.vti --tf jet.json --rescale --out views",
    "svv views head.raw --dims 256,256,128 --dtype uint16 --spacing 1,1,1.5 --tf skin.json --out views",
    "torchrun --nproc-per-node 4 -m svv views large.mhd --tf skin.json --out views",
)


@spread
def demo(
    out: Out = Path("demo"),
    resolution: Annotated[int, typer.Option(min=16, help="Voxels along each side of the generated volume.")] = 128,
    drawing: ViewOptions = ViewOptions(test=8),
    training: TrainOptions = TrainOptions(preset="fast"),
    path: OrbitOptions = OrbitOptions(),
) -> None:
    """Run the whole job on generated data: volume, views, training, edits, styles, a movie and a report.

    After Ctrl-C, the same command resumes; finished stages are not repeated.
    """
    from svv.job.compile_ahead import compile_beside
    from svv.job.demo import run_demo
    from svv.job.run import check
    from svv.job.steps import JobSettings
    from svv.measure import keep_little

    keep_little()
    settings = JobSettings(drawing, training, path, recolour=True)
    check(settings)
    compile_beside()
    page = run_demo(out, settings, resolution, shown)
    _print_painting(out)
    print(page)


@spread
def run(  # noqa: PLR0913  (one parameter per group of options)
    source: Annotated[
        Path, typer.Argument(metavar="VOLUME|VIEWS", help="A volume, a folder of views, or a Cinema database.")
    ],
    out: Out,
    style: Annotated[
        list[str] | None, typer.Option(metavar="IMG|gallery:NAME", help="A style picture; may be repeated.")
    ] = None,
    look: Annotated[
        str | None,
        typer.Option(metavar="LOOK.json|gallery:NAME", help="Give the scene this look, as `svv look apply` does."),
    ] = None,
    recolour: Annotated[bool, typer.Option("--recolour", help="Also show the regions recoloured.")] = False,
    volume: ShownVolumeOptions = ShownVolumeOptions(),
    drawing: ViewOptions = ViewOptions(),
    training: TrainOptions = TrainOptions(),
    sharing: SharingOptions = SharingOptions(),
    path: OrbitOptions = OrbitOptions(),
) -> None:
    """Run the whole job on a volume or on views: training, scores, styles, a movie and a report.

    After Ctrl-C, the same command resumes; finished stages are not repeated.
    """
    from svv.io.cinema.table import is_database
    from svv.io.views.transforms import transforms_file
    from svv.io.views.viewset import read_meta
    from svv.job.compile_ahead import compile_beside
    from svv.job.looks.look import Look
    from svv.job.run import check, run_job
    from svv.job.source import ViewSource, VolumeSource, imported_views
    from svv.job.steps import JobSettings
    from svv.render.gallery import style_file

    if look is not None and style:
        raise BadInput("Give --look or --style, not both: a look has its own styles.")
    if not style and sharing != SharingOptions():
        raise BadInput("--map and --divide are about style pictures: give --style, or leave them out.")
    chosen = None if look is None else Look.load(look)
    views = transforms_file(source, "train") is not None
    if not views and is_database(source):
        with shown("Reading") as progress:
            source, views = imported_views(source, out / "views", progress), True
    origin: ViewSource | VolumeSource = ViewSource(source) if views else VolumeSource(source, **volume.to_read())
    settings = JobSettings(drawing, training, path, recolour, chosen, sharing)
    check(settings)  # before a picture of the gallery is written
    origin.identity()
    compile_beside()
    try:
        page = run_job(origin, [style_file(name, out) for name in style or []], out, settings, shown)
    finally:  # it says why a training fails, too
        if not views and transforms_file(out / "views", "train") is not None:
            _tell(read_meta(out / "views"))
    if style:
        _print_painting(out)
    print(page)


@spread
def views(
    volumes: Annotated[
        list[Path], typer.Argument(metavar="VOLUME...", help="A volume: .vti, .nrrd, .nii.gz, .raw, .tif ...")
    ],
    out: Out,
    reading: ShownVolumeOptions = ShownVolumeOptions(),
    drawing: ViewOptions = ViewOptions(),
) -> None:
    """Render views of a volume: training views on a sphere around it, test views on the orbit.

    Several --tf, several --array or several volumes (members of an ensemble) have a folder each in OUT, and svv train
    makes one scene of them, with a layer of each. Give one --tf for all arrays or volumes, or one for each.

    After Ctrl-C, the same command resumes. Processes that torchrun starts share the views; OUT must be in a folder that
    all of them see.
    """
    from svv.dvr.draw.large import memory_allowed
    from svv.io.views.view_meta import known
    from svv.job.compile_ahead import compile_beside
    from svv.job.layers import check_layers, layers
    from svv.job.source import VolumeSource
    from svv.train.run import ranks

    local = ranks.place().local_count
    every = {out / name if name else out: one for name, one in layers(volumes, reading).items()}
    sources = {folder: VolumeSource(volume, **one.to_read()) for folder, (volume, one) in every.items()}
    if len(sources) > 1:
        check_layers(list(sources.values()))
    with ranks.joined():
        if ranks.is_first():
            compile_beside()  # whoever draws views trains on them next
        if ranks.many() and drawing.memory is None:  # the level that is drawn depends on it: the same for all
            drawing = replace(drawing, memory=ranks.once(lambda: memory_allowed(None) / 1e9 / local))
        for folder, source in sources.items():
            with shown("Drawing", quiet=not ranks.is_first()) as progress:
                made = source.make_views(folder, drawing, progress, ranks.sharing())
            if ranks.is_first():
                took = duration(known(made.seconds, "seconds"))
                _tell(made)
                print(f"{folder}: {drawing.n} + {drawing.test} views, {took}, ray caster {made.mapper}")


def _print_painting(out: Path) -> None:
    """Print what was noted while the result in a folder was painted, and the parts of pictures that regions have."""
    from svv.cli.swatches import print_swatches
    from svv.fields.scene.scene import Scene

    report = json.loads((out / "stylize.json").read_text(encoding="utf-8"))
    for note in report["notes"]:
        print(note, file=sys.stderr)
    print_swatches(report["divided"], Scene.load(out / "styled.svv").regions)


def _tell(made: ViewMeta) -> None:
    """Say on standard error what was assumed when views were drawn."""
    if made.assumed is not None:
        print(made.assumed, file=sys.stderr)
