"""A page for browsers that follows a scene's file: it shows the newest scene in it, and keeps how that is turned.

The server answers on this machine only. The page asks it once a second for the number of the newest scene.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from svv.errors import BadInput
from svv.fields.scene.scene import Scene
from svv.io.scene_file import sketch_of
from svv.render.web.html import filled, viewer_file
from svv.render.web.page import html_of

LOCAL = "127.0.0.1"
"""The address at which the server answers."""

WAITING = "Waiting for {file}: start `svv train ... --out {file} --sketch` in a terminal."
SKETCH, FINISHED = "A sketch of {file}, which is being learned.", "{file}"


class Follower:
    """Serves the page of the newest scene of a file; ``look`` makes it, and ``close`` ends the server.

    The file need not exist yet; before it does, sketches beside it are shown. The port is 0 for any that is free.
    Raises BadInput if it is in use.
    """

    def __init__(self, file: Path, port: int = 0) -> None:
        self.file = file
        self._seen: int | None = None
        self._page = b""
        self._number, self._said = 0, WAITING.format(file=file.name)
        try:
            self._server = ThreadingHTTPServer((LOCAL, port), _handler(self.answer))
        except OSError as error:
            raise BadInput(f"The port {port} cannot be used ({error.strerror}): give another one.") from error
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    @property
    def address(self) -> str:
        """The page's address."""
        return f"http://{LOCAL}:{self._server.server_address[1]}/"

    def look(self) -> bool:
        """Make the page anew if there is a newer scene; return whether there is."""
        there = {}
        for file, said in ((self.file, FINISHED), (sketch_of(self.file), SKETCH)):
            with suppress(FileNotFoundError):
                there[file.stat().st_mtime_ns] = file, said
        seen = max(there, default=None)
        if seen is None or seen == self._seen:
            return False
        self._seen, (file, said) = seen, there[seen]
        try:
            page = html_of(Scene.load(file), self.file.stem, self.file.stem)
        except BadInput as error:  # a sketch may just have given way to the scene
            self._said = str(error)
            return False
        self._page, self._said = page, said.format(file=self.file.name)
        self._number += 1
        return True

    def answer(self, path: str) -> tuple[str, bytes] | None:
        """Return type and content of what a browser asks for; None if there is no such thing."""
        if path == "/":
            return "text/html", filled(viewer_file("following.html"), title=self.file.stem).encode()
        if path == "/state":
            return "application/json", json.dumps({"number": self._number, "said": self._said}).encode()
        return ("text/html", self._page) if path.split("?")[0] == "/scene" and self._page else None

    def close(self) -> None:
        """End the server."""
        self._server.shutdown()
        self._server.server_close()


def _handler(answer: Callable[[str], tuple[str, bytes] | None]) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            """Answer a browser."""
            found = answer(self.path)
            if found is None:
                self.send_error(404)
                return
            kind, content = found
            self.send_response(200)
            self.send_header("Content-Type", f"{kind}; charset=utf-8")
            self.send_header("Content-Length", str(len(content)))
            self.send_header("Cache-Control", "no-store")
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, format: str, *args: object) -> None:
            """Say nothing."""

    return Handler
