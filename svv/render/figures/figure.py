"""Figures: panels of scenes with a legend, a scale bar and orientation axes, drawn by matplotlib from our own pictures.

Pictures are placed on whole pixels, so that none is sampled a second time.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from string import ascii_lowercase, ascii_uppercase
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from svv.core.colour.colour import over, to_hex
from svv.core.geometry.cameras import Camera
from svv.errors import BadInput, Progress, part, silent
from svv.fields.scene.region import checked_line
from svv.fields.scene.seen_colours import Seen, seen_of
from svv.io.pictures.output import to_bytes
from svv.options.figures import FigureOptions
from svv.render.colour_check import told_of
from svv.render.emptiness import SHOW, why_empty
from svv.render.figures.files import check_kind, write_figure
from svv.render.figures.framing import (
    camera_through,
    free_corner,
    parallel,
    preview_camera,
    windows_of,
)
from svv.render.figures.layout import Line
from svv.render.figures.swatches import Entry, entries_of
from svv.render.frames import orbit
from svv.render.pictures import in_words
from svv.render.supersampled import supersampled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from svv.fields.scene.scene import Scene
    from svv.render.figures.framing import Window
    from svv.render.figures.layout import Box, Layout
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
    camera: Camera | None = None
    """By default in front, at the distance of the training views."""
    title: str = ""
    look: object = None
    """Panels of the same value look alike and share a legend; by default, those of the same scene do."""


def figure(
    panels: Scene | Panel | Sequence[Scene | Panel],
    out: str | Path | None = None,
    options: FigureOptions | None = None,
    progress: Progress = silent,
    tell: Callable[[str], None] = warnings.warn,
    **changes: Any,
) -> Figure:
    """Draw a figure of one or several scenes.

    Args:
        panels: What to show, in the order of reading; a scene is a panel seen from the front.
        out: A .pdf, .svg, .png or .tiff to write it to.
        options: How it is laid out.
        progress: Called while panels are rendered.
        tell: Called with a sentence on each panel that shows nothing.
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
    need_matplotlib()
    options = replace(options or FigureOptions(), **changes)
    _check(options)
    if out is not None:
        check_kind(out)
    listed = [panels] if not isinstance(panels, Sequence) else list(panels)
    every = [p if isinstance(p, Panel) else Panel(p) for p in listed]
    for panel in every:
        checked_line(panel.title, "The title of a panel", LONGEST_TITLE)
    if not 1 <= len(every) <= MOST_PANELS:
        raise BadInput(f"A figure has 1 to {MOST_PANELS} panels, not {len(every)}.")
    drawing = Drawing([_placed(panel, options) for panel in every], options, progress)
    if all(drawing.empty):
        raise BadInput(f"Nothing is visible in the figure, because {drawing.empty[0]}: {SHOW}.")
    for number, why in enumerate(drawing.empty):
        if why:
            tell(f"Panel {ascii_lowercase[number]} is empty, because {why}.")
    drawing.figure.set_label(". ".join(dict.fromkeys(in_words(p.scene, options.network) for p in every)))
    if out is not None:
        write_figure(drawing.figure, out, told_of(drawing.seen))
    progress(1.0, "figure")
    return drawing.figure


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
    if options.across is not None and options.across < 1:
        raise BadInput(f"A figure has at least one panel across, not {options.across}.")
    if len(options.behind) != 3 or not all(0.0 <= c <= 1.0 for c in options.behind):
        raise BadInput(f"{tuple(options.behind)} is no background: give red, green and blue between 0 and 1.")
    for what, text in (("unit", options.unit), ("unit of the values", options.value_unit)):
        checked_line(text or "", f"The {what}", LONGEST_UNIT)
    for number, title in enumerate(options.title):
        checked_line(title, f"Title {number}", LONGEST_TITLE)
    for name in axis_names(options.axes) or ():
        checked_line(name, "The name of an axis")


def axis_names(text: str | None) -> tuple[str, str, str] | None:
    """Return the names in 'x,y,z'; None for 'none' or None; raises BadInput for anything else."""
    if text is None or text.strip().lower() == "none":
        return None
    names = [name.strip() for name in text.split(",")]
    if len(names) != 3 or not all(0 < len(name) <= 8 for name in names):
        raise BadInput(f"--axes needs three short names, for example --axes x,y,z or R,A,S, or none, not '{text}'.")
    return names[0], names[1], names[2]


def _placed(panel: Panel, options: FigureOptions) -> Panel:
    """Return a panel with a camera and a network that it has."""
    network = network_of(panel.scene, options)
    camera = panel.camera if panel.camera is not None else orbit(panel.scene, 181, 800, 800)[90]
    if options.parallel:
        camera = parallel(camera, _middle(panel.scene))
    return replace(panel, camera=camera, look=(id(panel.scene), network) if panel.look is None else panel.look)


def network_of(scene: Scene, options: FigureOptions) -> str:
    """Return the network that a panel shows; raises BadInput if the scene does not have it."""
    network = options.network or scene.networks[-1]
    if network not in scene.networks:
        raise BadInput(f"The scene has no network '{network}', only {', '.join(scene.networks)}.")
    return network


def _middle(scene: Scene) -> NDArray[np.float64]:
    return np.asarray(scene.occupancy.box.bounds, np.float64).mean(0)


class Drawing:
    """A figure while it is drawn."""

    def __init__(self, panels: Sequence[Panel], options: FigureOptions, progress: Progress) -> None:
        from matplotlib.figure import Figure

        from svv.render.figures.layout import laid_out

        self.panels, self.options = panels, options
        self.alphas = [self._preview(panel) for panel in panels]
        self.windows = windows_of(self.alphas, options.frame == "content")
        heads, names = self._heads(), axis_names(options.axes) or ()
        legends = self._legends(part(progress, 0.0, 0.4))
        units = [unit for unit in (options.unit,) if unit]
        entries = [entry for legend in legends for entry in legend]
        texts = [*(f"{letter}{title}" for letter, title in heads), *names, *units]
        texts += [text for entry in entries for text in (entry.name, entry.values)]
        self.lettering = self._lettering(texts)
        self.strip = 0.0
        """Height in mm of the empty strip below the pictures, for annotations that find no empty corner."""
        head, aspect = any(map(any, heads)), self.windows[0].aspect
        self.layout = laid_out(options, self.lettering, aspect, legends, head, len(panels))
        self.strip = self._missing(self.layout.panels[0])
        if self.strip:
            aspect += self.strip / self.layout.panels[0].width
            self.layout = laid_out(options, self.lettering, aspect, legends, head, len(panels))
        self.size = self._size(self.layout)
        self.figure = Figure(figsize=(self.size[0] / options.dpi, self.size[1] / options.dpi), dpi=options.dpi)
        self.figure.patch.set_facecolor(to_hex(options.behind))
        self.figure.patch.set_alpha(0.0 if options.transparent else 1.0)
        self.seen: list[list[Seen]] = []
        self.empty: list[str] = []
        """Why each panel shows nothing; '' if it shows something."""
        for number, box in enumerate(self.layout.panels):
            each = part(progress, 0.4 + 0.6 * number / len(panels), 0.4 + 0.6 * (number + 1) / len(panels))
            self._draw_panel(number, box, each)
            self._draw_head(box, *heads[number])
        for line in self.layout.legend:
            self._draw_line(line)

    def _lettering(self, texts: Iterable[str]) -> Lettering:
        from svv.render.figures.lettering import Lettering, families_for

        luminance = float(np.dot(self.options.behind, (0.299, 0.587, 0.114)))
        ink = "#000000" if luminance > 0.45 else "#ffffff"
        return Lettering(families_for(texts, self.options.font), self.options.points, ink)

    def _preview(self, panel: Panel) -> NDArray[np.float32]:
        assert panel.camera is not None
        network = network_of(panel.scene, self.options)
        plain = "pcn" if network == "styled" else network  # paint changes no mean opacity
        return panel.scene.while_moving().render(preview_camera(panel.camera), plain).rgba[..., 3]

    def _heads(self) -> list[tuple[str, str]]:
        """Return the letter and the title above each panel."""
        kind, count = self.options.letters, len(self.panels)
        kind = ("a" if count > 1 else "none") if kind == "auto" else kind
        alphabet = ascii_uppercase if kind == "A" else ascii_lowercase
        letters = [f"({c})" if kind == "(a)" else "" if kind == "none" else c for c in alphabet[:count]]
        titles = [*self.options.title, *("",) * count]
        if len(self.options.title) > count:
            raise BadInput(f"There are {len(self.options.title)} titles for {count} panels: give one for each.")
        return [(letter, panel.title or title) for letter, panel, title in zip(letters, self.panels, titles)]

    def _legends(self, progress: Progress) -> list[list[Entry]]:
        """Return the legend of all panels if they look alike, otherwise one for each; none where none is asked for."""
        if self.options.legend == "none":
            return [[]]
        alike = len({panel.look for panel in self.panels}) == 1
        found = []
        for number, panel in enumerate(self.panels[:1] if alike else self.panels):
            progress(number / len(self.panels), "legend")
            found.append(self._entries(panel, self.windows[number]))
        return found

    def _entries(self, panel: Panel, window: Window) -> list[Entry]:
        from svv.render.figures.layout import columns_for, swatch_diameter
        from svv.render.figures.lettering import Lettering

        network = network_of(panel.scene, self.options)
        if network == "base" or panel.scene.palette_network is None:
            return []
        assert panel.camera is not None
        camera = camera_through(panel.camera, window, SWATCH_VIEW, max(1, round(SWATCH_VIEW * window.aspect)))
        diameter = swatch_diameter(Lettering((), self.options.points, ""))
        panel_mm = self.options.mm / columns_for(len(self.panels), self.options.across)
        size = max(4, round(diameter / 25.4 * self.options.dpi))
        return entries_of(
            panel.scene, camera, network, size, diameter * SWATCH_VIEW / panel_mm, self.options.value_unit
        )

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
        assert panel.camera is not None
        left, top = self._pixels(box.left), self._pixels(box.top)
        width, height = self._pixels(box.width), self._pixels(box.height - self.strip)
        camera = camera_through(panel.camera, window, width, height)
        samples = 1 if self.options.dpi >= FINE_DPI else None
        network = network_of(panel.scene, self.options)
        rendering = supersampled(panel.scene, camera, network, None, progress, samples)
        self._picture(left, top, rendering.rgba)
        self.empty.append(why_empty(panel.scene, rendering.depth))
        seen = seen_of(panel.scene, [rendering], self.options.behind) if panel.scene.regions else {}
        self.seen.append(list(seen.values()))
        axes = self._axes(left, top, width, self._pixels(box.height))
        axes.set_xlim(0.0, box.width)
        axes.set_ylim(0.0, box.height)
        corners = self._corners(number, box, self.strip)
        assert corners is not None  # the strip has room for all
        for (size, draw), corner in zip(self._notes(number, box), corners, strict=True):
            x = box.width - size[0] if "right" in corner else 0.0
            draw(axes, (x, box.height - size[1] if "upper" in corner else 0.0))

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
        assert panel.camera is not None
        if names is not None:
            draw = partial(notes.draw_axes, lettering=self.lettering, names=names, camera=panel.camera)
            found.append((notes.axes_size(self.lettering, panel.camera), draw))
        if self.options.scale_bar:
            across = max(1, self._pixels(box.width))
            camera = camera_through(panel.camera, window, across, max(1, round(across * window.aspect)))
            length, mm = notes.bar_of(camera, _middle(panel.scene), box.width)
            text = notes.length_said(length, self.options.unit)
            bar = partial(notes.draw_bar, lettering=self.lettering, text=text, length=mm)
            found.append((notes.bar_size(self.lettering, text, mm), bar))
        return found

    def _draw_head(self, box: Box, letter: str, title: str) -> None:
        """Write the letter and the title of a panel above it."""
        y = box.top - 0.8 - 0.25 * self.lettering.line
        indent = self.lettering.width(f"{letter}  ", bold=True) if letter else 0.0
        self._text(box.left, y, letter, bold=True)
        lines = self.lettering.wrapped(title, box.width - indent)
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

        diameter, box = swatch_diameter(self.lettering), line.box
        top = box.top + 0.5 * (box.height - diameter)
        self._picture(self._pixels(box.left), self._pixels(top), line.entry.swatch)
        words = [*line.name, *line.values]
        first = box.top + 0.5 * (box.height - len(words) * self.lettering.line)
        for k, word in enumerate(words):
            y = first + (k + 0.76) * self.lettering.line
            self._text(box.left + diameter + BESIDE, y, word)
