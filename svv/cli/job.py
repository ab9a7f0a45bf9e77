"""The commands that begin with a volume: ``svv demo``, ``svv run`` and ``svv views``; see :mod:`svv.cli.app`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from svv.cli.options import (
    Array,
    Device,
    DeviceOption,
    Dims,
    Dtype,
    Lighting,
    LightingOption,
    Mapper,
    MapperOption,
    Orbit,
    OrbitSize,
    Out,
    Preset,
    PresetOption,
    Seed,
    Spacing,
    TestViews,
    TimeLimit,
    TransferFunction,
    Views,
    ViewSize,
    VolumeFile,
    parse_dims,
    parse_numbers,
)
from svv.progress import duration, shown

if TYPE_CHECKING:
    from svv.job.source import ViewSource, VolumeSource

DEMO = (
    "svv demo",
    "svv demo --out my-demo --preset balanced",
    "svv demo --resolution 64 --size 400",
)
RUN = (
    "svv run foot.vti --tf bones.json --style brush.jpg --out foot",
    "svv run engine_256x256x128_uint8.raw --out engine --preset fast",
    "svv run views --style a.png --style gallery:mosaic --lighting auto --out result",
)
VIEWS = (
    "svv views foot.vti --tf bones.json --out views",
    "svv views head.raw --dims 256,256,128 --dtype uint16 --spacing 1,1,1.5 --tf skin.json --out views",
)


def demo(
    out: Out = Path("demo"),
    resolution: Annotated[int, typer.Option(min=16, help="Voxels along each side of the generated volume.")] = 128,
    n: Views = 92,
    test: TestViews = 8,
    size: ViewSize = 800,
    mapper: MapperOption = Mapper.auto,
    preset: PresetOption = Preset.fast,
    time_limit: TimeLimit = None,
    seed: Seed = 0,
    orbit: Orbit = 61,
    orbit_size: OrbitSize = 400,
    device: DeviceOption = Device.cpu,
) -> None:
    """Run the whole job on generated data: volume, views, training, edits, styles, a movie and a report.

    After Ctrl-C, the same command resumes; finished stages are not repeated.
    """
    from svv.job.demo import run_demo
    from svv.job.steps import JobSettings

    settings = JobSettings(
        n, test, size, mapper.value, preset.value, time_limit, seed, orbit, orbit_size, True, device.value
    )
    print(run_demo(out, settings, resolution, shown))


def run(
    source: Annotated[Path, typer.Argument(metavar="VOLUME|VIEWS", help="A volume, or a folder of views.")],
    out: Out,
    tf: TransferFunction = None,
    style: Annotated[
        list[str] | None, typer.Option(metavar="IMG|gallery:NAME", help="A style picture; may be repeated.")
    ] = None,
    recolour: Annotated[bool, typer.Option("--recolour", help="Also show the regions recoloured.")] = False,
    n: Views = 92,
    test: TestViews = 16,
    size: ViewSize = 800,
    mapper: MapperOption = Mapper.auto,
    preset: PresetOption = Preset.balanced,
    time_limit: TimeLimit = None,
    seed: Seed = 0,
    orbit: Orbit = 61,
    orbit_size: OrbitSize = 400,
    device: DeviceOption = Device.cpu,
    lighting: LightingOption = Lighting.network,
    array: Array = None,
    dims: Dims = None,
    dtype: Dtype = None,
    spacing: Spacing = None,
) -> None:
    """Run the whole job on a volume or on views: training, scores, styles, a movie and a report.

    After Ctrl-C, the same command resumes; finished stages are not repeated.
    """
    from svv.job.run import check, run_job
    from svv.job.source import ViewSource
    from svv.job.steps import JobSettings
    from svv.render.gallery import style_file

    origin: ViewSource | VolumeSource
    if (source / "transforms_train.json").exists():
        origin = ViewSource(source)
    else:
        origin = _volume(source, tf, array, dims, dtype, spacing)
    settings = JobSettings(
        n,
        test,
        size,
        mapper.value,
        preset.value,
        time_limit,
        seed,
        orbit,
        orbit_size,
        recolour,
        device.value,
        lighting.value,
    )
    check(settings)  # what cannot be is said before a picture of the gallery is written
    origin.identity()
    print(run_job(origin, [style_file(name, out) for name in style or []], out, settings, shown))


def views(
    volume: VolumeFile,
    out: Out,
    tf: TransferFunction = None,
    n: Views = 92,
    test: TestViews = 16,
    size: ViewSize = 800,
    mapper: MapperOption = Mapper.auto,
    array: Array = None,
    dims: Dims = None,
    dtype: Dtype = None,
    spacing: Spacing = None,
) -> None:
    """Render views of a volume: training views on a sphere around it, test views on the orbit."""
    from svv.io.view_meta import known

    source = _volume(volume, tf, array, dims, dtype, spacing)
    with shown("Drawing") as progress:
        made = source.make_views(out, n, test, size, mapper.value, progress)
    print(f"{out}: {n} + {test} views, {duration(known(made.seconds, 'seconds'))}, ray caster {made.mapper}")


def _volume(
    volume: Path, tf: Path | None, array: str | None, dims: str | None, dtype: str | None, spacing: str | None
) -> VolumeSource:
    from svv.job.source import VolumeSource

    return VolumeSource(
        volume,
        tf,
        None if dims is None else parse_dims(dims),
        dtype,
        None if spacing is None else parse_numbers(spacing, "--spacing"),
        array,
    )
