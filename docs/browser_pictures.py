"""The documentation's pictures of scenes in a browser, from the results of ``make demo``.

``.venv/bin/python -m docs.browser_pictures demo`` in the checkout writes ``docs/images/web-viewer.jpg``: the page on a
desktop and on a phone. With ``--jupyter PROGRAM``, a ``jupyter`` in whose environment svv, PyVista and JupyterLab are
installed, it also writes ``docs/images/notebook.jpg``. It needs Chromium and playwright, and minutes, since WebGL2 runs
on the CPU.
"""

from __future__ import annotations

import argparse
import io
import json
import shutil
import socket
import subprocess
import tempfile
import time
import urllib.request
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from PIL import Image

from tests.browser import PATIENCE, Opened, browser

IMAGES = Path(__file__).resolve().parent / "images"

DESKTOP, PHONE, GAP = (1280, 800), (390, 800), 24
"""Sizes of the two windows in pixels, and the distance between them in the picture."""

NOTEBOOK = (1000, 1150)
"""Size of the notebook's window in pixels."""

CELLS = (
    'import pyvista\n\nscene = pyvista.read("scene.svv")\nwidget = scene.svv.widget(title="My scene", height=420)\n'
    "widget",
    'import traitlets\n\nother = scene.svv.recolour(0, "seagreen").svv.widget(title="In green", height=420)\n'
    'link = traitlets.link((widget, "view"), (other, "view"))\nother',
)


def shown(page: Any) -> Image.Image:
    """Return what a tab shows."""
    return Image.open(io.BytesIO(page.screenshot())).convert("RGB")


def page_picture(demo: Path) -> Image.Image:
    """Return the demo's page in a wide and in a narrow window."""
    found = []
    with browser() as running:
        for width, height in (DESKTOP, PHONE):
            context = running.new_context(viewport={"width": width, "height": height})
            opened = Opened.at(demo / "scene.html", context)
            opened.ready()
            opened.page.wait_for_timeout(20_000)  # the still picture is drawn after the moving one
            found.append(shown(opened.page))
            context.close()
    wide = Image.new("RGB", (DESKTOP[0] + GAP + PHONE[0], DESKTOP[1]), (216, 222, 230))
    wide.paste(found[0], (0, 0))
    wide.paste(found[1], (DESKTOP[0] + GAP, 0))
    return wide


@contextmanager
def served(jupyter: str, folder: Path) -> Iterator[str]:
    """Serve a folder by JupyterLab, and give its address."""
    with socket.socket() as free:
        free.bind(("localhost", 0))
        port = free.getsockname()[1]
    options = [
        f"--port={port}",
        "--no-browser",
        "--IdentityProvider.token=",
        f"--notebook-dir={folder}",
        "--allow-root",
    ]
    with (folder / "jupyter.log").open("w") as log:
        process = subprocess.Popen([jupyter, "lab", *options], stdout=log, stderr=log, cwd=folder)
        address = f"http://localhost:{port}"
        try:
            end = time.monotonic() + PATIENCE
            while time.monotonic() < end:
                with suppress(OSError), urllib.request.urlopen(f"{address}/api"):
                    break
                time.sleep(1.0)
            yield address
        finally:
            process.terminate()
            process.wait()


def notebook_picture(demo: Path, jupyter: str) -> Image.Image:
    """Return two linked widgets in JupyterLab."""
    cells = [
        {"cell_type": "code", "id": f"c{k}", "metadata": {}, "execution_count": None, "outputs": [], "source": text}
        for k, text in enumerate(CELLS)
    ]
    kernel = {"kernelspec": {"name": "python3", "display_name": "Python 3"}}
    book = {"cells": cells, "metadata": kernel, "nbformat": 4, "nbformat_minor": 5}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copy(demo / "scene.svv", folder)
        (folder / "scene.ipynb").write_text(json.dumps(book))
        with served(jupyter, folder) as address, browser() as running:
            page = running.new_page(viewport={"width": NOTEBOOK[0], "height": NOTEBOOK[1]})
            page.set_default_timeout(1000.0 * PATIENCE)
            page.goto(f"{address}/doc/tree/scene.ipynb")
            page.locator(".jp-Notebook .jp-CodeCell").first.click()
            page.keyboard.press("Shift+Enter")
            page.keyboard.press("Shift+Enter")
            for number in range(len(CELLS)):
                page.frame_locator("iframe").nth(number).locator("body.live").wait_for()
            page.wait_for_timeout(30_000)
            if (offer := page.get_by_role("button", name="No", exact=True)).count():  # of Jupyter's news
                offer.click()
                page.wait_for_timeout(2_000)  # it fades
            page.locator(".jp-Notebook").evaluate("element => element.scrollTo(0, 0)")
            return shown(page)


def main(words: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("demo", type=Path, help="folder of make demo's results")
    parser.add_argument("--jupyter", help="a jupyter program that has JupyterLab, svv and PyVista")
    asked = parser.parse_args(words)
    pictures = {"web-viewer": page_picture(asked.demo)}
    if asked.jupyter:
        pictures["notebook"] = notebook_picture(asked.demo, asked.jupyter)
    for name, picture in pictures.items():
        picture.save(IMAGES / f"{name}.jpg", quality=84, optimize=True, progressive=True)


if __name__ == "__main__":
    main()
