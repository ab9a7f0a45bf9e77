"""A scene in a PyVista window whose picture is rendered by svv and follows the mouse."""

from __future__ import annotations

import base64
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from svv.core.colour.colour import WHITE, over
from svv.core.frame_rate import Pace
from svv.core.geometry.cameras import Camera
from svv.core.geometry.given_cameras import DEFAULT_SIZE, GivenCamera, Plotter, camera_of
from svv.errors import BadInput, Progress, silent
from svv.fields.scene.model import in_words
from svv.io.pictures.output import to_bytes, write_png
from svv.render.frames import orbit
from svv.render.pictures import Picture
from svv.render.supersampled import supersampled
from svv.render.web.html import filled
from svv.train.run.learning import Learning

if TYPE_CHECKING:
    import pyvista

    from svv.fields.scene.scene import Rendering, Scene
    from svv.render.web.notebook import SceneWidget

LOOK_EVERY = 250
"""Milliseconds between two looks at a training in the background."""

MOVING = 1.0
"""Lowest frame rate that VTK's interactors request while they move, in 1/s; at rest they request a ten-thousandth."""


def show(
    scene: Scene | Learning,
    *,
    camera: GivenCamera | None = None,
    network: str | None = None,
    background: Sequence[float] = WHITE,
    size: tuple[int, int] | None = None,
    off_screen: bool = False,
    screenshot: str | Path | None = None,
) -> Image.Image | None:
    """Show a scene in a window and turn it with the mouse; its picture is coarser while the mouse moves.

    In a notebook, the picture is shown below the cell instead, with the names of its regions as alternative text. A
    training in the background (``train_scene(..., background=True)``) is shown as it sharpens, with a bar of its
    progress: in a window that can be closed at any time, in a notebook until it is done. Interrupting either lets it go
    on.

    Args:
        scene: Scene to show, or a training in the background.
        camera: Initial camera: svv's, a plotter or its camera, a ``camera_position``, or the name of a side such as
            ``xy`` (:func:`svv.core.geometry.given_cameras.camera_of`); by default in front, at the distance of the
            training views.
        network: ``base``, ``pcn`` or ``styled``; by default the last one that the scene has.
        background: RGB in [0, 1].
        size: Width and height of the window or picture, in pixels; by default those of the plotter whose camera it is,
            or 800 x 800.
        off_screen: Whether to return the picture without opening a window.
        screenshot: A PNG file for the picture; from a window, the last one before it is closed.

    Returns:
        The picture, RGB, off-screen and in a notebook; otherwise None, once the window has been closed.

    Raises:
        BadInput: PyVista is missing, this is ParaView, there is no display, the scene does not have that network, the
            file cannot be written, the camera is none, or the training failed.
        Cancelled: The training was stopped before there was anything to show.

    >>> picture = svv.show(scene, size=(64, 48), off_screen=True)
    >>> picture.size
    (64, 48)
    """
    learning = scene if isinstance(scene, Learning) else None
    scene = first_scene_of(scene) if isinstance(scene, Learning) else scene
    size = size or (None if isinstance(camera, Plotter) else DEFAULT_SIZE)
    front = None if camera is not None else orbit(scene, 181, *(size or DEFAULT_SIZE))[90]
    first = front or camera_of(camera, scene, size)
    if not off_screen and _in_notebook():
        picture = _picture(scene, first, network, background)
        if learning is not None:
            picture, scene = _sharpened_below(
                learning, scene, picture, lambda newer: _picture(newer, first, network, background)
            )
    else:
        pyvista = need_pyvista()
        if not off_screen and not pyvista.system_supports_plotting():
            raise BadInput("There is no display for a window; give off_screen=True to get only the picture.")
        plotter = pyvista.Plotter(off_screen=off_screen, window_size=[first.width, first.height])
        follower = SceneFollower(plotter, scene, first, network, background)
        if learning is not None:
            follower.sharpen(learning)
        plotter.show(title=f"svv {network or scene.networks[-1]}")
        picture = follower.picture
    if screenshot is not None:
        write_png(screenshot, picture)
    return None if not off_screen and not _in_notebook() else _Shown.of(picture, in_words(scene, network))


class _Shown(Image.Image):
    """A picture with alternative text, which notebooks keep beside it, also when they are exported."""

    alt = ""

    @classmethod
    def of(cls, picture: Picture, alt: str) -> _Shown:
        """Return a picture (h, w, 3) with its text."""
        shown = cls()
        shown.__dict__.update(Image.fromarray(picture).__dict__, alt=alt)
        return shown

    def _repr_png_(self) -> Any:
        return super()._repr_png_(), {"alt": self.alt}

    def _repr_html_(self) -> str:
        """Return HTML, which is preferred: JupyterLab and most templates of nbconvert ignore the text of a PNG."""
        data = base64.b64encode(super()._repr_png_() or b"").decode()
        picture = '<img alt="{{ alt }}" style="max-width: 100%" src="data:image/png;base64,{{ data }}">'
        return filled(picture, alt=self.alt, data=data)

    def _repr_jpeg_(self) -> None:
        """Offer no JPEG, which would be a third copy."""


def widget(
    scene: Scene | Learning,
    *,
    title: str = "scene",
    height: int = 600,
    background: Sequence[float] = WHITE,
    progress: Progress = silent,
) -> SceneWidget:
    """Return a notebook's widget that shows a scene from all sides and edits it: the page for browsers.

    The widget's ``scene`` and ``camera`` are what the page shows. In a notebook that is exported, or opened where
    widgets are not shown, the page works all the same, but without Python. A training in the background is shown as it
    sharpens, below a bar of its progress; how it is turned stays.

    Args:
        scene: Scene to show, with its edits and paintings, or a training in the background.
        title: Heading of the page.
        height: Height in pixels, >= 100.
        background: RGB in [0, 1] behind the scene; can be changed in the page.
        progress: Called while the scene is prepared.

    Raises:
        BadInput: anywidget is missing, or the scene has no palette network.

    >>> svv.widget(scene, title="Two balls").scene.regions == scene.regions
    True
    """
    try:
        from svv.render.web.notebook import SceneWidget
    except ModuleNotFoundError as error:
        if error.name not in ("anywidget", "traitlets"):
            raise
        raise BadInput("This needs anywidget, which is not installed: pip install 'svv[notebook]'.") from error
    return SceneWidget(scene, title, height, background, progress)


def image_data(rendering: Rendering) -> pyvista.ImageData:
    """Convert an image of a scene to a ``pyvista.ImageData``, the ``vtkImageData`` that ``svv render`` writes as .vti.

    Returns:
        One slice with a spacing of 1 and row 0 at the bottom: point arrays ``RGBA`` uint8 (straight alpha, the active
        scalars), ``Depth`` float32 (world units, NaN where empty) and ``Region`` int16 (-1 where empty).

    Raises:
        BadInput: PyVista is missing, or this is ParaView.

    >>> data = svv.image_data(scene.render(svv.orbit(scene, 8, 64, 48)[0]))
    >>> data.dimensions, data.point_data.keys()
    ((64, 48, 1), ['RGBA', 'Depth', 'Region'])
    """
    height, width = rendering.depth.shape
    image = need_pyvista().ImageData(dimensions=(width, height, 1))
    arrays: dict[str, NDArray[np.generic]] = {
        "RGBA": to_bytes(rendering.rgba),
        "Depth": rendering.depth,
        "Region": rendering.region,
    }
    for name, array in arrays.items():
        image.point_data[name] = np.flipud(array).reshape(width * height, *array.shape[2:])
    image.set_active_scalars("RGBA")
    return image


class SceneFollower:
    """Updater of a plotter's background with renderings of a scene from the plotter's camera, at first at ``camera``.

    Pictures of a moving camera are made in a hurry, and are as large as time permits; at rest they are sharp. Meshes
    that are added to the plotter appear in front. The network is by default the last; the background is RGB in [0, 1].
    """

    def __init__(
        self, plotter: pyvista.Plotter, scene: Scene, camera: Camera, network: str | None, background: Sequence[float]
    ) -> None:
        self.plotter, self.scene, self.network, self.background = plotter, scene, network, background
        self.pace = Pace()
        """Size of the next picture while the mouse moves, as a fraction of the window's."""
        self.seen: tuple[Camera, bool] | None = None
        """Camera of the last picture, and whether it moved."""
        self.picture = np.zeros((1, 1, 3), np.uint8)
        self._texture: pyvista.Texture | None = None
        # An empty renderer has no bounds, which VTK needs to zoom and to reset the camera.
        low, high = scene.occupancy.box.bounds
        plotter.add_mesh(need_pyvista().Box(np.stack([low, high], 1).ravel()), opacity=0.0, pickable=False)
        self._place(camera)
        self.update()  # called here because VTK's observers cannot raise
        plotter.renderer.AddObserver("StartEvent", lambda *_: self.update())

    def update(self) -> None:
        """Render a picture for the current camera unless the last one is for the same camera."""
        moving = self.plotter.render_window.GetDesiredUpdateRate() >= MOVING
        camera = self.camera(self.pace.part if moving else 1.0)
        if self.seen is not None and self.seen[1] <= moving:
            one, other = camera, self.seen[0]
            if one.identity[1:] == other.identity[1:] and (one.camera_to_world == other.camera_to_world).all():
                return
        scene = self.scene.while_moving() if moving else self.scene
        began = time.perf_counter()
        self.picture, self.seen = _picture(scene, camera, self.network, self.background), (camera, moving)
        if moving:
            self.pace.took(time.perf_counter() - began)
        self._texture = need_pyvista().Texture(self.picture)
        self._texture.SetInterpolate(True)
        renderer = self.plotter.renderer
        renderer.SetBackgroundTexture(self._texture)
        renderer.TexturedBackgroundOn()

    def sharpen(self, learning: Learning) -> None:
        """Show the scenes of a training in the background as they come, and its progress."""
        shown = learning.number

        def look(_: int) -> None:
            nonlocal shown
            said = "" if learning.done else "{:.0%}: {}".format(*learning.progress)
            self.plotter.add_text(said, font_size=9, name="progress", render=False)
            if learning.number != shown and learning.scene is not None:
                shown, self.scene, self.seen = learning.number, learning.scene, None
            self.plotter.render()

        if not learning.done:
            self.plotter.add_timer_event(max_steps=10**9, duration=LOOK_EVERY, callback=look)

    def camera(self, part: float = 1.0) -> Camera:
        """Convert the plotter's camera, with an image ``part`` times the size of the window."""
        width, height = (max(1, round(part * pixels)) for pixels in self.plotter.render_window.GetSize())
        return camera_of(self.plotter.camera, self.scene, (width, height))

    def _place(self, camera: Camera) -> None:
        """Place the plotter's camera at a camera of a scene, to turn about the scene's middle."""
        seen, matrix = self.plotter.camera, camera.camera_to_world
        ahead = (self.scene.occupancy.box.bounds.mean(0) - camera.position) @ -matrix[:3, 2]
        seen.position = camera.position
        seen.focal_point = camera.position - matrix[:3, 2] * (ahead if ahead > 0 else 1.0)
        seen.up = matrix[:3, 1]
        seen.parallel_projection = camera.is_orthographic
        if camera.is_orthographic:
            seen.parallel_scale = 0.5 * camera.height / camera.focal
        else:
            seen.view_angle = np.degrees(2.0 * np.arctan(0.5 * camera.height / camera.focal))
        seen.is_set = True


def first_scene_of(learning: Learning) -> Scene:
    """Return the first scene of a training in the background, and show its progress until there is one.

    Raises BadInput if the training failed, and Cancelled if it was stopped.
    """
    with _bar(learning) as look:
        while learning.scene is None and not learning.done:
            look()
    return learning.wait()[0] if learning.scene is None else learning.scene


def _sharpened_below(
    learning: Learning, scene: Scene, picture: Picture, drawn: Callable[[Scene], Picture]
) -> tuple[Picture, Scene]:
    """Show a picture below a cell, and then newer ones until the training is done; return the last and its scene."""
    from IPython.display import display

    place, shown = display(_Shown.of(picture, in_words(scene)), display_id=True), learning.number
    with _bar(learning) as look:
        while not learning.done or learning.number != shown:
            look()
            if learning.number != shown and learning.scene is not None:
                shown, scene = learning.number, learning.scene
                picture = drawn(scene)
                place.update(_Shown.of(picture, in_words(scene)))
    return picture, scene


@contextmanager
def _bar(learning: Learning) -> Iterator[Callable[[], None]]:
    """Show a bar of a training's progress; what it gives waits a little, and updates it."""
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    label = TextColumn("{task.description}", markup=False)
    with Progress(BarColumn(), TaskProgressColumn(), TimeRemainingColumn(), label) as bars:
        task = bars.add_task("", total=1.0)

        def look() -> None:
            fraction, label = learning.progress
            bars.update(task, completed=fraction, description=label)
            time.sleep(0.001 * LOOK_EVERY)

        yield look


def _picture(scene: Scene, camera: Camera, network: str | None, background: Sequence[float]) -> Picture:
    """Render the scene over the background. (H, W, 3) uint8"""
    return to_bytes(over(supersampled(scene, camera, network).rgba, background))


def need_pyvista() -> ModuleType:
    """Return PyVista; raises BadInput where it is missing, and in ParaView."""
    if "paraview" in sys.modules:
        raise BadInput("In ParaView, open the scene's file or add the filter StyleRF Render to show the scene.")
    try:
        import pyvista
    except ImportError as error:
        raise BadInput("This needs PyVista, which is not installed: pip install 'svv[standalone]'.") from error
    return pyvista


def _in_notebook() -> bool:
    """Return whether this is IPython's kernel, whose results appear below the cell."""
    ipython = sys.modules.get("IPython")
    shell = None if ipython is None else ipython.get_ipython()
    return type(shell).__name__ == "ZMQInteractiveShell"
