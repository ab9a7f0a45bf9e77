"""The commands ``svv bench legibility``, ``svv bench volumes`` and ``svv bench tasks``; see :mod:`svv.cli.app`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from svv.cli.options import Json, Seed
from svv.errors import BadInput
from svv.progress import shown

LEGIBILITY = (
    "svv bench legibility scene.svv painted.svv divided.svv --json legibility.json",
    "svv bench legibility painted.svv --size 400",
)
"""Examples in the help."""
VOLUMES = (
    "svv bench volumes vessels-0 vessels-1 wrapped-0 wrapped-1 --out volumes",
    "svv views volumes/vessels-0.vti --tf volumes/vessels-0.tf.json --out views/vessels-0",
)
"""Examples in the help."""
TASKS = (
    "svv bench tasks rendered undivided divided --out trial",
    "svv bench tasks rendered undivided divided --judges 6 --seed 7 --out trial",
    "svv bench tasks --answers trial/judge-1/answers.json --answers trial/judge-2/answers.json --json scores.json",
)
"""Examples in the help."""


def legibility(
    scenes: Annotated[
        list[Path], typer.Argument(metavar="SCENE.svv ...", help="Trained and painted scenes; every painting counts.")
    ],
    size: Annotated[int, typer.Option(min=64, max=2000, help="Width and height of the views in pixels.")] = 240,
    json: Json = None,
) -> None:
    """Measure how legible the regions of paintings are, compared with the volume rendering of the same scene.

    1 is as legible as the volume rendering: regions are as far apart in everybody's eyes, stand out as well where they
    end, and are lighter or darker than what encloses them as before. A region that a painting hides counts as lost.
    """
    from svv.fields.scene.scene import Scene
    from svv.fields.scene.seen_colours import FRAMES
    from svv.io.files.atomic import check_writable, write_json
    from svv_bench.legibility.figure import Yardstick, table

    if json is not None:
        check_writable(json)
    rows = []
    with shown("Legibility") as progress:
        for number, path in enumerate(scenes):
            scene = Scene.load(path)
            progress(number / len(scenes), path.name)
            yardstick = Yardstick(scene, scene.rig.orbit(181, size, frames=FRAMES))
            shows = [("volume rendering", scene, "pcn")]
            shows += [(name, scene.with_variant(name), "styled") for name in scene.variants]
            for place, (name, shown_scene, network) in enumerate(shows):
                progress((number + (1 + place) / (1 + len(shows))) / len(scenes), f"{path.name}, {name}")
                found = yardstick.measure_scene(shown_scene, network)
                rows.append({"scene": str(path), "painting": name, **found.to_json()})
    if json is not None:
        write_json(json, {"size": size, "paintings": rows})
    print(table(rows))


def volumes(
    names: Annotated[
        list[str],
        typer.Argument(
            metavar="KIND-SEED ...",
            help="Scenes: vessels or wrapped (hard), shells, tissue, tangle or nuts, and a seed.",
        ),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder of the volumes.")],
) -> None:
    """Write generated volumes of nested regions, and their transfer functions, for svv bench tasks.

    Train and paint each as usual, and keep the names: one folder of scenes for each way to show them.
    """
    import svv.dvr  # noqa: F401  # says how to get VTK
    from svv_bench.legibility.scenes import write_scene

    with shown("Volumes") as progress:
        for number, name in enumerate(names):
            progress(number / len(names), name)
            volume, function = write_scene(name, out)
            print(f"{volume}, {function}")


def tasks(
    ways: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="FOLDER ...", help="Folders of scenes KIND-SEED.svv with the same names, one folder per way."
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", metavar="DIR", help="Folder for the sheets.")] = None,
    key: Annotated[
        Path | None, typer.Option(metavar="KEY.json", help="Where to write the key; by default DIR-key.json.")
    ] = None,
    judges: Annotated[
        int | None, typer.Option(min=1, max=99, help="Number of judges; by default as many as ways.")
    ] = None,
    size: Annotated[int, typer.Option(min=200, max=2000, help="Width and height of each view in pixels.")] = 400,
    answers: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE.json", help="Answers of a judge; may be repeated. With it, the key is opened."),
    ] = None,
    seed: Seed = 0,
    json: Json = None,
) -> None:
    """Judge ways to show scenes by questions on the picture, whose answers are known.

    First make the sheets, from scenes trained on the volumes of svv bench volumes: a folder for each judge, who sees
    each scene in one way only. Answers go into its answers.json, which is passed to --answers. The result: the share of
    right answers for each way, raw and corrected for guessing, and how often the figure of svv bench legibility agrees.
    """
    import svv.dvr  # noqa: F401  # says how to get VTK
    from svv.io.files.atomic import check_writable, write_json
    from svv_bench.legibility.tasks import ANSWERS, READ_ME, report, score, write_sheets

    if answers:
        if ways or out is not None:
            raise BadInput("Give folders and --out to write sheets, or --answers to open the key, not both.")
        if json is not None:
            check_writable(json)
        folder = answers[0].resolve().parent.parent
        found = score(answers, key or folder.with_name(f"{folder.name}-key.json"))
        if json is not None:
            write_json(json, found)
        print(report(found))
        return
    if out is None:
        raise BadInput("Give --out to write sheets, or --answers to open the key of existing ones.")
    if json is not None:
        raise BadInput("There are no scores before the key is opened: give --json together with --answers.")
    kept = key or out.resolve().with_name(f"{out.resolve().name}-key.json")
    with shown("Sheets") as progress:
        count, sheets = write_sheets(ways or (), out, kept, judges, size, seed, progress)
    print(f"{out}: {sheets} sheets for each of {count} judges; {READ_ME} beside them says how to fill in {ANSWERS}. "
          f"Do not open {kept} before then.")  # fmt: skip
