"""What an assistant can do in one folder: each method is a tool with plain arguments, and every path is below a root.

:mod:`svv.job.agents` offers them over the Model Context Protocol.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from svv.errors import BadInput, Progress, silent
from svv.options.making import PREFIX, AskedDivisionName, PaintOptions, PresetName, TrainOptions, ViewOptions

if TYPE_CHECKING:
    from svv.core.geometry.cameras import Camera
    from svv.fields.scene.scene import Scene

MOST_FILES = 500
"""Largest number of files that are listed."""

LARGEST = 2048
"""Largest side in pixels of a picture that is rendered."""


class Workshop:
    """Scenes, volumes and pictures below a folder; raises BadInput if there is no such folder."""

    def __init__(self, root: str | Path) -> None:
        self.root = Path(root).resolve()
        if not self.root.is_dir():
            raise BadInput(f"There is no folder {root}: give one that exists, for all files that are read and written.")

    def place(self, name: str) -> Path:
        """Return the path of a file below the root; raises BadInput if it is not below it, also by way of links."""
        path = self.root.parent if "\0" in name else (self.root / name).resolve()
        if not name.strip() or not path.is_relative_to(self.root):
            raise BadInput(f"'{name}' is not below the folder of this server: give a path relative to it.")
        return path

    def source(self, name: str) -> str:
        """Return a style or look as the functions below take it: ``gallery:NAME``, ``ink:NAME`` or a file."""
        return name if name.startswith((PREFIX, "ink:")) else str(self.place(name))

    def shown(self, path: Path) -> str:
        """Return a path below the root as the assistant knows it."""
        return path.relative_to(self.root).as_posix()

    def _scene(self, name: str) -> Scene:
        from svv.fields.scene.scene import Scene

        return Scene.load(self.place(name))

    def files(self) -> list[str]:
        """List the files in the folder of this server, such as volumes, scenes (.svv), pictures and looks."""
        found = sorted(self.shown(p) for p in self.root.rglob("*") if p.is_file() and not p.is_symlink())
        return found[:MOST_FILES]

    def info(self, scene: str) -> dict[str, Any]:
        """Show the regions of a scene (name, colour, values, opacity, style), its paintings and its edits."""
        told = self._scene(scene).info()
        keys = ("networks", "bounds", "lighting", "cuts", "variant", "variants", "undo", "redo", "times")
        regions = [
            {key: r[key] for key in ("name", "colour", "edited_colour", "values", "opacity", "hidden", "style")}
            for r in told["regions"]
        ]
        return {"regions": regions, **{key: told[key] for key in keys}}

    def views(
        self,
        volume: str,
        out: str,
        transfer_function: str | None = None,
        count: int = 42,
        size: int = 400,
        progress: Progress = silent,
    ) -> str:
        """Draw training views of a volume (.vti, .nrrd, .nii.gz, .tif ...) into a folder."""
        from svv.job.source import VolumeSource

        tf = None if transfer_function is None else self.place(transfer_function)
        folder = self.place(out)
        VolumeSource(self.place(volume), tf).make_views(folder, ViewOptions(n=count, test=0, size=size), progress)
        return self.shown(folder)

    def train(self, views: str, out: str, preset: PresetName = "fast", progress: Progress = silent) -> str:
        """Train a scene on a folder of views: draft takes seconds, fast and balanced minutes, best longer."""
        from svv.io.views.viewset import ViewSet
        from svv.job.request import Request, run

        path = self._new_scene(out)
        request = Request(ViewSet.read(self.place(views), "train"), train=TrainOptions(preset=preset))
        scene = run(request, progress).scene
        scene.save(path)
        return f"{self.shown(path)}: {len(scene.regions)} regions"

    def edit(self, scene: str, say: str, out: str, progress: Progress = silent) -> list[str]:
        """Edit a scene in words, such as "make the shell pale jade, thinner, hide the ring"; says what it understood.

        Names of regions or "region 0"; colours; thinner, opacity 0.4; hide, show, only; flat, outlined; light from the
        left; materials such as "in jade"; styles such as "as watercolour". Name regions first.
        """
        from svv.job.words.say import say as spoken

        path = self._new_scene(out)
        done = spoken(self._scene(scene), say, progress)
        done.scene.save(path)
        return [*done.understood, self.shown(path)]

    def cut(self, scene: str, out: str, cut: list[str] | None = None, uncut: bool = False) -> list[str]:
        """Cut a scene open: off goes what is inside of shapes; ``uncut`` takes away earlier cuts first.

        Shapes: "x>50%" or "x>50%&y<12.5" (percent of the bounds, or world units), "plane:X,Y,Z:NX,NY,NZ" (the side to
        which the direction points), "box:X,Y,Z:X,Y,Z", "sphere:X,Y,Z:R", "cylinder:X,Y,Z:DX,DY,DZ:R"; for some regions
        only with their numbers in front: "0,2=x>50%". What is outside of a shape: "outside sphere:X,Y,Z:R".
        """
        from svv.fields.scene.edit_request import with_edit
        from svv.options.editing import CutEdit, SceneEdit

        path = self._new_scene(out)
        edit = CutEdit(tuple(cut or ()) or None, uncut or None)
        if not edit:
            raise BadInput("Nothing to cut: give cut or uncut.")
        result = with_edit(self._scene(scene), SceneEdit(cuts=edit))
        result.save(path)
        return [*(one.describe() for one in result.cuts), self.shown(path)]

    def name(self, scene: str, names: dict[str, str], out: str) -> str:
        """Name regions of a scene by their numbers, such as {"0": "bone"}."""
        path, result = self._new_scene(out), self._scene(scene)
        for number, text in names.items():
            result = result.edited(_number(number), name=text)
        result.save(path)
        return self.shown(path)

    def styles(self) -> dict[str, str]:
        """List style pictures, inks, MatCaps and looks that come with svv."""
        from svv.core.colour.matcaps import MATCAPS
        from svv.job.looks.offered import LOOKS
        from svv.styles.gallery.offered import GALLERY, INKS

        found = {PREFIX + name: f"style, {told}" for name, (_, told) in GALLERY.items()}
        found |= {f"ink:{name}": "style, drawn in ink" for name in INKS}
        found |= {name: f"MatCap, {told}" for name, (_, told) in MATCAPS.items()}
        return found | {f"look {PREFIX}{name}": f"look, {look['title']}" for name, look in LOOKS.items()}

    def stylize(
        self,
        scene: str,
        styles: list[str],
        out: str,
        preset: PresetName = "balanced",
        divide: AskedDivisionName = "auto",
        parts: dict[str, str] | None = None,
        progress: Progress = silent,
    ) -> list[str]:
        """Paint the regions of a scene, in turn, in styles: pictures, gallery:NAME or ink:NAME.

        A picture that several regions share is divided among them; the answer says which region has which part, and
        what other parts there are. parts chooses them by name, such as {"0": "sky"}; divide="no" gives every region the
        whole picture.
        """
        from svv.fields.scene.region import swatches
        from svv.job.request import Paint, Request, paint
        from svv.train.paint.ink import StyleInput, style_named

        path = self._new_scene(out)
        opened = [style_named(self.source(style)) for style in styles]
        given = [StyleInput(style, label) for label, style in opened]
        named: dict[int, int | str] = {_number(region): part for region, part in (parts or {}).items()}
        options = PaintOptions(mapping=named or None, divide=divide, preset=preset)
        base = self._scene(scene)
        painted, report = paint(Request(base, paint=Paint.of(given, options)), base, progress)
        painted.save(path)
        shown = [f"{label} ({', '.join(colours)})" for colours, label in swatches(report["divided"], painted.regions)]
        return [*report["notes"], *shown, self.shown(path)]

    def save_look(self, scene: str, out: str) -> str:
        """Save how a scene looks to a file, for other scenes."""
        from svv.job.looks.look import Look

        path = self.place(out)
        Look.of(self._scene(scene)).save(path)
        return self.shown(path)

    def apply_look(self, look: str, scene: str, out: str, progress: Progress = silent) -> list[str]:
        """Give a scene a look, from a file or gallery:NAME; says which regions matched."""
        from svv.job.looks.look import Look

        path, given = self._new_scene(out), Look.load(self.source(look))
        done = given.applied(self._scene(scene), progress=progress)
        done.scene.save(path)
        return [*done.matches.describe(given, done.scene), *done.notes, self.shown(path)]

    def render(
        self,
        scene: str,
        out: str,
        azimuth: float = 0.0,
        elevation: float = 0.0,
        size: int = 512,
        progress: Progress = silent,
    ) -> str:
        """Render a scene over white to a .png, from degrees to the right of and above its front."""
        from svv.core.colour.colour import WHITE
        from svv.render.frames import RenderSettings, write_view

        if not 16 <= size <= LARGEST:
            raise BadInput(f"A picture has 16 to {LARGEST} pixels a side, not {size}.")
        path, loaded = self.place(out), self._scene(scene)
        if path.suffix.lower() != ".png":
            raise BadInput(f"A picture is a .png, not '{out}': choose another name.")
        camera = _camera(loaded, azimuth, elevation, size)
        write_view(path, loaded, camera, RenderSettings(background=WHITE), progress)
        return self.shown(path)

    def figure(
        self,
        scenes: list[str],
        out: str,
        unit: str | None = None,
        value_unit: str | None = None,
        volume: bool = False,
        progress: Progress = silent,
    ) -> list[str]:
        """Make a figure for a paper (.pdf, .svg, .png, .tiff): a panel for each scene, legend, scale bar and axes.

        With volume, the rendering of each scene's volume beside it. Says what to know of it, such as look-alikes.
        """
        from svv.job.volume_panels import panel_of, remembered
        from svv.render.figures.figure import Panel, figure

        path, said, panels = self.place(out), list[str](), list[Panel]()
        for name in scenes:
            loaded = self._scene(name)
            if volume:
                panels.append(panel_of(loaded, remembered(loaded, [], [self.place(name).parent], self.root)))
            panels.append(Panel(loaded))
        figure(panels, path, unit=unit, value_unit=value_unit, progress=progress, tell=said.append)
        return [*said, self.shown(path)]

    def export(self, scene: str, out: str, splats: int = 60_000, progress: Progress = silent) -> str:
        """Write a scene as a page for any browser (.html), or as 3D Gaussian splats (.ply, .spz, .glb, .usdz).

        Fitting splats takes about a minute; ``splats`` is how many at most. Says what to know of the file.
        """
        from svv.job.splats import export_splats
        from svv.options.splats import SplatOptions
        from svv.render.web.page import write_html

        path, loaded = self.place(out), self._scene(scene)
        if path.suffix.lower() == ".html":
            said: list[str] = []
            size = write_html(path, loaded, path.stem, progress=progress, tell=said.append)
            return " ".join([f"{self.shown(path)}: {size / 1e6:.1f} MB.", *said])
        return f"{self.shown(path)}: {export_splats(path, loaded, SplatOptions(splats), progress)}"

    def _new_scene(self, name: str) -> Path:
        from svv.io.files.atomic import check_writable

        path = self.place(name)
        if path.suffix != ".svv":
            raise BadInput(f"A scene is a .svv, not '{name}': choose another name.")
        check_writable(path)
        return path


def _number(region: str) -> int:
    if not (region.isascii() and region.isdigit()):
        raise BadInput(f"'{region}' is no region's number: give for example {{'0': 'bone'}}.")
    return int(region)


def _camera(scene: Scene, azimuth: float, elevation: float, size: int) -> Camera:
    from svv.render.frames import seen_from

    if not (-360.0 <= azimuth <= 360.0 and -90.0 <= elevation <= 90.0):
        raise BadInput(f"There is no side {azimuth:g}, {elevation:g}: the elevation lies between -90 and 90 degrees.")
    return seen_from(scene, azimuth, elevation, size, size)


TOOLS = ("files", "info", "name", "edit", "cut", "styles", "stylize", "save_look", "apply_look", "render", "figure",
         "export", "views", "train")  # fmt: skip
"""Methods of :class:`Workshop` that are tools; their docstrings are what an assistant reads. Those that take long tell
their progress, and stop when it raises."""
