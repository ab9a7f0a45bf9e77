"""Paintings side by side: scenes x styles on one sheet, and the paper's figures reproduced with a scene.

Every painting is a scene file in the folder; existing ones are not painted again.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeGuard, cast

import numpy as np
from numpy.typing import NDArray

from svv.core.geometry.cameras import Camera
from svv.errors import BadInput, Progress
from svv.fields.scene.scene import Scene
from svv.io.files.atomic import check_writable
from svv.io.pictures.output import write_png
from svv.io.scene_file import checkpoint_of
from svv.job.stages import Show, Stages, fingerprint, unseen
from svv.options.making import PREFIX
from svv.render.frames import orbit, region_colours
from svv.render.pictures import Picture, cropped, fitted, over_white, sheet
from svv.styles.gallery import open_style
from svv.styles.segmenters import style_regions
from svv.train.lpips import load_lpips
from svv.train.paint.ink import StyleInput
from svv.train.pipeline import stylize_scene
from svv_bench.styles.likeness import caption, judge_of, painted_figures
from svv_bench.styles.table import averaged

PARTS = 3
"""Number of parts of one picture, and of their pairings with a scene's regions."""

FAINT, BRIGHT = 0.25, 1.6
"""Factors on opacity and on light in the figure of edits after painting."""

Style = NDArray[np.float32]
Cell = Picture | Style
Mask = NDArray[np.bool_] | None


@dataclass(frozen=True)
class Exhibit:
    """Settings with which paintings are made and shown."""

    preset: str = "fast"
    """Preset of the stylization."""
    size: int = 320
    """Side of the pictures in pixels."""
    frame: int = 76
    """Number of the view on the 181-view path, 0 to 180."""
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0 <= self.frame <= 180:
            raise BadInput(f"The frame must be a number from 0 to 180, not {self.frame}.")


class Studio:
    """Paints scenes in one folder and takes their pictures."""

    def __init__(self, folder: Path, how: Exhibit, show: Show = unseen) -> None:
        """Create the folder; raises BadInput if that fails."""
        self.stages, self.how = Stages(folder, show), how

    def paint(
        self, name: str, scene: Path, styles: Sequence[str], masks: Sequence[Mask] | None = None,
        keep: Collection[int] = (), mapping: dict[int, int] | None = None,
    ) -> Scene:  # fmt: skip
        """Return the scene painted with styles (files or ``gallery:NAME``), read from ``NAME.svv`` if it exists."""
        path, how = self.stages.folder / f"{name}.svv", self.how
        checkpoint = checkpoint_of(path)
        given = [style if style.startswith(PREFIX) else fingerprint(Path(style)) for style in styles]
        chosen: dict[str, Any] = {
            "scene": fingerprint(scene), "styles": given, "keep": sorted(keep), "preset": how.preset, "seed": how.seed,
            "masks": list(masks or ()), "map": sorted((mapping or {}).items()),
        }  # fmt: skip

        def work(progress: Progress) -> None:
            opened = [open_style(style) for style in styles]
            parts = masks or [None] * len(opened)
            given = [StyleInput(picture, name, mask) for (name, picture), mask in zip(opened, parts, strict=True)]
            painted, _ = stylize_scene(
                Scene.load(scene), given, how.preset, progress, checkpoint,
                mapping=mapping, keep=tuple(keep), seed=how.seed,
            )  # fmt: skip
            painted.save(path)
            checkpoint.unlink(missing_ok=True)

        self.stages.do(name, f"Painting {name}", chosen, [path], work)
        return Scene.load(path)

    def picture(self, scene: Scene, network: str | None = None) -> Picture:
        """Render one view of the scene over white."""
        return over_white(self.view(scene, network))

    def view(self, scene: Scene, network: str | None = None) -> NDArray[np.float32]:
        """Render one view of the scene, straight alpha, in [0, 1]. (size, size, 4)"""
        return np.asarray(scene.render(self.camera(scene), network).rgba, np.float32)

    def camera(self, scene: Scene) -> Camera:
        """Return the camera of the pictures, with its field of view narrowed to the sphere around the scene."""
        camera = orbit(scene, 181, self.how.size, self.how.size)[self.how.frame]
        box = scene.occupancy.box
        away = float(np.linalg.norm(camera.camera_to_world[:3, 3] - box.bounds.mean(axis=0)))
        radius = 0.5 * float(np.linalg.norm(box.bounds[1] - box.bounds[0]))
        if away <= radius:
            return camera
        if camera.is_orthographic:
            return replace(camera, span_x=2.0 * radius)
        return replace(camera, fov_x=2.0 * float(np.arcsin(radius / away)))

    def write(
        self, name: str, rows: Sequence[Sequence[Cell]], labels: Sequence[str], captions: Sequence[str] | None = None
    ) -> Path:
        """Write a sheet as ``NAME.png``: pictures of scenes, all cropped alike, and styles fitted to them."""
        path = self.stages.folder / f"{name}.png"
        (pictures,) = cropped([[cell for row in rows for cell in row if _is_picture(cell)]])
        (down, across), left = pictures[0].shape[:2], iter(pictures)

        def shown(cell: Cell) -> Picture:
            return next(left) if _is_picture(cell) else fitted(cast(Style, cell), across, down)

        cells = [[shown(cell) for cell in row] for row in rows]
        write_png(path, sheet(cells, labels, captions=captions))
        return path


def _is_picture(cell: Cell) -> TypeGuard[Picture]:
    return cell.dtype == np.uint8


def paint_sheet(scenes: Sequence[Path], styles: Sequence[str], out: Path, how: Exhibit, show: Show = unseen) -> Path:
    """Paint every scene in every style, and write ``sheet.png`` with a row per scene, its original colours first.

    Below each style's name are the figures of :data:`svv_bench.styles.likeness.CAPTION`, means over the scenes.

    Args:
        scenes: Scene files with different names.
        styles: Picture files or ``gallery:NAME``.
        out: Folder for the sheet and the painted scenes, ``SCENE-STYLE.svv``.
        how: Preset and size.
        show: Shows the progress of each painting.

    Returns:
        The sheet.

    Raises:
        BadInput: Two scenes or styles have the same name, a file cannot be read, or the folder cannot be written to.
    """
    opened = [open_style(style) for style in styles]
    names = [name for name, _ in opened]
    for what, given in (("scenes", [path.stem for path in scenes]), ("styles", names)):
        twice = sorted({name for name in given if given.count(name) > 1})
        if twice:
            raise BadInput(f"Two {what} are called '{twice[0]}': rename one, as paintings are named after them.")
    loaded = [Scene.load(path) for path in scenes]
    _check_painted(loaded, scenes)
    studio = Studio(out, how, show)
    check_writable(out / "sheet.png")
    blank = np.ones((16, 16, 3), np.float32)
    rows: list[list[Cell]] = [[blank, *(picture for _, picture in opened)]]
    network = load_lpips()
    judges = [judge_of(picture, how.size, network) for _, picture in opened]
    found: list[dict[str, float | str]] = []
    for path, scene in zip(scenes, loaded, strict=True):
        painted = [
            studio.paint(f"{path.stem}-{name}", path, [style]) for name, style in zip(names, styles, strict=True)
        ]
        views = [studio.view(one) for one in painted]
        rows.append([studio.picture(scene, "pcn"), *map(over_white, views)])
        for name, view, judge in zip(names, views, judges, strict=True):
            found.append({"style": name, **painted_figures(view[..., :3], view[..., 3], judge)})
    captions = {row["style"]: caption(row) for row in averaged(found, "style")}
    return studio.write("sheet", rows, ["", *names], ["", *(captions[name] for name in names)])


def paint_figures(scene: Path, styles: Sequence[str], out: Path, how: Exhibit, show: Show = unseen) -> list[Path]:
    """Reproduce the paper's figures with a scene, on what can be styled and what can be edited afterwards.

    ``several.png``: each region painted alone, then several pictures on one scene. ``parts.png``: three pairings of
    parts of one picture with the regions. ``edits.png``: opacity and light of the regions edited after painting.

    Args:
        scene: A scene file with at least two regions.
        styles: At least two pictures; the first is cut into parts.
        out: Folder for the figures and the painted scenes.
        how: Preset and size.
        show: Shows the progress of each painting.

    Returns:
        The figures.

    Raises:
        BadInput: The scene has only one region, there are fewer than two styles, a file cannot be read, or the folder
            cannot be written to.
    """
    if len(styles) < 2:
        raise BadInput("The figures need at least two styles: give --style twice.")
    opened = [open_style(style) for style in styles]
    plain = Scene.load(scene)
    _check_painted([plain], [scene])
    if len(plain.regions) < 2:
        raise BadInput("The figures need a scene with at least two regions, but this one has only one.")
    studio = Studio(out, how, show)
    figures: list[Callable[[], Path]] = [
        lambda: _several(studio, scene, plain, styles, opened),
        lambda: _parts(studio, scene, plain, styles[0], opened[0]),
        lambda: _edits(studio, scene, styles),
    ]
    return [make() for make in figures]


def _several(
    studio: Studio, scene: Path, plain: Scene, styles: Sequence[str], opened: Sequence[tuple[str, Style]]
) -> Path:
    count = len(plain.regions)
    pictures: list[Cell] = [studio.picture(plain, "pcn"), opened[0][1]]
    labels = ["palette", opened[0][0]]
    for region in range(count):
        others = set(range(count)) - {region}
        pictures.append(studio.picture(studio.paint(f"only-{region}", scene, styles[:1], None, others)))
        labels.append(f"region {region} alone")
    for name, picture in opened[1:]:
        pictures.append(picture)
        labels.append(name)
    pictures.append(studio.picture(studio.paint("several", scene, styles)))
    return studio.write("several", [pictures], [*labels, f"{len(styles)} pictures"])


def _parts(studio: Studio, scene: Path, plain: Scene, style: str, opened: tuple[str, Style]) -> Path:
    name, picture = opened
    parts = style_regions(picture, PARTS)
    top: list[Cell] = [picture]
    top += [np.where((parts == k)[..., None], picture, np.float32(1.0)) for k in range(PARTS)]
    bottom: list[Cell] = [studio.picture(plain, "pcn")]
    count = len(plain.regions)
    for turn in range(PARTS):
        mapping = {region: (region + turn) % PARTS for region in range(count)}
        masks = [parts == k for k in range(PARTS)]
        bottom.append(studio.picture(studio.paint(f"parts-{turn}", scene, [style] * PARTS, masks, (), mapping)))
    return studio.write("parts", [top, bottom], [name, *("abc"[k] for k in range(PARTS))])


def _edits(studio: Studio, scene: Path, styles: Sequence[str]) -> Path:
    painted = studio.paint("several", scene, styles)
    edited = {
        "painted": painted,
        "region 0 faint": painted.edited(0, opacity=FAINT),
        "region 1 faint": painted.edited(1, opacity=FAINT),
        "no light": _lit(painted, 0.0),
        "more light": _lit(painted, BRIGHT),
    }
    colours = region_colours(painted)
    region = painted.render(studio.camera(painted)).region
    there = np.where((region >= 0)[..., None], colours[region.clip(min=0)], 1.0)
    pictures = [np.rint(255 * there).astype(np.uint8), *map(studio.picture, edited.values())]
    return studio.write("edits", [pictures], ["regions", *edited])


def _lit(scene: Scene, factor: float) -> Scene:
    for region in range(len(scene.regions)):
        scene = scene.edited(region, lighting=factor)
    return scene


def _check_painted(scenes: Sequence[Scene], paths: Sequence[Path]) -> None:
    for scene, path in zip(scenes, paths, strict=True):
        if scene.palette_network is None:
            raise BadInput(f"{path} has no palette network, so it cannot be painted; train it again.")
