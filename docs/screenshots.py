"""The screenshots of the first tutorial, taken from ParaView's own window while following its steps word by word.

Run ``.venv/bin/python -m docs.screenshots`` in a checkout where ``make test`` has installed ParaView, Xvfb and xdotool.
It writes ``docs/images/first-*.jpg`` and takes about five minutes on two CPU cores, mostly for training.
"""

from __future__ import annotations

import re
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from PIL import Image

from svv.job.demo import generate
from svv.pv.launch import programs
from tests.paraview.conftest import GUI_MAIN, Gui, read_aloud
from tests.paraview.screen import BUTTON, Screen

PAGE = Path(__file__).resolve().parent / "tutorials" / "paraview.md"
IMAGES = PAGE.parents[1] / "images"

QUALITY = 82
"""Quality of the JPEG files: text stays sharp, and a window of 1280 x 1024 pixels stays below 150 kB."""

STYLIZED_VIEW = "StyleRFStylizedView1"
"""What ParaView calls the filter."""

HEART = "Choose preset|Select a color map from default presets"
"""Tooltips of the icon with a heart, in ParaView 5.11 and later."""

WHOLE, DIALOG, MENU = (0, 0, 1280, 1024), (139, 197, 1123, 748), (0, 0, 1024, 819)
KEPT = {"opened": WHOLE, "preset": DIALOG, "volume": WHOLE, "menu": MENU, "settings": WHOLE, "painted": WHOLE,
        "turned": WHOLE, "hidden": WHOLE}  # fmt: skip
"""The steps whose pictures the page shows, each with the part of ParaView 5.11's window: left, upper, right, lower."""

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

SEEN = """
view.GetActiveCamera().Azimuth(30)
view.GetActiveCamera().Elevation(15)
Render(view)
"""
"""A better side than the one from which ParaView shows data at first."""

PAINTING = """
painting = FindSource("StyleRFStylizedView1")
"""

TOLD = "(painting.UpdatePropertyInformation() or str(painting.Status))"
LEARNED = f"not {TOLD}.startswith(('Learning', 'Paused'))"
SHARP = f"len(GetRenderViews()) == 2 and max(painting.ImageSize) == 800 and 'sharper' not in {TOLD}"
"""That the view shows the image at its full size, and no enlarged one until that is drawn."""


class Page:
    """A page's words, which a script uses one after the other: what is not on the page, or not used, is an error.

    Args:
        text: The page in Markdown. Words on the screen are in italics there, files in code.
    """

    def __init__(self, text: str) -> None:
        parts = re.split(r"^## ", re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE), flags=re.MULTILINE)
        self.sections = {part.partition("\n")[0]: part for part in parts[1:]}
        self.text = ""
        self.left: set[str] = set()

    def turn_to(self, title: str) -> None:
        """Go on to a section, when all words of the one before have been used."""
        self.end()
        self.text = self.sections.pop(title)
        marked = re.findall(r"(?<![*`])(?:\*([^*`]+)\*|`([^`]+)`)(?![*`])", re.sub(r"\]\([^)]*\)", "", self.text))
        self.left = {" ".join((words or code).split()) for words, code in marked}

    def end(self) -> None:
        """Check that all words of the section have been used."""
        assert not self.left, f"nobody follows {sorted(self.left)} of the page"

    def says(self, words: str) -> str:
        """Return words of the section that are in italics or code, or part of its text."""
        assert words in self.left or words in " ".join(self.text.split()), f"the page does not say {words!r}"
        self.left.discard(words)
        return words

    def path(self, words: str) -> list[str]:
        """Return the entries of menus that lead to one."""
        return self.says(words).split(" > ")


class Window:
    """ParaView's window, in which Python code stands in for some of the reader's clicks."""

    def __init__(self, gui: Gui, folder: Path) -> None:
        self.gui, self.folder, self.screen = gui, folder, Screen(gui)

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

    def keep(self, name: str, box: tuple[int, int, int, int]) -> None:
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
    with ExitStack() as stack:
        stack.callback(end, server)
        environ = {
            **programs.environ_for(paraview),
            **stack.enter_context(read_aloud(folder)),
            "DISPLAY": display,
            "GUI_MARKER": str(folder / "marker"),
            "SVV_CACHE": str(folder / "cache"),
            "XDG_CONFIG_HOME": str(folder),
            "XDG_RUNTIME_DIR": str(folder),
        }
        log = stack.enter_context((folder / "gui.log").open("w"))
        command = [str(paraview.program("paraview")), "--dr", f"--script={main}"]
        process = subprocess.Popen(command, env=environ, cwd=folder, stdout=log, stderr=log, text=True)
        stack.callback(end, process)
        gui = Gui(process, environ, folder)
        gui.wait()
        gui.fill_screen()
        gui.screenshot(folder / "start.png")  # a click after this finds the window where it stays
        yield Window(gui, folder)


def end(process: subprocess.Popen[bytes] | subprocess.Popen[str]) -> None:
    """End a process, and wait for it."""
    process.terminate()
    process.wait(30)


def follow(window: Window, page: Page, hurry: str = "") -> Iterator[str]:  # long: steps of the page, in its order
    """Do what the tutorial says, by the words of its page, and yield the name of each step when it has been done.

    Args:
        window: ParaView's window; the tutorial's folder ``first`` is in the window's folder.
        page: The page.
        hurry: Python code that makes the filter ``painting`` quicker than the reader's.
    """
    screen, says, folder = window.screen, page.says, window.folder

    page.turn_to("2. Open the volume")
    screen.choose(*page.path("File > Open"))
    screen.choose_file("Open File", folder / says("first/volume.vti"))
    screen.press(says("Apply"), within=says("Properties"))
    window.do(SEEN)
    yield "opened"

    page.turn_to("3. Colour it")
    says("Properties")
    screen.set_to(says("Representation"), says("Volume"))
    screen.press(says("Yes"))
    screen.set_to(says("Coloring"), says("wave"))
    screen.tick(says("Shade"))
    screen.click(screen.in_panel(HEART, *BUTTON))
    screen.press(says("Import"), within=says("Choose Preset"))
    screen.choose_file("Import Presets", folder / says("first/tf.json"))
    screen.focus("^Choose Preset")
    screen.find(says("demo"), "cell", "table cell", within="Choose Preset")
    for words in ("Opacities", "Use preset range"):
        screen.tick(says(words), within="Choose Preset")
    yield "preset"
    for words in ("Apply", "Close"):
        screen.press(says(words), within="Choose Preset")
    yield "volume"

    page.turn_to("4. Add the filter")
    says("Pipeline Browser")
    screen.select(says("volume.vti"))
    stylized_view = screen.menu(*page.path("Filters > StyleRF > StyleRF Stylized View"))
    yield "menu"
    screen.click(stylized_view)
    window.until(f"FindSource({STYLIZED_VIEW!r}) is not None")
    window.do(PAINTING)

    page.turn_to("5. Choose a style")
    label = screen.in_panel(says("Style Files"), "label")
    screen.click(screen.beside(label, *BUTTON))
    screen.choose_file("Style Files", folder / says("first/oil.png"))
    assert screen.beside(screen.in_panel(says("Preset"), "label"), "combo box").name.startswith(says("fast"))
    assert screen.in_panel(says("Follow Camera"), "check box").checked
    says("Properties")
    yield "settings"
    window.do(hurry)
    stop, go_on = (screen.in_panel(says(words), *BUTTON) for words in ("Stop Here", "Go On"))
    screen.press(says("Apply"), within="Properties")
    yield "applied"
    assert stop.enabled and go_on.enabled
    assert screen.in_panel(says("Status"), "label")

    page.turn_to("6. Look at the painting")
    window.until("painting.GetDataInformation().GetNumberOfPoints() > 0")
    window.until(LEARNED)
    window.until(SHARP)
    yield "painted"

    page.turn_to("7. Turn it")
    screen.drag((500, 560), (560, 570), (640, 590))
    time.sleep(3.0)  # the small picture of the moving scene comes first
    window.until(SHARP)
    yield "turned"

    page.turn_to("8. Hide a region")
    says("Pipeline Browser")
    screen.select(says(STYLIZED_VIEW))
    screen.tick(says("Region 0 Hide"))
    screen.press(says("Apply"), within=says("Properties"))
    window.until(SHARP)
    yield "hidden"
    screen.tick("Region 0 Hide", False)
    screen.tick(says("Region 1 Hide"))
    screen.press("Apply", within="Properties")
    window.until(SHARP)
    yield "other hidden"
    screen.tick("Region 1 Hide", False)
    screen.gear()
    screen.set_to(says("Show"), says("numbered regions"))
    screen.press("Apply", within="Properties")
    window.until(SHARP)
    yield "numbered"
    for words in ("Opacity", "Recolour", "Name", "Lighting"):
        assert screen.in_panel(f"Region 0 {says(words)}")
    screen.set_to("Show", says("image"))
    screen.gear()
    screen.tick("Region 0 Hide")

    page.turn_to("9. Keep it")
    screen.click(screen.beside(screen.in_panel(says("Save File"), "label"), *BUTTON))
    screen.choose_file("Save File", folder / says("first/painted.svv"))
    screen.press(says("Apply"), within="Properties")
    screen.click(screen.in_panel(says("Save Scene"), *BUTTON))
    window.until(f"{TOLD}.startswith('Saved')")
    for command in ("svv render", "svv figure"):
        says(command)
    yield "saved"
    screen.choose(*page.path("File > Save State"))
    screen.choose_file("Save State", folder / "first" / "painted.pvsm")
    yield "state"


def main() -> None:
    """Generate the demo's input, start ParaView in its folder, and take the pictures."""
    with tempfile.TemporaryDirectory(prefix="svv-") as made:
        folder = Path(made) / "demo"
        (folder / "first").mkdir(mode=0o700, parents=True)
        folder.chmod(0o700)
        generate(folder / "first")
        page = Page(PAGE.read_text())
        with window(folder) as shown:
            for step in follow(shown, page):
                if step in KEPT:
                    time.sleep(5.0)
                    shown.keep(step, KEPT[step])


if __name__ == "__main__":
    main()
