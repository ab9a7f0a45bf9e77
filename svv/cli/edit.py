"""The commands ``svv edit`` and ``svv palette``; see :mod:`svv.cli.app`."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from svv.cli.files import check_targets, finish, load
from svv.cli.option_group import spread
from svv.cli.options import Json, Out, SceneFile, parse_colour, parse_names, parse_whole
from svv.cli.pointing import PictureOptions, parse_pointed, point_in
from svv.errors import BadInput
from svv.options.described import Setting
from svv.options.editing import (
    CutEdit,
    DistinctName,
    LightEdit,
    OcclusionEdit,
    OutlineEdit,
    PaintEdit,
    PartEdit,
    RegionEdit,
    SceneEdit,
    SectionEdit,
    ShadowEdit,
    VisibilityEdit,
)
from svv.options.making import DeviceOptions, PaletteOptions
from svv.progress import shown

if TYPE_CHECKING:
    from svv.core.colour.correction import Correction
    from svv.fields.scene.scene import Scene

EDIT = (
    "svv edit scene.svv --region 0 --colour '#d02020' --out red.svv",
    "svv edit scene.svv --name 0=bone --name 1='soft tissue' --out named.svv",
    "svv edit scene.svv --matcap 0=jade --matcap 1=sphere.png --out jade.svv",
    "svv edit named.svv --say 'make the shell pale jade, thinner, hide the ring' --out said.svv",
    "svv edit scene.svv --distinct colours --out apart.svv",
    "svv edit scene.svv --region 1 --opacity 0.3 --lighting 1.5 --out thin.svv",
    "svv edit scene.svv --isolate 0 --out alone.svv",
    "svv edit alone.svv --show all --out all.svv",
    "svv edit scene.svv --split-at 410,320 --out two.svv",
    "svv edit two.svv --hide 3 --out half.svv",
    "svv edit red.svv --undo --out scene.svv",
    "svv edit phong.svv --light 50,20 --intensity 1.2 --out side.svv",
    "svv edit phong.svv --region 0 --specular 0.4 --shininess 30 --out shiny.svv",
    "svv edit painted.svv --show-variant ink --strength 0.5 --out faint.svv",
    "svv edit painted.svv --paint-light 1 --out lit.svv",
    "svv edit painted.svv --stroke-opacity 0.6 --out strokes.svv",
    "svv edit painted.svv --region 0 --stroke-width 0.7 --stroke-relief 1.5 --out finer.svv",
    "svv edit painted.svv --stroke-palette scream.jpg --stroke-light 60,30 --out other.svv",
    "svv edit scene.svv --cut 'x>50%' --out half.svv",
    "svv edit scene.svv --cut '0=x>50%&y>50%&z>50%' --out open.svv",
    "svv edit open.svv --uncut --cut sphere:32,32,32:10 --out hollow.svv",
    "svv edit half.svv --section hatched --section-line 2 --out drawn.svv",
    "svv edit scene.svv --shadow 0.7 --out shadows.svv",
    "svv edit scene.svv --shadow 0.7 --shadow-light 1,2,1 --shadow-softness 15 --out soft.svv",
    "svv edit scene.svv --occlusion 0.8 --out deep.svv",
    "svv edit painted.svv --outline 1 --outline-width 3 --out inked.svv",
)
PALETTE = (
    "svv palette scene.svv --views views --add '#f2a319' --out two.svv",
    "svv palette scene.svv --views views --merge 0,1 --set 0='#d0a060' --out one.svv",
    "svv palette scene.svv --views views --remove 2 --preset fast --out less.svv",
    "svv palette scene.svv --views views --point 410,320=0 --point 150,90=1 --out pointed.svv",
    "svv palette scene.svv --views views --point 410,320=150,90 --out same.svv",
)


@dataclass(frozen=True)
class Steps:
    """Undoing and redoing edits, and showing or removing paintings."""

    undo: Annotated[int, typer.Option("--undo", count=True, help="Undo the last edit; may be repeated.")] = 0
    redo: Annotated[
        int, typer.Option("--redo", count=True, help="Redo the last edit that was undone; may be repeated.")
    ] = 0
    show_variant: Annotated[str | None, Setting(metavar="NAME")] = None
    """Show this painting."""
    drop_variant: Annotated[str | None, Setting(metavar="NAME")] = None
    """Remove this painting from the file."""


@dataclass(frozen=True)
class Asked:
    """Names, MatCaps and words, which concern several regions, and colours that all can tell apart."""

    name: Annotated[tuple[str, ...], Setting(metavar="K=NAME")] = ()
    """Name a region; nothing after the sign takes its name away."""
    matcap: Annotated[tuple[str, ...], Setting(metavar="K=NAME|IMG|none")] = ()
    """Colour a region by a picture of a lit sphere: clay, wax, bronze, jade, porcelain, chalk, toon, x-ray, pearl,
    velvet, or the file of a square picture."""
    say: Annotated[str | None, Setting(metavar="TEXT")] = None
    """Say what should change: region names or 'region 0', colours, thinner, hide, only, light from the left, in jade,
    as watercolour ... What is understood is printed; an unknown word fails."""
    distinct: Annotated[DistinctName | None, Setting(metavar="colours|lightness")] = None
    """Recolour unpainted regions so that all differ: colours for any colour vision, lightness also in a grey print."""


def _check_split(part: PartEdit, picture: PictureOptions) -> None:
    """Raise BadInput for options of a split without one."""
    if part.split_at is None and (part.split_level is not None or picture != PictureOptions()):
        raise BadInput(
            "--split-level, --camera, --frame and --size need --split-at, the place of the part to split off."
        )


@spread
def edit(  # noqa: PLR0913  (one parameter per group of options)
    scene: SceneFile,
    out: Out,
    region: Annotated[
        int | None,
        typer.Option(
            min=0, help="Number of the region. Without it, occlusion, paint, sections and outlines change in all."
        ),
    ] = None,
    asked: Asked = Asked(),
    own: RegionEdit = RegionEdit(),
    light: LightEdit = LightEdit(),
    shadow: ShadowEdit = ShadowEdit(),
    occlusion: OcclusionEdit = OcclusionEdit(),
    paint: PaintEdit = PaintEdit(),
    outline: OutlineEdit = OutlineEdit(),
    visibility: VisibilityEdit = VisibilityEdit(),
    cuts: CutEdit = CutEdit(),
    sections: SectionEdit = SectionEdit(),
    part: PartEdit = PartEdit(),
    picture: PictureOptions = PictureOptions(),
    steps: Steps = Steps(),
) -> None:
    """Edit a scene: colour, opacity, light, strokes, outlines, visibility, cuts and parts. Nothing is trained.

    All changes of one command are one step in the scene file's history, which --undo reverts. --reset is applied first,
    then --split-at, the options that hide and show regions, and all others.
    """
    from svv.fields.scene.closed import NeedsNetworks, read_closed
    from svv.fields.scene.edit_request import with_edit
    from svv.io.files.atomic import check_writable

    chosen = () if region is None else (region,)
    regions = _with(dict.fromkeys(chosen, own), "name", parse_names(asked.name))
    regions = _with(regions, "matcap", parse_names(asked.matcap, "--matcap 0=jade"))
    request = SceneEdit(
        regions, light, shadow, occlusion, paint, outline, visibility, cuts, sections, part, chosen, chosen
    )
    _check_split(part, picture)
    edits = bool(request or own or asked.distinct or asked.say)
    _check(region, own, bool(own or occlusion or paint or outline or sections), steps, edits)
    check_writable(out)
    closed = read_closed(scene) if part.split_at is None and asked.distinct is None else None
    if closed is not None:  # most edits change the header alone
        with suppress(NeedsNetworks):
            understood = _save_closed(cast("Scene", closed), request, asked.say, steps, out)
            print(*understood, out, sep="\n")
            return
    from svv.fields.scene.scene import Scene

    result = loaded = Scene.load(scene)
    if part.split_at is None:
        result = with_edit(result, request)
    else:
        split = replace(part, split_at=point_in(result, part.split_at, picture))
        with shown("Splitting") as progress:
            result = with_edit(result, replace(request, part=split), progress)
        print(_describe_split(result), file=sys.stderr)
    if asked.say is not None:
        result = _apply_words(result, asked.say, out, as_one_step_since=loaded)
    if asked.distinct is not None:
        result = _distinct(result, asked.distinct, as_one_step_since=loaded)
    result = _after(result, steps)
    result.save(out)
    print(out)


def _save_closed(scene: Scene, request: SceneEdit, say: str | None, steps: Steps, out: Path) -> tuple[str, ...]:
    """Edit and save a scene without its networks, and return how words were understood; raises NeedsNetworks."""
    from svv.fields.scene.edit_request import with_edit

    result, understood = with_edit(scene, request), tuple[str, ...]()
    if say is not None:
        from svv.job.words import say as words

        spoken = words.say(result, say)
        result, understood = spoken.scene.as_one_step(scene), spoken.understood
    _after(result, steps).save(out)
    return understood


def _check(region: int | None, own: RegionEdit, of_region: bool, steps: Steps, edits: bool) -> None:
    """Raise BadInput if edits of a region and the region are not both given, or steps contradict each other or edits.

    ``of_region``: whether there are edits that a region may have; ``edits``: whether there are any.
    """
    if region is None and own:
        raise BadInput("Say which region with --region K; `svv info` lists them.")
    if region is not None and not of_region:
        raise BadInput(
            "Nothing to change: give --colour, --opacity, --lighting, --occlusion, --strength, --paint-light, "
            "--outline, --section or an edit of its strokes, such as --stroke-width, for the region."
        )
    if (steps.undo or steps.redo) and (edits or (steps.undo and steps.redo)):
        raise BadInput("Give --undo, --redo or edits, not more than one of these.")
    if not (edits or any(vars(steps).values())):
        raise BadInput("Nothing to change: give an edit, for example --region 0 --opacity 0.5, or --undo.")


def _after(result: Scene, steps: Steps) -> Scene:
    """Return the scene after its steps were undone or redone, and paintings shown or removed."""
    for _ in range(steps.undo):
        result = result.undone()
    for _ in range(steps.redo):
        result = result.redone()
    if steps.drop_variant is not None:
        result = result.without_variant(steps.drop_variant)
    if steps.show_variant is not None:
        result = result.with_variant(steps.show_variant)
    return result


def _apply_words(scene: Scene, text: str, out: Path, as_one_step_since: Scene) -> Scene:
    """Return the scene as words ask for it, and print how they were understood."""
    from svv.io.scene_file import checkpoint_of
    from svv.job.words.say import say

    checkpoint = checkpoint_of(out)
    with shown("Painting") as progress:
        spoken = say(scene, text, progress, checkpoint)
    checkpoint.unlink(missing_ok=True)
    print("\n".join(spoken.understood))
    return spoken.scene.as_one_step(as_one_step_since)


def _distinct(scene: Scene, how: DistinctName, as_one_step_since: Scene) -> Scene:
    """Return the scene in colours that everybody can tell apart, and say how far apart they are."""
    from svv.core.colour.colour_vision import LEAST_DIFFERENCE
    from svv.render.distinct import distinct

    with shown("Recolouring") as progress:
        found = distinct(scene, how, progress=progress)
    pair = found.nearest
    if pair is None:
        print("The scene shows one region, which nothing can be mistaken for.", file=sys.stderr)
    else:
        said = f"{pair.first} and {pair.second} are nearest, {pair.difference:.1f} apart ({pair.vision})"
        if pair.difference < LEAST_DIFFERENCE:
            said = (
                f"No palette was found that keeps regions {LEAST_DIFFERENCE:g} apart as rendered; in the best one, "
                f"{said}: hide or join regions, or make them more opaque."
            )
        print(said, file=sys.stderr)
    return found.scene.as_one_step(as_one_step_since)


def _with(edits: dict[int, RegionEdit], field: str, texts: Mapping[int, str]) -> dict[int, RegionEdit]:
    """Return the edits of regions with a field, such as the name, that an option gives several of them."""
    found = dict(edits)
    for region, text in texts.items():
        found[region] = replace(found.get(region, RegionEdit()), **{field: text})  # type: ignore[arg-type]
    return found


def _describe_split(scene: Scene) -> str:
    """Say which region was split last, and how."""
    part, number = scene.regions[-1], len(scene.regions) - 1
    assert part.part_of is not None
    whole = scene.regions[part.part_of]
    of = whole.name or f"region {part.part_of}"
    return f"Region {number} was part of {of}: {100 * part.share / max(whole.share, 1e-9):.3g} % of it"


@dataclass(frozen=True)
class PaletteChanges:
    """Corrections to a palette."""

    add: Annotated[tuple[str, ...], Setting(metavar="'#rrggbb'")] = ()
    """Add a region of this colour."""
    merge: Annotated[tuple[str, ...], Setting(metavar="K,K,...")] = ()
    """Merge these regions."""
    remove: Annotated[tuple[int, ...], Setting(metavar="K")] = ()
    """Remove this region."""
    colours: Annotated[tuple[str, ...], Setting("--set", metavar="K='#rrggbb'")] = ()
    """Set a region's palette colour."""
    split: Annotated[tuple[int, ...], Setting(metavar="K")] = ()
    """Split this region into one region for each of its ranges of values."""
    point: Annotated[tuple[str, ...], Setting(metavar="X,Y=K|X,Y=X,Y")] = ()
    """In a scene of views alone, make the connected piece at a place region K, or divide it if several places in it
    differ; the number after the last makes a new region. Or say that two places are one region. A place is a pixel, as
    in `svv edit --split-at`, or X,Y,Z in the world."""

    def correction(self, scene: Scene, picture: PictureOptions) -> Correction:
        """Return the changes in the form that the layers below take; pixels are those of a picture of the scene."""
        from svv.core.colour.correction import Correction

        places = [(point_in(scene, place, picture), said) for place, said in map(parse_pointed, self.point)]
        return Correction(
            tuple(parse_whole(text, "--merge") for text in self.merge),
            self.remove,
            dict(parse_set(text) for text in self.colours),
            self.split,
            tuple(map(parse_colour, self.add)),
            tuple((place, said) for place, said in places if isinstance(said, int)),
            tuple((place, point_in(scene, said, picture)) for place, said in places if not isinstance(said, int)),
        )


@spread
def palette(
    scene: SceneFile,
    views: Annotated[
        Path, typer.Option("--views", metavar="VIEWS", help="Folder of the views that the scene was trained on.")
    ],
    out: Out,
    changes: PaletteChanges = PaletteChanges(),
    picture: PictureOptions = PictureOptions(),
    options: PaletteOptions = PaletteOptions(),
    where: DeviceOptions = DeviceOptions(),
    json: Json = None,
) -> None:
    """Correct a scene's palette by hand and train its regions again; the base network is kept.

    If two parts of similar hue are one region, add the missing colour. If a piece is in the wrong region, point at it.
    If the volume is known, each region still consists of ranges of the transfer function. After Ctrl-C, the same
    command resumes.
    """
    from svv.io.cinema.views import read_views
    from svv.io.scene_file import checkpoint_of
    from svv.train.correct import correct_palette

    if not changes.point and picture != PictureOptions():
        raise BadInput("--camera, --frame and --size need --point, a pixel of their picture.")
    check_targets(out, json)
    loaded = load(scene, where.device)
    correction = changes.correction(loaded, picture)
    with shown("Reading") as progress:
        view_set = read_views(views, "train", progress)
    checkpoint = checkpoint_of(out)
    with shown("Palette") as progress:
        result, report = correct_palette(loaded, view_set, correction, options, progress, checkpoint)
    print("\n".join(report["notes"][:-1]), file=sys.stderr)
    finish(result, report, out, json, checkpoint)


def parse_set(text: str) -> tuple[int, tuple[float, float, float]]:
    """Return the region and colour of '0=#rrggbb'; raises BadInput for another form."""
    region, _, colour = text.partition("=")
    if not (region.strip().isascii() and region.strip().isdigit() and colour):
        raise BadInput(f"'{text}' does not set a colour; write region=colour, for example --set 0='#ff8800'.")
    return int(region), parse_colour(colour)
