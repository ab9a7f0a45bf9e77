"""Read movies back: with ffmpeg, their tags from the file itself, and the colours that a browser shows."""

from __future__ import annotations

import base64
import json
import queue
import re
import shutil
import struct
import subprocess
import tempfile
import threading
from collections.abc import Sequence
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from numpy.typing import NDArray

from tests import browser

TAGS = {
    "primaries": "colour_primaries",
    "transfer": "transfer_characteristics",
    "matrix": "matrix_coefficients",
    "full range": "video_full_range_flag",
}
"""What a movie says of its colours, and how H.264 calls it."""

CHROMIUM = ("--headless", "--no-sandbox", "--no-first-run", "--user-data-dir={profile}")
FIREFOX = ("--headless", "--no-remote", "--profile", "{profile}")
"""Options with which the browsers show a page without a window, a user's settings and questions."""

PAGE = """<!doctype html><meta charset="utf-8"><title>movies</title><script>
async function tell(url) {
  const video = document.createElement("video"), canvas = document.createElement("canvas");
  if (!video.canPlayType('video/mp4; codecs="avc1.64001f"')) throw new Error("no H.264");
  video.muted = true;
  video.src = url;
  await new Promise((go, no) => { video.onloadeddata = go; video.onerror = () => no(video.error.message); });
  video.currentTime = video.duration / 2;
  await new Promise((go) => { video.onseeked = go; });
  const { videoWidth: width, videoHeight: height } = video;
  [canvas.width, canvas.height] = [width, height];
  const drawn = canvas.getContext("2d", { willReadFrequently: true });
  for (;;) {  // a frame is there a little after it was sought
    drawn.drawImage(video, 0, 0);
    const { data } = drawn.getImageData(0, 0, width, height);
    if (data[3] === 255) return fetch(`/${width}/${height}`, { method: "POST", body: data });
    await new Promise((go) => setTimeout(go, 50));
  }
}
(async () => { for (const url of URLS) await tell(url); })()
  .catch((error) => fetch("/wrong", { method: "POST", body: String(error) }));
</script>"""
"""A page that tells the frames in the middle of movies, as its browser shows them."""


def frames_of(path: str | Path) -> NDArray[np.uint8]:
    """All frames of a movie. (n, h, w, 3)"""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", str(path)]
    pictures = subprocess.run([*command, "-f", "image2pipe", "-vcodec", "ppm", "-"], capture_output=True, check=True)
    content = pictures.stdout  # each: P6, width and height, 255, and the pixels
    head = content.index(b"\n255\n") + 5
    width, height = (int(number) for number in content[:head].split()[1:3])
    frames = np.frombuffer(content, np.uint8).reshape(-1, head + 3 * width * height)
    return frames[:, head:].reshape(-1, height, width, 3)


def tags_of(path: Path) -> dict[str, int]:
    """What a movie says its colours are, by the numbers of ITU-T H.273: in its stream, and in the file around it.

    FFmpeg lists the stream's headers. The file's box ``colr``, which FFmpeg 4 leaves out, is read here.
    """
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-i", str(path), "-c", "copy", "-bsf:v", "trace_headers"]
    listed = subprocess.run([*command, "-f", "null", "-"], capture_output=True, check=True, text=True).stderr
    stream = {
        tag: {int(number) for number in re.findall(rf"{name} +[01]+ = (\d+)", listed)} for tag, name in TAGS.items()
    }
    _, box, after = path.read_bytes().partition(b"colrnclx")
    if box:
        primaries, transfer, matrix, full = struct.unpack(">HHHB", after[:7])
        assert stream == dict(zip(TAGS, ({primaries}, {transfer}, {matrix}, {full >> 7}), strict=True))
    return {tag: number for tag, (number,) in stream.items()}


def firefox() -> str | None:
    """Path of a Firefox; None where there is none."""
    return shutil.which("firefox-esr") or shutil.which("firefox")


def shown_by(program: str, movies: Sequence[Path]) -> list[NDArray[np.uint8]]:
    """The frame in the middle of each movie as Chromium or Firefox shows it, read from a canvas. (h, w, 3)

    The browser opens a page that sends them to this process, which playwright's own Firefox alone would not need.
    """
    urls = ["data:video/mp4;base64," + base64.b64encode(movie.read_bytes()).decode() for movie in movies]
    page, told = PAGE.replace("URLS", json.dumps(urls)).encode(), queue.SimpleQueue[tuple[str, bytes]]()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            found = self.path == "/"
            self.send_response(200 if found else 404)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(page if found else b"")

        def do_POST(self) -> None:
            told.put((self.path, self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(204)
            self.end_headers()

        def log_message(self, *_: object) -> None: ...

    frames = []
    with (
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile,
        ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server,
    ):
        threading.Thread(target=server.serve_forever, daemon=True).start()
        options = [option.format(profile=profile) for option in (FIREFOX if "firefox" in program else CHROMIUM)]
        command = [program, *options, f"http://127.0.0.1:{server.server_port}/"]
        running = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            for _ in movies:
                path, content = told.get(timeout=browser.PATIENCE)
                if b"no H.264" in content:
                    pytest.skip(
                        f"{Path(program).name} plays no H.264 here; Debian: sudo apt-get install libavcodec-extra"
                    )
                assert path != "/wrong", content
                width, height = map(int, path.split("/")[1:])
                frames.append(np.frombuffer(content, np.uint8).reshape(height, width, 4)[..., :3])
        finally:
            running.terminate()
            running.wait()
            server.shutdown()
    return frames
