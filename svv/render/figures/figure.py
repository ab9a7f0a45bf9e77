"""Figures: panels of scenes with a legend, a scale bar and orientation axes, drawn by matplotlib from our own pictures.

Pictures are placed on whole pixels, so that none is sampled a second time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from string import ascii_lowercase, ascii_uppercase
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from svv.core.colour.colour import over
from svv.core.colour.colour_vision import LEAST_DIFFERENCE
from svv.core.colour.hex_codes import to_hex
from svv.core.geometry.cameras import Camera
from svv.core.geometry.given_cameras import GivenCamera, camera_of
from svv.errors import BadInput, Progress, part, silent, warn_caller
from svv.fields.scene.doubt import expected_of
from svv.fields.scene.model import in_words
from svv.fields.scene.region import validate_line
from svv.fields.scene.seen_colours import Pair, Seen, seen_in, seen_of
from svv.io.pictures.output import to_bytes
from svv.options.figures import FigureOptions
from svv.render.emptiness import SHOW, why_empty
from svv.render.figures.colour_check import describe_lookalikes, merging, regions_to_json, report_on
from svv.render.figures.files import check_kind, write_figure
from svv.render.figures.framing import camera_through, free_corner, parallel, preview_camera, together, windows_of
from svv.render.figures.hatching import (
    HATCHED,
    PIXELS,
    SPACING,
    draw_lines,
    entry_on,
    hatched_disc,
    lines_over,
    mean_around,
)
from svv.render.figures.swatches import Entry, entries_of
from svv.render.frames import orbit
from svv.render.supersampled import supersampled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from svv.fields.scene.scene import Scene
    from svv.render.figures.framing import Window
    from svv.render.figures.layout import Box, Layout, Line
    from svv.render.figures.lettering import Lettering

SWATCH_VIEW = 400
"""Width of the pictures that swatches are cut from, in pixels."""

MOST_PANELS = 24
"""Largest number of panels: more cannot be seen on a page."""

FINE_DPI = 600
"""Resolution from which a pixel has one ray: as many an inch as four rays a pixel have at half of it. Stairs of strokes
at a slant are then too small for a reader to see."""

LONGEST_UNIT, LONGEST_TITLE = 20, 300
"""Most characters of a unit and of a title; a title also has to fit above its panel."""

SHOWN = {"base": "base network", "pcn": "palette network", "styled": "painting"}
"""What panels of each network show."""

MOST_PIXELS = 150_000_000
"""Largest number of pixels of a figure."""


@dataclass(frozen=True)
class Panel:
    """One picture of a figure.

    >>> panel = svv.Panel(scene, title="from the front")
    >>> panel.title, panel.camera is None
    ('from the front', True)
    """

    scene: Scene
    camera: GivenCamera | None = None
    """As for :func:`svv.show`; by default in front, at the distance of the training views."""
    title: str = ""
    look: object = None
    """Panels of the same value look alike and share a legend; by default, those of the same scene do."""
    network: str | None = None
    """The network that gives its colours; by default the figure's."""
    draw: Callable[[Camera], NDArray[np.float32]] | None = None
    """What draws its picture instead of the network, straight RGBA (h, w, 4) in [0, 1], such as
    :func:`svv.job.volume_panels.volume_panel`; its regions, their names and swatches are those of the scene's network.
    """
    shows: str = ""
    """What it shows, in a few words: its title if it has no other and is wide enough."""
    note: str = ""
    """What readers of the figure should know of what it shows: the end of a sentence that begins with its name."""


def figure(
    panels: Scene | Panel | Sequence[Scene | Panel],
    out: str | Path | None = None,
    options: FigureOptions | None = None,
    progress: Progress = silent,
    tell: Callable[[str], None] = warn_caller,
    **changes: Any,
) -> Figure:
    """Draw a figure of one or several scenes.

    Args:
        panels: What to show, in the order of reading; a scene is a panel seen from the front.
        out: A .pdf, .svg, .png or .tiff to write it to.
        options: How it is laid out.
        progress: Called while panels are rendered.
        tell: Called with a sentence on each panel that shows nothing, or something else than was asked for, and on
            regions that look alike.
        changes: Fields of the options to change, by name, such as ``unit="mm"``.

    Returns:
        The figure, to which more can be drawn; :func:`svv.render.figures.files.write_figure` writes it.

    Raises:
        BadInput: matplotlib is missing, an option is out of range, no font has a character of a name, the legend does
            not fit, a scene lacks the network, nothing is visible in any panel, or the file cannot be written.

    >>> drawn = svv.figure(scene, width=60.0)
    >>> len(drawn.axes) > 0
    True
    """
    return drawing_of(panels, out, options, progress, tell, **changes).figure


def _name(number: int, count: int) -> str:
    """Return what one of several panels is called in sentences."""
    return f"panel {ascii_lowercase[number]}" if count > 1 else "the figure"


def drawing_of(
    panels: Scene | Panel | Sequence[Scene | Panel],
    out: str | Path | None = None,
    options: FigureOptions | None = None,
    progress: Progress = silent,
    tell: Callable[[str], None] = warn_caller,
    **changes: Any,
) -> Drawing:
    """Draw a figure as :func:`figure`; return it with what is known of it (:meth:`Drawing.report`)."""
    need_matplotlib()
    options = replace(options or FigureOptions(), **changes)
    _check(options)
    if out is not None:
        check_kind(out)
    listed = [panels] if not isinstance(panels, Sequence) else list(panels)
    every = [p if isinstance(p, Panel) else Panel(p) for p in listed]
    for panel in every:
        validate_line(panel.title, "The title of a panel", LONGEST_TITLE)
    if not 1 <= len(every) <= MOST_PANELS:
        raise BadInput(f"A figure has 1 to {MOST_PANELS} panels, not {len(every)}.")
    for number, panel in enumerate(every):
        if panel.note:  # before minutes of drawing
            tell(f"{_name(number, len(every)).capitalize()} {panel.note}")
    if options.hatch_doubt is not None:
        for panel in every:
            expected_of(panel.scene)
    front = _front(every)
    drawing = Drawing([_placed(panel, front, options) for panel in every], options, progress)
    if all(drawing.empty):
        raise BadInput(f"Nothing is visible in the figure, because {drawing.empty[0]}: {SHOW}.")
    for said in drawing.notes():
        tell(said)
    drawing.figure.set_label(". ".join(dict.fromkeys(map(_in_words, drawing.panels))))
    if out is not None:
        write_figure(drawing.figure, out, regions_to_json(drawing.seen))
    progress(1.0, "figure")
    return drawing


def _in_words(panel: Panel) -> str:
    """Return what a panel shows, for those who do not see it."""
    said = in_words(panel.scene, panel.network)
    return said if panel.draw is None else said.replace("A rendering", "A volume rendering", 1)


def need_matplotlib() -> None:
    """Check that matplotlib is installed; raises BadInput otherwise."""
    from importlib.util import find_spec

    if find_spec("matplotlib") is None:
        raise BadInput("Figures need matplotlib, which is not installed; install it with: pip install 'svv[figure]'.")


def _check(options: FigureOptions) -> None:
    """Raise BadInput if a number is out of range."""
    for name, value, low, high, unit in (
        ("width", options.mm, 20.0, 1000.0, "mm"),
        ("resolution", options.dpi, 50, 1200, "dpi"),
        ("size of the text", options.points, 4.0, 40.0, "pt"),
    ):
        if not low <= value <= high:
            raise BadInput(f"The {name} of a figure must lie between {low:g} and {high:g} {unit}, not {value:g}.")
    if options.hatch_doubt is not None and not 0.0 < options.hatch_doubt <= 1.0:
        raise BadInput(
            "The error from which on a figure is hatched lies above 0 and is at most 1, such as 0.05, not "
            f"{options.hatch_doubt:g}."
        )
    if options.across is not None and options.across < 1:
        raise BadInput(f"A figure has at least one panel across, not {options.across}.")
    if len(options.behind) != 3 or not all(0.0 <= c <= 1.0 for c in options.behind):
        raise BadInput(f"{tuple(options.behind)} is no background: give red, green and blue between 0 and 1.")
    for what, text in (("unit", options.unit), ("unit of the values", options.value_unit)):
        validate_line(text or "", f"The {what}", LONGEST_UNIT)
    for number, title in enumerate(options.title):
        validate_line(title, f"Title {number}", LONGEST_TITLE)
    for name in axis_names(options.axes) or ():
        validate_line(name, "The name of an axis")


def axis_names(text: str | None) -> tuple[str, str, str] | None:
    """Return the names in 'x,y,z'; None for 'none' or None; raises BadInput for anything else."""
    if text is None or text.strip().lower() == "none":
        return None
    names = [name.strip() for name in text.split(",")]
    if len(names) != 3 or not all(0 < len(name) <= 8 for name in names):
        raise BadInput(f"--axes needs three short names, for example --axes x,y,z or R,A,S, or none, not '{text}'.")
    return names[0], names[1], names[2]


def _front(panels: Sequence[Panel]) -> Camera | None:
    """Return the camera of panels that have none: the widest of those before the scenes; None if they lie apart.

    Scenes of one volume and several transfer functions thus have one scale and one place.
    """
    scenes = [panel.scene for panel in panels if panel.camera is None]
    widths = [s.rig.span_x or 2.0 * s.rig.radius * math.tan(0.5 * s.rig.fov_x) for s in scenes]
    if not scenes:
        return None
    widest = scenes[widths.index(max(widths))]
    away = max(math.dist(widest.rig.centre, scene.rig.centre) for scene in scenes)
    alike = min(widths) > 0.5 * max(widths) and len({scene.rig.span_x is None for scene in scenes}) == 1
    return orbit(widest, 181, 800, 800)[90] if alike and away < 0.5 * max(widths) else None


def _placed(panel: Panel, front: Camera | None, options: FigureOptions) -> Panel:
    """Return a panel with a network that it has, and a camera: its own, or the one before all scenes or its scene."""
    there = panel.scene.networks
    network = panel.network or options.network or there[-1]
    if network not in there:
        raise BadInput(f"The scene has no network '{network}', only {', '.join(there)}.")
    if panel.camera is None:
        camera = front or orbit(panel.scene, 181, 800, 800)[90]
    else:
        camera = camera_of(panel.camera, panel.scene)
    if options.parallel:
        camera = parallel(camera, _middle(panel.scene))
    look = (id(panel.scene), network) if panel.look is None else panel.look
    return replace(panel, camera=camera, network=network, look=look)


def _camera(panel: Panel) -> Camera:
    """Return the camera of a panel that was placed."""
    assert isinstance(panel.camera, Camera)
    return panel.camera


def _middle(scene: Scene) -> NDArray[np.float64]:
    return np.asarray(scene.occupancy.box.bounds, np.float64).mean(0)


@dataclass(frozen=True)
class Alike:
    """Two regions that nobody can tell apart across a picture, and where that is so."""

    pair: Pair
    where: str

    def describe(self) -> str:
        """Return it in words."""
        return f"{self.pair.first} and {self.pair.second} {self.where} ({self.pair.difference:.1f})"

    def to_json(self) -> dict[str, object]:
        """Return plain values."""
        pair = self.pair
        return {"first": pair.first, "second": pair.second, "difference": pair.difference, "where": self.where}


class Drawing:
    """A figure while it is drawn."""

    def __init__(self, panels: Sequence[Panel], options: FigureOptions, progress: Progress) -> None:
        from matplotlib.figure import Figure

        from svv.render.figures.layout import laid_out

        self.panels, self.options = panels, options
        self.alphas = together([self._preview(panel) for panel in panels], [_camera(panel) for panel in panels])
        self.windows = windows_of(self.alphas, options.frame == "content")
        heads, names = self._heads(), axis_names(options.axes) or ()
        one = len({panel.look for panel in panels}) == 1
        self.shared = [list(range(len(panels)))] if one else [[number] for number in range(len(panels))]
        """Numbers of the panels of each legend."""
        legends = self._legends(part(progress, 0.0, 0.3))
        self._look(part(progress, 0.3, 0.4))
        remarks = [describe_lookalikes([one.pair for one in alike]) for alike in self.alike]
        remarks = [said if own else "" for said, own in zip(remarks, legends)] if options.legend != "none" else [""]
        units = [unit for unit in (options.unit,) if unit]
        entries = [entry for legend in legends for entry in legend]
        texts = [*(f"{letter}{title}" for letter, title in heads), *names, *units, *remarks]
        texts += [text for entry in entries for text in (entry.name, entry.values)]
        self.lettering = self._lettering(texts)
        self.strip = 0.0
        """Height in mm of the empty strip below the pictures, for annotations that find no empty corner."""
        head, aspect = any(map(any, heads)), self.windows[0].aspect
        self.layout = laid_out(options, self.lettering, aspect, legends, head, len(panels), remarks)
        self.strip = self._missing(self.layout.panels[0])
        if self.strip:
            aspect += self.strip / self.layout.panels[0].width
            self.layout = laid_out(options, self.lettering, aspect, legends, head, len(panels), remarks)
        self.size = self._size(self.layout)
        self.figure = Figure(figsize=(self.size[0] / options.dpi, self.size[1] / options.dpi), dpi=options.dpi)
        self.figure.patch.set_facecolor(to_hex(options.behind))
        self.figure.patch.set_alpha(0.0 if options.transparent else 1.0)
        self.empty: list[str] = []
        """Why each panel shows nothing; '' if it shows something."""
        self.hatched: dict[int, tuple[float, float]] = {}
        """Of each panel whose errors are known, the part of what is visible that is hatched, and the largest error."""
        for number, box in enumerate(self.layout.panels):
            each = part(progress, 0.4 + 0.6 * number / len(panels), 0.4 + 0.6 * (number + 1) / len(panels))
            self._draw_panel(number, box, each)
            self._draw_head(box, *heads[number], panels[number].shows)
        for line in self.layout.legend:
            self._draw_line(line)

    def _lettering(self, texts: Iterable[str]) -> Lettering:
        from svv.render.figures.lettering import Lettering, families_for

        luminance = float(np.dot(self.options.behind, (0.299, 0.587, 0.114)))
        ink = "#000000" if luminance > 0.45 else "#ffffff"
        return Lettering(families_for(texts, self.options.font), self.options.points, ink)

    def _preview(self, panel: Panel) -> NDArray[np.float32]:
        camera = preview_camera(_camera(panel))
        if panel.draw is not None:
            return panel.draw(camera)[..., 3]
        plain = "pcn" if panel.network == "styled" else panel.network  # paint changes no mean opacity
        return panel.scene.while_moving().render(camera, plain).rgba[..., 3]

    def _look(self, progress: Progress) -> None:
        """Find the colours of the regions in each panel and all around its scene, and those that look alike."""
        around: dict[object, list[Seen]] = {}
        self.seen: list[list[Seen]] = []
        """The colours of the regions in each panel."""
        for number, (panel, window) in enumerate(zip(self.panels, self.windows, strict=True)):
            progress(number / len(self.panels), "colours")
            scene = panel.scene
            if not scene.regions or scene.palette_network is None:
                self.seen.append([])
                continue
            camera = camera_through(_camera(panel), window, SWATCH_VIEW, max(1, round(SWATCH_VIEW * window.aspect)))
            shown = scene.render(camera, panel.network)
            if panel.draw is not None:
                shown = replace(shown, rgba=panel.draw(camera))
            elif panel.look not in around and scene.camera_rig is not None:
                around[panel.look] = list(seen_in(scene, panel.network, self.options.behind).values())
            self.seen.append(list(seen_of(scene, [shown], self.options.behind).values()))
        self.around = [around.get(panel.look, []) if panel.draw is None else [] for panel in self.panels]
        """The colours of the regions of each panel's scene, from all around."""
        self.alike = [self._alike(numbers) for numbers in self.shared]
        """The regions of each legend that look alike, the most alike first."""

    def _alike(self, numbers: Sequence[int]) -> list[Alike]:
        """Return the regions of some panels that look alike in one of them, or from all around."""
        there = {one.name for number in numbers for one in self.seen[number]}
        found = [Alike(pair, f"in {self._name(k)}") for k in numbers for pair in merging(self.seen[k])]
        around = [one for one in self.around[numbers[0]] if one.name in there]
        whose = "" if len(self.shared) == 1 else f" {self._name(numbers[0])}'s scene"
        found += [Alike(pair, f"from all around{whose}") for pair in merging(around)]
        nearest: dict[tuple[str, str], Alike] = {}
        for one in sorted(found, key=lambda one: one.pair.difference):
            nearest.setdefault((one.pair.first, one.pair.second), one)
        return list(nearest.values())

    def _name(self, number: int) -> str:
        return _name(number, len(self.panels))

    def notes(self) -> list[str]:
        """Return sentences on panels that show or hatch nothing and on look-alikes."""
        said = [
            f"{self._name(number).capitalize()} is empty, because {why}."
            for number, why in enumerate(self.empty)
            if why
        ]
        said += [
            f"Nothing is hatched in {self._name(number)}: its expected errors are at most {100.0 * most:.2g} %."
            for number, (part_of, most) in self.hatched.items()
            if part_of == 0.0
        ]
        alike = dict.fromkeys(one.describe() for legend in self.alike for one in legend)
        if alike:
            said.append(
                f"Regions look alike: {'; '.join(alike)}. They are told apart from {LEAST_DIFFERENCE:g} (CIEDE2000). "
                "svv edit --distinct colours moves colours and strokes apart."
            )
        return said

    def report(self) -> dict[str, Any]:
        """Return what each panel shows, how far its regions are apart, and which of each legend look alike (JSON).

        ``hatched`` is the part of what is visible that is hatched, None where no expected error is shown.

        Colours of a panel are those of `svv check-colours FIGURE`, ``from_all_around`` those of its scene.
        """
        panels = [
            {
                "panel": ascii_lowercase[number],
                "title": title,
                "shows": panel.shows or SHOWN[panel.network or ""],
                "note": f"{self._name(number).capitalize()} {panel.note}" if panel.note else "",
                "hatched": self.hatched[number][0] if number in self.hatched else None,
                "colours": report_on(self.seen[number]),
                "from_all_around": report_on(self.around[number]) if self.around[number] else None,
            }
            for number, (panel, (_, title)) in enumerate(zip(self.panels, self._heads(), strict=True))
        ]
        legends = [
            {"panels": [ascii_lowercase[k] for k in numbers], "look_alike": [one.to_json() for one in alike]}
            for numbers, alike in zip(self.shared, self.alike, strict=True)
        ]
        return {"panels": panels, "legends": legends}

    def _heads(self) -> list[tuple[str, str]]:
        """Return the letter and the title above each panel."""
        kind, count = self.options.letters, len(self.panels)
        kind = ("a" if count > 1 else "none") if kind == "auto" else kind
        alphabet = ascii_uppercase if kind == "A" else ascii_lowercase
        letters = [f"({c})" if kind == "(a)" else "" if kind == "none" else c for c in alphabet[:count]]
        titles = [*self.options.title, *("",) * count]
        if len(self.options.title) > count:
            raise BadInput(f"There are {len(self.options.title)} titles for {count} panels: give one for each.")
        return [
            (letter, panel.title or title or panel.shows) for letter, panel, title in zip(letters, self.panels, titles)
        ]

    def _legends(self, progress: Progress) -> list[list[Entry]]:
        """Return the legend of all panels if they look alike, otherwise one for each; none where none is asked for."""
        if self.options.legend == "none":
            return [[]]
        found = []
        for number, *_ in self.shared:
            progress(number / len(self.panels), "legend")
            found.append(self._entries(self.panels[number], self.windows[number]))
        return found

    def _entries(self, panel: Panel, window: Window) -> list[Entry]:
        from svv.render.figures.layout import columns_for, swatch_diameter
        from svv.render.figures.lettering import Lettering

        doubt = self.options.hatch_doubt
        hatching = [] if doubt is None else [entry_on(doubt)]
        if panel.network in (None, "base") or panel.scene.palette_network is None:
            return hatching
        camera = camera_through(_camera(panel), window, SWATCH_VIEW, max(1, round(SWATCH_VIEW * window.aspect)))
        diameter = swatch_diameter(Lettering((), self.options.points, ""))
        panel_mm = self.options.mm / columns_for(len(self.panels), self.options.across)
        size = max(4, round(diameter / 25.4 * self.options.dpi))
        regions = entries_of(
            panel.scene, camera, panel.network, size, diameter * SWATCH_VIEW / panel_mm, self.options.value_unit
        )
        return regions + hatching

    def _size(self, layout: Layout) -> tuple[int, int]:
        """Return the width and height of the figure in pixels."""
        width, height = self._pixels(layout.width), self._pixels(layout.height)
        if width * height > MOST_PIXELS:
            raise BadInput(
                f"The figure would have {width} x {height} pixels: give fewer dpi than {self.options.dpi}, or make it "
                "smaller."
            )
        return width, height

    def _pixels(self, mm: float) -> int:
        return max(1, round(mm / 25.4 * self.options.dpi))

    def _axes(self, left: int, top: int, width: int, height: int) -> Axes:
        """Return matplotlib's axes over whole pixels, without frame."""
        across, down = self.size
        axes = self.figure.add_axes((left / across, 1.0 - (top + height) / down, width / across, height / down))
        axes.set_axis_off()
        return axes

    def _picture(self, left: int, top: int, pixels: NDArray[np.float32]) -> None:
        """Draw straight RGBA (h, w, 4) at a place in pixels."""
        shown = to_bytes(pixels if self.options.transparent else over(pixels, self.options.behind))
        self._axes(left, top, pixels.shape[1], pixels.shape[0]).imshow(shown, interpolation="none", aspect="auto")

    def _draw_panel(self, number: int, box: Box, progress: Progress) -> None:
        panel, window = self.panels[number], self.windows[number]
        left, top = self._pixels(box.left), self._pixels(box.top)
        width, height = self._pixels(box.width), self._pixels(box.height - self.strip)
        camera = camera_through(_camera(panel), window, width, height)
        if panel.draw is not None:
            pixels = panel.draw(camera)
            self.empty.append("" if pixels[..., 3].any() else "the camera sees nothing of the volume")
        else:
            samples = 1 if self.options.dpi >= FINE_DPI else None
            rendering = supersampled(panel.scene, camera, panel.network, None, progress, samples)
            pixels = rendering.rgba
            self.empty.append(why_empty(panel.scene, rendering.depth))
        self._picture(left, top, pixels)
        axes = self._axes(left, top, width, self._pixels(box.height))
        axes.set_xlim(0.0, box.width)
        axes.set_ylim(0.0, box.height)
        self._hatch(number, axes, box)
        corners = self._corners(number, box, self.strip)
        assert corners is not None  # the strip has room for all
        for (size, draw), corner in zip(self._notes(number, box), corners, strict=True):
            x = box.width - size[0] if "right" in corner else 0.0
            draw(axes, (x, box.height - size[1] if "upper" in corner else 0.0))

    def _hatch(self, number: int, axes: Axes, box: Box) -> None:
        """Hatch where a panel is expected to be off by more than asked; a volume rendering is what it is."""
        panel, level = self.panels[number], self.options.hatch_doubt
        if level is None or panel.draw is not None:
            return
        size = box.width, box.height - self.strip
        width, height = (max(8, round(PIXELS * side)) for side in size)
        errors = panel.scene.doubt(camera_through(_camera(panel), self.windows[number], width, height))
        mean = mean_around(errors, PIXELS * SPACING)
        lines = lines_over(mean, level, size) + np.array([0.0, self.strip])
        draw_lines(axes, lines, self.lettering, self.options.behind)
        seen = mean[np.isfinite(mean)]
        if seen.size:
            self.hatched[number] = float((seen > level).mean()), float(seen.max())

    def _corners(self, number: int, box: Box, strip: float) -> list[str] | None:
        """Return an empty corner for each annotation of a panel, if there is one for all."""
        taken: list[str] = []
        for size, _ in self._notes(number, box):
            part = size[0] / box.width, size[1] / box.width
            corner = free_corner(self.alphas[number], self.windows[number], part, taken, strip / box.width)
            if corner is None:
                return None
            taken.append(corner)
        return taken

    def _missing(self, box: Box) -> float:
        """Return the height in mm of the strip that panels as large as a box need below their pictures."""
        notes = [note for number in range(len(self.panels)) for note in self._notes(number, box)]
        most = max((height for (_, height), _ in notes), default=0.0)
        for strip in np.arange(0.0, most, 1.0):
            if all(self._corners(number, box, float(strip)) is not None for number in range(len(self.panels))):
                return float(strip)
        return most

    def _notes(self, number: int, box: Box) -> list[tuple[tuple[float, float], Callable[..., None]]]:
        """Return the annotations of a panel: their size in mm, and what draws them into axes at a place."""
        from svv.render.figures import annotations as notes

        found: list[tuple[tuple[float, float], Callable[..., None]]] = []
        panel, window, names = self.panels[number], self.windows[number], axis_names(self.options.axes)
        seen_by = _camera(panel)
        if names is not None:
            draw = partial(notes.draw_axes, lettering=self.lettering, names=names, camera=seen_by)
            found.append((notes.axes_size(self.lettering, seen_by), draw))
        if self.options.scale_bar:
            across = max(1, self._pixels(box.width))
            camera = camera_through(seen_by, window, across, max(1, round(across * window.aspect)))
            length, mm = notes.bar_of(camera, _middle(panel.scene), box.width)
            text = notes.format_length(length, self.options.unit)
            bar = partial(notes.draw_bar, lettering=self.lettering, text=text, length=mm)
            found.append((notes.bar_size(self.lettering, text, mm), bar))
        return found

    def _draw_head(self, box: Box, letter: str, title: str, optional: str) -> None:
        """Write the letter and the title of a panel above it, if there is room for a title that nobody gave it."""
        y = box.top - 0.8 - 0.25 * self.lettering.line
        indent = self.lettering.width(f"{letter}  ", bold=True) if letter else 0.0
        self._text(box.left, y, letter, bold=True)
        lines = self.lettering.wrapped(title, box.width - indent)
        if len(lines) > 1 and title == optional:
            return
        if len(lines) > 1:
            raise BadInput(f"The title '{title}' is wider than its panel: shorten it, or make the figure wider.")
        self._text(box.left + indent, y, title)

    def _text(self, x: float, y: float, text: str, bold: bool = False) -> None:
        """Write a line of text at a place in mm."""
        if text:
            across, down = self.size
            at = self._pixels(x) / across, 1.0 - y / 25.4 * self.options.dpi / down
            self.figure.text(at[0], at[1], text, va="baseline", **self.lettering.properties(bold))

    def _draw_line(self, line: Line) -> None:
        """Draw a line of the legend: the swatch, and its name above its values."""
        from svv.render.figures.layout import BESIDE, swatch_diameter

        diameter, box, indent = swatch_diameter(self.lettering), line.box, 0.0
        if line.entry is not None:
            top, indent = box.top + 0.5 * (box.height - diameter), diameter + BESIDE
            left, up = self._pixels(box.left), self._pixels(top)
            if line.entry.number == HATCHED:
                axes = self._axes(left, up, self._pixels(diameter), self._pixels(diameter))
                axes.set_xlim(0.0, diameter)
                axes.set_ylim(0.0, diameter)
                draw_lines(axes, hatched_disc(diameter), self.lettering, self.options.behind)
            else:
                self._picture(left, up, line.entry.swatch)
        words = [*line.name, *line.values]
        first = box.top + 0.5 * (box.height - len(words) * self.lettering.line)
        for k, word in enumerate(words):
            y = first + (k + 0.76) * self.lettering.line
            self._text(box.left + indent, y, word)
