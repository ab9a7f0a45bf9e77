"""The screenshots of the first tutorial, taken from ParaView's own window while following its steps.

Run ``.venv/bin/python -m docs.screenshots`` in a checkout where ``make test`` has installed ParaView, Xvfb and xdotool.
It writes ``docs/images/first-*.jpg`` and takes about five minutes on two CPU cores, mostly for training.
"""

from __future__ import annotations

import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from PIL import Image

from svv.job.demo import generate
from svv.pv.launch import programs
from tests.paraview.conftest import GUI_MAIN, Gui

IMAGES = Path(__file__).resolve().parent / "images"

QUALITY = 82
"""Quality of the JPEG files: text stays sharp, and a window of 1280 x 1024 pixels stays below 150 kB."""

FILTERS, STYLIZED_VIEW, CHOOSE_PRESET, CLOSE = (215, 10), (557, 611), (234, 828), (1032, 724)
"""Positions to click in ParaView 5.11, in pixels: the menu, its item, the preset button, and Close in its dialog."""

DIALOG = (139, 197, 1123, 748)
"""The box of the preset dialog in pixels: left, upper, right, lower."""

LISTENER = """
import os
from paraview.simple import *

def tick(*_):
    # Does what the driver has written, and says what came of it.
    if os.path.exists("todo.py"):
        with open("todo.py") as file:
            code = file.read()
        os.remove("todo.py")
        try:
            exec(code, globals())
            done(globals().pop("answer", "done"))
        except Exception:
            import traceback
            done(traceback.format_exc())

LoadPalette("WhiteBackground")
view = GetActiveViewOrCreate("RenderView")
Render(view)
interactor = view.GetInteractor()
interactor.AddObserver("TimerEvent", tick)
timer = interactor.CreateRepeatingTimer(200)
done("ready")
"""

OPEN = """
reader = OpenDataFile(os.path.abspath("volume.vti"))
RenameSource("volume.vti", reader)
display = Show(reader, view)
ResetCamera(view)
view.GetActiveCamera().Azimuth(30)
view.GetActiveCamera().Elevation(15)
SetActiveSource(reader)
Render(view)
"""

VOLUME = """
display.SetRepresentationType("Volume")
ColorBy(display, ("POINTS", "wave"))
display.SetScalarBarVisibility(view, False)
display.Shade = 1
Render(view)
"""

IMPORT = """
ImportPresets(os.path.abspath("tf.json"))
"""

PRESET = """
GetColorTransferFunction("wave").ApplyPreset("demo", True)
GetOpacityTransferFunction("wave").ApplyPreset("demo", True)
Render(view)
"""

STYLE = """
painting = FindSource("StyleRFStylizedView1")
painting.StyleFiles = [os.path.abspath("oil.png")]
SetActiveSource(painting)
"""

TOLD = "(painting.UpdatePropertyInformation() or str(painting.Status))"
LEARNED = f"not {TOLD}.startswith(('Learning', 'Paused'))"
SHARP = f"len(GetRenderViews()) == 2 and max(painting.ImageSize) == 800 and 'sharper' not in {TOLD}"
"""That the view shows the image at its full size, and no enlarged one until that is drawn."""


class Window:
    """ParaView's window, in which Python code stands in for some of the reader's clicks."""

    def __init__(self, gui: Gui, folder: Path) -> None:
        self.gui, self.folder = gui, folder

    def do(self, code: str, timeout: float = 300.0) -> str:
        """Run Python code in the window's process, and return ``answer`` if the code sets it."""
        partial = self.folder / "todo.partial"
        partial.write_text(code)
        partial.rename(self.folder / "todo.py")
        return self.gui.wait(timeout)

    def until(self, condition: str, timeout: float = 1500.0) -> None:
        """Wait until a condition on the window's variables holds."""
        end = time.monotonic() + timeout
        while self.do(f"answer = str(bool({condition}))", timeout) != "True":
            assert time.monotonic() < end, f"{condition} did not come true\n{self.gui.log()}"
            time.sleep(1.0)

    def keep(self, name: str, box: tuple[int, int, int, int] = (0, 0, 1280, 1024)) -> None:
        """Save a screenshot of the window, or of a part of it, among the documentation's images."""
        shown = Image.open(self.gui.screenshot(self.folder / "shown.png")).convert("RGB").crop(box)
        shown.save(IMAGES / f"first-{name}.jpg", quality=QUALITY, optimize=True, progressive=True)


@contextmanager
def window(folder: Path) -> Iterator[Window]:
    """Start ParaView with the plugin on a display in memory, with separate settings and cache."""
    (folder / "listener.py").write_text(LISTENER)
    main = folder / "main.py"
    main.write_text(GUI_MAIN.format(source=str(folder / "listener.py")))
    paraview = programs.find()
    server, display = programs.start_display()
    environ = {
        **programs.environ_for(paraview),
        "DISPLAY": display,
        "GUI_MARKER": str(folder / "marker"),
        "SVV_CACHE": str(folder / "cache"),
        "XDG_CONFIG_HOME": str(folder),
        "XDG_RUNTIME_DIR": str(folder),
    }
    with (folder / "gui.log").open("w") as log:
        command = [str(paraview.program("paraview")), "--dr", f"--script={main}"]
        process = subprocess.Popen(command, env=environ, cwd=folder, stdout=log, stderr=log, text=True)
    try:
        gui = Gui(process, environ, folder)
        gui.wait()
        gui.fill_screen()
        gui.screenshot(folder / "start.png")  # a click after this finds the window where it stays
        yield Window(gui, folder)
    finally:
        for one in (process, server):
            one.terminate()
            one.wait(30)


def take(window: Window) -> None:
    """Follow the tutorial, and save a picture of every step."""
    xdotool = window.gui.xdotool
    window.do(OPEN)
    window.keep("opened")
    window.do(VOLUME)
    window.do(IMPORT)
    xdotool("mousemove", *CHOOSE_PRESET, "sleep", "1", "click", 1)
    time.sleep(15.0)  # the dialog draws every preset
    window.keep("preset", DIALOG)
    xdotool("mousemove", *CLOSE, "sleep", "1", "click", 1, "sleep", "5")
    window.do(PRESET)
    window.keep("volume")
    xdotool("mousemove", *FILTERS, "sleep", "1", "click", 1, "sleep", "4", "key", "Up", "sleep", "2", "key", "Up")
    xdotool("sleep", "2", "key", "Right", "sleep", "3", "mousemove", *STYLIZED_VIEW, "sleep", "2")
    window.keep("menu", (0, 0, 1024, 819))
    xdotool("click", 1, "sleep", "5")
    window.do(STYLE)
    window.keep("settings")
    xdotool("key", "alt+a")
    window.until("painting.GetDataInformation().GetNumberOfPoints() > 0")
    window.until(LEARNED)
    window.until(SHARP)
    time.sleep(5.0)
    window.keep("painted")
    xdotool(
        "mousemove", 500, 560, "mousedown", 1, "mousemove", 560, 570, "sleep", "1", "mousemove", 640, 590, "mouseup", 1
    )
    time.sleep(3.0)  # the small picture of the moving scene comes first
    window.until(SHARP)
    time.sleep(5.0)
    window.keep("turned")


def main() -> None:
    """Generate the demo's input, start ParaView in its folder, and take the pictures."""
    with tempfile.TemporaryDirectory(prefix="svv-") as made:
        folder = Path(made) / "demo"
        folder.mkdir(mode=0o700)
        generate(folder)
        with window(folder) as shown:
            take(shown)


if __name__ == "__main__":
    main()
