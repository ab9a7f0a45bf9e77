"""The documentation's pictures of scenes, from the results of ``make demo``.

``.venv/bin/python -m docs.pictures demo`` in the checkout writes them to ``docs/images``: the showpiece that opens the
README, the gallery of hands and scenes, the stages of "How it works", the figures of the how-to guides. Trained and
painted scenes are kept in ``build/pictures``, so that the command can be stopped and repeated; everything together
takes a quarter of an hour of CPU time, most of it for the gallery. ``--only NAME`` makes some of them.
"""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from docs import volumes
from docs.sheets import IMAGES, WHITE, Pixels, halved, labelled, over_white, write
from svv.core.colour.colour_vision import COLOUR_VISIONS, simulated
from svv.core.colour.matcaps import MATCAPS, matcap_picture
from svv.core.geometry.cameras import Camera
from svv.dvr.draw.views import make_views, render_views
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.dvr.read.volumes import read_volume
from svv.fields.scene.scene import Scene
from svv.io.pictures.output import to_bytes
from svv.io.views.viewset import ViewSet
from svv.job.looks.look import Look
from svv.job.looks.offered import LOOKS
from svv.job.words.say import say
from svv.options.making import PaintOptions
from svv.render.distinct import distinct
from svv.render.figures.figure import Panel, figure
from svv.render.figures.files import pixels_of
from svv.render.frames import orbit
from svv.render.pictures import sheet
from svv.render.supersampled import supersampled
from svv.styles.gallery import gallery_picture
from svv.styles.gallery.offered import GALLERY
from svv.train.paint.ink import Ink, StyleInput
from svv.train.pipeline import stylize_scene, train_scene
from svv_bench.styles.exhibits import Exhibit, paint_figures

KEPT = IMAGES.parents[1] / "build" / "pictures"

WIDTH = 1600
"""Width of the showpiece and the gallery in pixels."""

SHOWN = {"oil and impasto": ("oil", "impasto"), "woodcut": ("woodcut",), "pastel": ("pastel",)}
"""Label -> pictures of the gallery for the regions in turn: the hands of the showpiece, without its shell."""

HANDS = {"oil": "auto", "woodcut": "auto", "watercolour": "auto", "ink-wash": "auto", "pointillism": "auto",
         "pastel": "pastel"}  # fmt: skip
"""Pictures of the gallery that the gallery's columns show -> hand in which they are painted."""

SHELL = 2
"""The demo's region that surrounds the others."""

SCENES = {"gyroid": volumes.gyroid, "orbital": volumes.orbital, "plume": volumes.plume}
"""The gallery's rows, after the demo's scene."""

OTHERS = {"glass": volumes.glass, "nested": volumes.nested}
"""Further scenes."""

FRAMES = {"demo": 104, "gyroid": 125, "orbital": 125, "plume": 112}
"""View of each scene on the path of 181."""

CUT_FRAME = 65
"""View in which a cut across x lies open."""

ZOOM = 0.56
"""Fraction of the field of view that the pictures show, because the views leave a margin around the volume."""

LOBE = (0.0, 0.59, 0.0)
"""A point in a lobe of the orbital."""

SIZE = 420
"""Width and height of each picture of a stage, in pixels."""


class Studio:
    """The demo's results, and what is trained and painted for the pictures."""

    def __init__(self, demo: Path) -> None:
        self.demo = demo
        KEPT.mkdir(parents=True, exist_ok=True)

    def scene(self, name: str) -> Scene:
        """Return a scene, trained on few and small views unless it is there."""
        path = self.demo / "scene.svv" if name == "demo" else KEPT / f"{name}.svv"
        if not path.exists():
            views, _ = make_views(*{**SCENES, **OTHERS}[name](), n=42, test=0, size=400, mapper="cpu")
            train_scene(views, "draft")[0].save(path)
        return Scene.load(path)

    def painted(self, name: str, styles: Sequence[str]) -> Scene:
        """Return a scene painted by strokes in the hands of pictures of the gallery, for its regions in turn."""
        path = KEPT / f"{name}-{'-'.join(styles)}.svv"
        if not path.exists():
            given = [StyleInput(gallery_picture(style), style) for style in styles]
            keep = (SHELL,) if name == "demo" else ()
            how = PaintOptions(preset="draft", manner="strokes", hand=HANDS.get(styles[0], "auto"), keep=keep)
            stylize_scene(self.scene(name), given, how)[0].save(path)
        return Scene.load(path)

    def volume_rendering(self, camera: Camera) -> Pixels:
        """Draw the demo's volume over white. (height, width, 3)"""
        tf = TransferFunction.read(self.demo / "tf.json")
        return over_white(render_views(read_volume(self.demo / "volume.vti"), tf, [camera], "cpu")[0])


def view_of(scene: Scene, frame: int, size: int) -> Camera:
    """Return the camera of a frame on the path of 181 that fills a picture of size x size."""
    camera = orbit(scene, 181, size, size)[frame]
    return Camera(camera.camera_to_world, ZOOM * camera.fov_x, size, size)


def drawn(scene: Scene, camera: Camera, network: str | None = None) -> Pixels:
    """Render a scene over white. (height, width, 3)"""
    return np.asarray(supersampled(scene, camera, network, WHITE).rgba[..., :3], np.float64)


def showpiece(studio: Studio) -> None:
    """The demo's volume as rendered, and in three hands, from one camera."""
    side = WIDTH // (1 + len(SHOWN))
    camera = view_of(studio.scene("demo"), FRAMES["demo"], 2 * side)
    pictures = [studio.volume_rendering(camera)]
    pictures += [drawn(studio.painted("demo", styles), camera) for styles in SHOWN.values()]
    row = np.concatenate([halved(picture) for picture in pictures], axis=1)
    write("showpiece.jpg", [labelled(["volume rendering", *SHOWN], side), row], below=True, width=WIDTH)


def gallery(studio: Studio) -> None:
    """Every hand on every scene, whose own colours come first."""
    side = WIDTH // (1 + len(HANDS))
    rows = [labelled(["", *HANDS], side)]
    for name in ("demo", *SCENES):
        scene = studio.scene(name)
        camera = view_of(scene, FRAMES[name], 2 * side)
        painted = [drawn(studio.painted(name, [style]), camera) for style in HANDS]
        rows.append(np.concatenate([halved(one) for one in (drawn(scene, camera, "pcn"), *painted)], axis=1))
    write("gallery.jpg", rows, below=True, width=WIDTH)


def glass(studio: Studio) -> None:
    """A translucent sheet, and the strokes on it in two hands."""
    scene = studio.scene("glass")
    camera = view_of(scene, FRAMES["gyroid"], 2 * SIZE)
    painted = [drawn(studio.painted("glass", [style]), camera) for style in ("oil", "impasto")]
    write("glass.jpg", [halved(one) for one in (drawn(scene, camera, "pcn"), *painted)])


def divided(studio: Studio) -> None:
    """Nested translucent regions as rendered, each painted with the whole of one picture, and with a part of it."""
    scene, style = studio.scene("nested"), StyleInput(gallery_picture("impasto"), "impasto")
    camera = view_of(scene, 125, 2 * SIZE)
    painted = [stylize_scene(scene, [style], "draft", divide=how)[0] for how in ("no", "auto")]
    every = drawn(scene, camera, "pcn"), *(drawn(one, camera) for one in painted)
    row = np.concatenate([halved(picture) for picture in every], axis=1)
    names = ["volume rendering", "the whole picture", "a part for each region"]
    write("divided.jpg", [labelled(names, SIZE), row], below=True, width=3 * SIZE)


def stages(studio: Studio) -> None:
    """The result of each stage for the demo's volume, from the camera of one of its views."""
    views, scene = ViewSet.read(studio.demo / "views", "train"), studio.scene("demo")
    painted, number = Scene.load(studio.demo / "styled.svv"), 45
    write("stage-views.jpg", [_shrunk(views, one) for one in (0, 20, 45, 70)])
    seen = views.cameras[number]
    camera = Camera(seen.camera_to_world, ZOOM * seen.fov_x, SIZE, SIZE)
    write("stage-base.jpg", [_shrunk(views, number), drawn(scene, camera, "base")])
    regions = [drawn(scene.isolated(region), camera) for region in range(len(scene.regions))]
    write("stage-palette.jpg", [drawn(scene, camera), *regions])
    sheet, vortex, shell = 0, 1, 2  # most visible first
    green = scene.edited(sheet, colour=(0.1, 0.55, 0.35))
    edits = (green, green.edited(shell, opacity=6.0), green.hidden(vortex))
    write("stage-edits.jpg", [drawn(edited, camera) for edited in edits])
    write("stage-painting.jpg", [drawn(painted.with_paint_light(0.0), camera), drawn(painted, camera)])
    shutil.copy(studio.demo / "regions.png", IMAGES / "regions.png")


def _shrunk(views: ViewSet, number: int) -> Pixels:
    image = Image.fromarray(np.rint(255 * over_white(views.images[number])).astype(np.uint8))
    margin = round((1 - ZOOM) / 2 * image.width)
    image = image.crop((margin, margin, image.width - margin, image.height - margin))
    return np.asarray(image.resize((SIZE, SIZE), Image.Resampling.LANCZOS), np.float64) / 255


def figures(studio: Studio) -> None:
    """What ``svv bench figures`` draws: regions alone, parts of one picture, edits after painting."""
    styles = [f"gallery:{name}" for name in ("impasto", "oil", "pastel")]
    how = Exhibit("draft", frame=FRAMES["demo"])
    for path in paint_figures(studio.demo / "scene.svv", styles, KEPT / "figures", how):
        shutil.copy(path, IMAGES / f"gallery-{path.name}")


def ink(studio: Studio) -> None:
    """The demo's scene in three inks, outlined."""
    scene, pictures = studio.scene("demo").hidden(2), []
    for kind in ("stippling", "hatching", "cross-hatching"):
        path = KEPT / f"demo-{kind}.svv"
        if not path.exists():
            stylize_scene(scene, [Ink(kind)], "draft", keep=(2,))[0].save(path)
        printed = Scene.load(path).with_outline(1.0, width=1.6)
        pictures.append(halved(drawn(printed, view_of(printed, FRAMES["demo"], 2 * SIZE))))
    write("ink.png", pictures)


def outlines(studio: Studio) -> None:
    """The demo's scene without and with outlines."""
    scene = studio.scene("demo")
    camera = view_of(scene, FRAMES["demo"], 2 * SIZE)
    write("outlines.jpg", [halved(drawn(one, camera, "pcn")) for one in (scene, scene.with_outline(1.0))])


def occlusion(studio: Studio) -> None:
    """The demo's scene in clay, without and with ambient occlusion."""
    scene = studio.scene("demo").hidden(2)
    for region in (0, 1):
        scene = scene.edited(region, matcap="clay")
    camera = view_of(scene, FRAMES["demo"], 2 * SIZE)
    write("occlusion.jpg", [halved(drawn(one, camera, "pcn")) for one in (scene, scene.with_occlusion(1.0))])


def shadow(studio: Studio) -> None:
    """The demo's scene without and with shadows."""
    scene = studio.scene("demo").hidden(SHELL)
    camera = view_of(scene, FRAMES["demo"], 2 * SIZE)
    write("shadow.jpg", [halved(drawn(one, camera, "pcn")) for one in (scene, scene.with_shadow(0.75))])


def sections(studio: Studio) -> None:
    """The demo's scene cut open, as learned and hatched with a line, and its painting with flat faces."""
    plain, painted = (Scene.load(studio.demo / f"{name}.svv").cut("x>50%") for name in ("scene", "styled"))
    camera = view_of(plain, CUT_FRAME, 2 * SIZE)
    drawn_in = ((plain, "pcn"), (plain.with_section("hatched", line=2.5), "pcn"),
                (painted.with_section("flat", line=2.5), "styled"))  # fmt: skip
    write("sections.jpg", [halved(drawn(one, camera, network)) for one, network in drawn_in])


def parts(studio: Studio) -> None:
    """The orbital; one of its lobes, which a click makes a region of its own, alone; without it; in green."""
    scene, size = studio.scene("orbital"), 2 * SIZE
    camera = view_of(scene, FRAMES["orbital"], size)
    split = scene.split_at(LOBE)
    lobe = len(split.regions) - 1
    shown = (scene, split.isolated(lobe), split.hidden(lobe), split.edited(lobe, colour=(0.1, 0.55, 0.35)))
    write("parts.jpg", [halved(drawn(one, camera, "pcn")) for one in shown])


def journal_figure(studio: Studio) -> None:
    """The demo's scene and its painting as a figure of two columns."""
    names = {0: "sheet", 1: "vortex core", 2: "shell"}
    panels = []
    for file in ("scene.svv", "styled.svv"):
        scene = Scene.load(studio.demo / file)
        for region, name in names.items():
            scene = scene.edited(region, name=name)
        panels.append(Panel(scene, view_of(scene, FRAMES["demo"], 800)))
    drawn = figure(panels, columns="double", dpi=170, title=("palette", "oil, impasto and watercolour"))
    Image.fromarray(pixels_of(drawn)).save(IMAGES / "figure.jpg", quality=88)


def colour_vision(studio: Studio) -> None:
    """The demo's scene in two colours that merge, and as `svv edit --distinct` recolours it, as four people see it."""
    scene = studio.scene("demo").edited(0, colour=(0.80, 0.25, 0.16)).edited(1, colour=(0.45, 0.50, 0.14)).hidden(SHELL)
    rows, camera = [], view_of(scene, FRAMES["demo"], 560)
    for one in (scene, distinct(scene).scene):
        picture = halved(drawn(one, camera, "pcn"))
        rows.append([to_bytes(simulated(picture, vision)) for vision in COLOUR_VISIONS])
    Image.fromarray(sheet(rows, COLOUR_VISIONS)).save(IMAGES / "colour-vision.jpg", quality=88)


def matcaps(studio: Studio) -> None:
    """The MatCaps that ship; and the gyroid and the demo's scene in some of them."""
    side = WIDTH // (len(MATCAPS) // 2)
    spheres = [_sphere(name, side) for name in MATCAPS]
    half = len(spheres) // 2
    rows = [piece for k in (0, half) for piece in (
        np.concatenate(spheres[k : k + half], axis=1), labelled([*MATCAPS][k : k + half], side))]  # fmt: skip
    worn = (("gyroid", ("bronze", "jade", "x-ray")), ("demo", ("porcelain", "bronze", "jade")),
            ("orbital", ("clay", "chalk")), ("demo", ("velvet", "wax", "x-ray")))  # fmt: skip
    pictures = []
    for name, chosen in worn:
        scene, size = studio.scene(name), 2 * (WIDTH // len(worn))
        for region, matcap in enumerate(chosen):
            scene = scene.edited(region, matcap=matcap)
        pictures.append(halved(drawn(scene, view_of(scene, FRAMES[name], size), "pcn")))
    write("matcaps.jpg", [*rows, np.concatenate(pictures, axis=1)], below=True, width=WIDTH)


def _sphere(name: str, side: int) -> Pixels:
    """Return a MatCap as a sphere on white. (side, side, 3)"""
    size, margin = side - 60, 30
    x = (2.0 * np.arange(2 * size) + 1.0) / (2 * size) - 1.0
    inside = (np.square(x)[:, None] + np.square(x)[None] <= 1.0)[..., None]
    ball = halved(np.where(inside, matcap_picture(name, 2 * size), 1.0))
    return np.pad(ball, ((margin // 2, margin // 2), (margin, margin), (0, 0)), constant_values=1.0)


def styles(studio: Studio) -> None:
    """The gallery's pictures."""
    side = WIDTH // 6
    pictures = [Image.fromarray(to_bytes(gallery_picture(name, 512))) for name in GALLERY]
    shown = [np.asarray(one.resize((side, side), Image.Resampling.LANCZOS)) / 255.0 for one in pictures]
    rows = [piece for k in (0, 6) for piece in (
        np.concatenate(shown[k : k + 6], axis=1), labelled([*GALLERY][k : k + 6], side))]  # fmt: skip
    write("styles.jpg", rows, below=True, width=WIDTH)


def looks(studio: Studio) -> None:
    """The looks that ship, on scenes of one, two and three regions."""
    side, pictures = WIDTH // 5, []
    for name in LOOKS:
        look = Look.load(f"gallery:{name}")
        kind, mapping = (("demo", {1: 0}), ("gyroid", None), ("demo", None))[len(look.regions) - 1]
        scene = studio.scene(kind)
        if len(look.regions) < len(scene.regions):
            there = mapping or [pair.region for pair in look.matched(scene).pairs]
            scene = scene.isolated(*there)
        shown = look.applied(scene, mapping, preset="draft").scene
        pictures.append(halved(drawn(_as_visible(shown, scene), view_of(scene, FRAMES[kind], 2 * side))))
    rows = []
    for first in range(0, len(pictures), 5):
        rows += [np.concatenate(pictures[first : first + 5], axis=1), labelled([*LOOKS][first : first + 5], side)]
    write("looks.jpg", rows, below=True)


def _as_visible(scene: Scene, before: Scene) -> Scene:
    """Return a scene in which those regions are hidden that were hidden before."""
    hidden = [k for k, region in enumerate(before.regions) if region.hidden]
    return scene.hidden(*hidden) if hidden else scene


def look_on_another(studio: Studio) -> None:
    """The demo's painting; the gyroid; and the gyroid with the painting's look."""
    painting, other = Scene.load(studio.demo / "styled.svv"), studio.scene("gyroid")
    given = {name: StyleInput(gallery_picture(name), name) for name in ("oil", "impasto", "watercolour")}
    same = Look.of(painting, styles=given).applied(other, preset="draft").scene
    shown = ((painting, "demo"), (other, "gyroid"), (same, "gyroid"))
    pictures = [halved(drawn(one, view_of(one, FRAMES[name], 2 * SIZE))) for one, name in shown]
    write("look-applied.jpg", pictures)


def words(studio: Studio) -> None:
    """The demo's scene, and as two sentences change it."""
    scene = studio.scene("demo")
    for region, name in enumerate(("sheet", "knot", "shell")):
        scene = scene.edited(region, name=name)
    shown = [scene]
    said = "make the sheet pale jade, hide the shell", "the knot in bronze, the sheet deep teal and outlined"
    for sentence in said:
        shown.append(say(shown[-1], sentence).scene)
    camera = view_of(scene, FRAMES["demo"], 2 * SIZE)
    write("words.jpg", [halved(drawn(one, camera, "pcn")) for one in shown])


PICTURES: dict[str, Callable[[Studio], None]] = {
    one.__name__: one
    for one in (
        showpiece,
        gallery,
        glass,
        divided,
        stages,
        figures,
        ink,
        outlines,
        occlusion,
        shadow,
        sections,
        parts,
        journal_figure,
        colour_vision,
        styles,
        matcaps,
        looks,
        look_on_another,
        words,
    )
}


def main() -> None:
    """Draw the pictures from the output folder of ``svv demo``."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("demo", type=Path, help="the folder of `svv demo`")
    parser.add_argument("--only", action="append", choices=PICTURES, help="make these pictures; may be repeated")
    asked = parser.parse_args()
    studio = Studio(asked.demo)
    for name in asked.only or PICTURES:
        PICTURES[name](studio)
        print(name, flush=True)


if __name__ == "__main__":
    main()
