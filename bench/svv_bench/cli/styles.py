"""The commands ``svv bench consistency``, ``svv bench compare`` and ``svv bench ablate``; see :mod:`svv.cli.app`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from svv.cli.option_group import spread
from svv.cli.options import Json, Out, SceneFile, parse_whole
from svv.errors import BadInput
from svv.options.described import Setting
from svv.options.making import NetworkName, PresetName
from svv.progress import shown
from svv_bench.cli.frames import OfFrames, changed, check_scene, measure_folder
from svv_bench.results import record

if TYPE_CHECKING:
    from svv_bench.styles.path import Protocol

CONSISTENCY = (
    "svv bench consistency styled.svv --json consistency.json --out consistency",
    "svv bench consistency styled.svv --size 200 --every 10 --flows depth --json c.json --out quick",
    "svv bench consistency scene.svv --network pcn --json unstyled.json --out unstyled",
    "svv bench consistency frames/ --guide unstyled/ --json c.json --out consistency",
    "svv bench consistency frames/ --style brush.png --modes adain,video --every 5 --out methods",
)
"""Examples in the help."""
COMPARE = (
    "svv bench compare a.svv b.svv --style brush.png --style gallery:woodcut --out modes",
    "svv bench compare a.svv --style brush.png --modes ours,arf-like --size 200 --every 20 --out quick",
)
"""Examples in the help."""
ABLATE = (
    "svv bench ablate scene.svv --style brush.png --out ablations",
    "svv bench ablate scene.svv --style brush.png --views views --only lambda-delta,refinement --out stage2",
)
"""Examples in the help."""

Flows = Annotated[
    str,
    typer.Option(
        "--flows", metavar="A,B", help="Optical flows: depth (exact, from the scene), and the estimators tvl1 and ilk."
    ),
]
KINDS = ("depth", "tvl1", "ilk")
"""Values of ``--flows``."""
ALL_MODES = "unstyled,ours,ours-unlit,pieces,arf-like,snerf-like,frame-by-frame,video,adain"
"""Default of ``--modes``."""


@dataclass(frozen=True)
class Frames:
    """Frames and pairs of frames that are measured."""

    orbit: Annotated[int, typer.Option("--orbit", metavar="N", min=2, help="Number of frames on the whole path.")] = 181
    size: Annotated[int, typer.Option("--size", min=32, help="Width and height of the frames in pixels.")] = 400
    every: Annotated[int, typer.Option("--every", metavar="K", min=1, help="Start a pair at every Kth frame.")] = 1
    intervals: Annotated[
        str, typer.Option("--intervals", metavar="N,...", help="Distances between the frames of a pair.")
    ] = "1,10"

    def protocol(self, flows: str, oversample: int = 1) -> Protocol:
        """Return the settings in the form that the layers below take."""
        from svv_bench.styles.path import Protocol

        kinds = tuple(dict.fromkeys(part.strip() for part in flows.split(",")))
        for kind in kinds:
            if kind not in KINDS:
                raise BadInput(f"--flows has no '{kind}'; choose from {', '.join(KINDS)}, separated by commas.")
        intervals = parse_whole(self.intervals, "--intervals", 1)
        return Protocol(self.orbit, self.size, self.every, intervals, kinds, oversample)


ALL_FRAMES, FEW_FRAMES = Frames(), Frames(every=10)
"""Defaults: all frames, and fewer for measuring many variants."""


@dataclass(frozen=True)
class Training:
    """Settings with which each variant is trained."""

    preset: PresetName = "balanced"
    """How long to paint; draft gives a first look."""
    seed: Annotated[int, Setting(least=0)] = 0
    """The same seed gives the same result."""


@dataclass(frozen=True)
class Shown:
    """The network of a scene that is measured."""

    network: NetworkName | None = None
    """Network that gives the colours: base, pcn or styled; by default the last one that the scene has."""


@dataclass(frozen=True)
class Others:
    """Settings of the methods that ours is compared with."""

    features: Annotated[str, Setting(metavar="auto|embedded|vgg16|FILE")] = "auto"
    """Features that the other methods match; auto uses VGG-16 if its weights are available."""
    paper_loss: bool = False
    """Let the other methods match plainly, as the paper does."""


TRAINING, OF_FRAMES = Training(), OfFrames()


@spread
def consistency(
    scene: Annotated[
        Path, typer.Argument(metavar="SCENE.svv|FRAMES", help="A trained scene, or a folder of any frames.")
    ],
    out: Out,
    frames: Frames = ALL_FRAMES,
    flows: Flows = "depth,tvl1",
    oversample: Annotated[
        int,
        typer.Option(
            "--oversample",
            metavar="N",
            min=1,
            max=4,
            help="Warp frames N times as large: between pixels, warping blurs sharp pictures.",
        ),
    ] = 1,
    which: Shown = Shown(),
    of: OfFrames = OF_FRAMES,
    json: Json = None,
) -> None:
    """Measure how consistent frames are, of a scene's orbit or in a folder: MSE, LPIPS and FLIP, short- and long-range.

    A frame is warped along the optical flow onto a later one and compared where both show the same points, and as in
    the paper. --guide to --features are for folders; --orbit, --size, --oversample and --network for scenes.
    After Ctrl-C, the same command resumes.
    """
    if scene.is_dir():
        own = changed(which) + [name for name in changed(frames) if name in ("--orbit", "--size")]
        if own := own + (["--oversample"] if oversample != 1 else []):
            raise BadInput(f"{' and '.join(own)}: only for scenes; a folder's frames are measured as they are.")
        return measure_folder(scene, out, of, frames.intervals, frames.every, flows, json)
    check_scene(scene, of)
    from svv.fields.scene.scene import Scene
    from svv.io.files.atomic import check_writable, write_json
    from svv.io.files.keyed_results import digest
    from svv_bench.styles.consistency import consistency
    from svv_bench.styles.paper import SEEN
    from svv_bench.styles.path import METRICS
    from svv_bench.styles.table import figures, markdown

    protocol = frames.protocol(flows, oversample)
    if json is not None:
        check_writable(json)
    loaded = Scene.load(scene)
    name = which.network or loaded.networks[-1]
    if name not in loaded.networks:
        raise BadInput(f"The scene holds no network '{name}', only {', '.join(loaded.networks)}.")
    with shown("Consistency") as progress:
        found = consistency(loaded, name, protocol, out, digest(scene), progress)
    if json is not None:
        write_json(json, {"scene": scene.name, "network": name, "protocol": vars(protocol), **found})
    named = [{"flow, interval": f"{r['flow']} {r['interval']}", **r} for r in found["rows"]]
    columns = (*METRICS, *SEEN, "share", "pairs")
    print(markdown(named, "flow, interval", columns))
    record(figures(f"painting/{scene.stem}", named, "flow, interval", columns))
    for kind, errors in found["flow_error"].items():
        apart = ", ".join(f"{error:.2f} pixels over {interval}" for interval, error in errors.items())
        print(f"{kind} differs from the flow of the depth by {apart} frames.")


@spread
def compare(
    scenes: Annotated[list[Path], typer.Argument(metavar="SCENE.svv ...", help="Trained scenes.")],
    style: Annotated[list[str], typer.Option(metavar="IMG|gallery:NAME", help="A style picture; may be repeated.")],
    out: Out,
    modes: Annotated[
        str,
        typer.Option(metavar="A,B", help=f"Modes to compare: {ALL_MODES.replace(',', ', ')}."),
    ] = ALL_MODES,
    frames: Frames = ALL_FRAMES,
    flows: Flows = "depth,tvl1",
    training: Training = TRAINING,
    others: Others = Others(),
) -> None:
    """Compare our stylization with other methods: with other fields, and frame by frame.

    The results are modes.md, .csv and .json, and a contact sheet for each scene and style. After Ctrl-C, the same
    command resumes.
    """
    from svv.render.gallery import style_file
    from svv_bench.styles.modes import Comparison, compare_styles, write_comparison

    protocol = frames.protocol(flows)
    names = tuple(dict.fromkeys(part.strip() for part in modes.split(",")))
    how = Comparison(protocol, names, training.preset, training.seed, others.features, others.paper_loss)
    with shown("Comparing") as progress:
        rows = compare_styles(scenes, [style_file(name, out) for name in style], out, how, progress)
    print(write_comparison(out, rows, how))


@spread
def ablate(
    scene: SceneFile,
    out: Out,
    style: Annotated[
        list[str] | None,
        typer.Option(
            metavar="IMG|gallery:NAME", help="A style picture, for the ablations of stylization; may be repeated."
        ),
    ] = None,
    views: Annotated[
        Path | None,
        typer.Option(
            "--views", metavar="VIEWS", help="Folder of the scene's views, for the ablations of the palette network."
        ),
    ] = None,
    only: Annotated[
        str | None,
        typer.Option(
            metavar="A,B",
            help="Parts to leave out: form, tone, contrast, depth, lighting, refinement, lambda-delta.",
        ),
    ] = None,
    frames: Frames = FEW_FRAMES,
    training: Training = TRAINING,
) -> None:
    """Leave out one part of the method at a time, and compare all variants in a table and a contact sheet.

    The results are ablations.md, .csv and .json, and the pictures. After Ctrl-C, the same command resumes.
    """
    from svv.render.gallery import style_file
    from svv_bench.ablation.painting import Ablation, run_ablation

    protocol = frames.protocol("depth")
    names = None if only is None else tuple(dict.fromkeys(part.strip() for part in only.split(",")))
    job = Ablation(
        scene, tuple(style_file(name, out) for name in style or ()), views, names, protocol, training.preset,
        training.seed,
    )  # fmt: skip
    with shown("Ablations") as progress:
        text = run_ablation(job, out, progress)
    print(text)
