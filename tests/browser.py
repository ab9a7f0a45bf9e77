"""Scenes' pages in a real browser without a window, driven by playwright."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from svv.core.colour.colour import over
from svv.core.geometry.cameras import Camera
from svv.fields.scene.scene import Scene

NAMES = ("chromium", "chromium-browser", "google-chrome")
"""Programs that are Chromium."""

SOFTWARE = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
"""Options with which WebGL2 runs on the CPU, on any machine."""

PATIENCE = 600.0
"""Seconds after which something hangs; a busy machine draws in software, and playwright by itself waits for 30 s."""

LARGEST = (
    "const gl = WebGL2RenderingContext.prototype, real = gl.getParameter; gl.getParameter = function (name) "
    "{ return name === gl.MAX_3D_TEXTURE_SIZE ? %d : real.call(this, name); }"
)
"""JavaScript with which graphics hold no more points a side."""


def program() -> str | None:
    """Path of a Chromium; None where there is none."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


@contextmanager
def browser() -> Iterator[Any]:
    """Start Chromium."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as started:
        running = started.chromium.launch(executable_path=program(), args=list(SOFTWARE), timeout=1000.0 * PATIENCE)
        yield running
        running.close()


@dataclass
class Opened:
    """A page in a browser, and what went wrong in it."""

    page: Any
    wrong: list[str] = field(default_factory=list)
    """Errors, warnings and dialogs."""
    asked: list[str] = field(default_factory=list)
    """Addresses that were requested."""

    @classmethod
    def at(cls, path: Path, context: Any, script: str = "") -> Opened:
        """Open a file in a new tab; ``script`` runs before those of the page."""
        opened = cls(context.new_page())
        page, wrong = opened.page, opened.wrong
        page.set_default_timeout(1000.0 * PATIENCE)
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("console", lambda said: wrong.append(said.text) if said.type in ("error", "warning") else None)
        page.on("dialog", opened.refuse)
        page.on("request", lambda request: opened.asked.append(request.url))
        if script:
            page.add_init_script(script)
        page.goto(path.resolve().as_uri())
        return opened

    def ready(self) -> None:
        """Wait until the page has read its scene."""
        self.page.locator("body.live").wait_for()

    def until(self, true: str) -> None:
        """Wait until a JavaScript expression is true.

        Playwright's ``wait_for_function`` asks again by ``eval``, which a scene's page forbids: it works only where the
        first answer is yes.
        """
        limit = time.monotonic() + PATIENCE
        while not self.page.evaluate(true):
            assert time.monotonic() < limit, f"{true} never was"
            self.page.wait_for_timeout(50.0)

    def refuse(self, dialog: Any) -> None:
        """Close a dialog, which is always wrong."""
        self.wrong.append(dialog.message)
        dialog.dismiss()

    def picture(self, camera: Camera) -> np.ndarray:
        """The browser's picture of a camera. (H, W, 3) in [0, 1]"""
        told = {name: getattr(camera, name) for name in ("fov_x", "span_x", "width", "height")}
        told["camera_to_world"] = camera.camera_to_world.ravel().tolist()
        data = self.page.evaluate("async (camera) => Array.from((await window.svv).picture(camera).data)", told)
        return np.array(data, np.float64).reshape(camera.height, camera.width, 4)[..., :3] / 255.0

    def psnr(self, scene: Scene, camera: Camera, network: str | None = None) -> float:
        """How close the browser's picture is to the renderer's, over white, in dB."""
        truth = over(scene.render(camera, network).rgba)
        return float(-10.0 * np.log10(np.square(self.picture(camera) - truth).mean()))
