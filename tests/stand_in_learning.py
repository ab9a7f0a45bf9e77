"""A training in the background that does as a test says."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from svv.errors import BadInput
from svv.fields.scene.scene import Scene
from svv.render.web.page import html_of
from svv.train.run.learning import Learning


class StandIn(Learning):
    """Gives the scenes that it is given, one for each call of ``step``; the last one is the result."""

    def __init__(self, *scenes: Scene, error: str = "") -> None:
        self._scenes, self._at, self._sentence = scenes, 0, error
        self.heard: list[Callable[[Learning], None]] = []

    def step(self) -> None:
        """Go on to the next scene, and tell whoever watches."""
        self._at += 1
        for call in self.heard:
            call(self)

    @property
    def progress(self) -> tuple[float, str]:
        """How many of the scenes there have been."""
        return self._at / len(self._scenes), "done" if self.done else f"scene {self._at}"

    @property
    def number(self) -> int:
        """Number of the newest scene."""
        return min(self._at, len(self._scenes))

    @property
    def scene(self) -> Scene | None:
        """The newest scene."""
        return self._scenes[self.number - 1] if self.number else None

    @property
    def done(self) -> bool:
        """Whether that was the last one, or it fails."""
        return self._at >= len(self._scenes) or (bool(self._sentence) and self._at > 0)

    def wait(self, timeout: float | None = None, progress: Any = None) -> tuple[Scene, Any]:
        """Return the result, or fail."""
        if self._sentence:
            raise BadInput(self._sentence)
        return self._scenes[-1], {}

    def watch(self, call: Callable[[Learning], None]) -> Any:
        """Call a function at every step."""
        self.heard.append(call)

    def page(self, title: str, background: Sequence[float]) -> tuple[int, str] | None:
        """Return the page of the newest scene."""
        scene = self.scene
        return None if scene is None else (self.number, html_of(scene, title, title, background).decode())
