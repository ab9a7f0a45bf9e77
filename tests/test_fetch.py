"""Downloads: either the complete expected file, or no file and an error message."""

from __future__ import annotations

import hashlib
import http.server
import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from svv.errors import BadInput, Cancelled
from svv.io.files import fetch


class Sender(http.server.BaseHTTPRequestHandler):
    """Sends a file whole, cut short, or another one."""

    content = bytes(range(256)) * 40

    def do_GET(self) -> None:
        sent = {"/short": self.content[:5000], "/other": b"an error page"}.get(self.path, self.content)
        self.send_response(404 if self.path == "/missing" else 200)
        self.send_header("Content-Length", str(len(b"an error page" if self.path == "/other" else self.content)))
        self.end_headers()
        self.wfile.write(sent)

    def log_message(self, format: str, *arguments: object) -> None:
        """Keep quiet."""


@pytest.fixture(scope="module")
def server() -> Iterator[str]:
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Sender) as listening:
        threading.Thread(target=listening.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{listening.server_address[1]}"
        listening.shutdown()


def fetched(url: str, to: Path, progress: Callable[[float, str], None] = lambda *_: None) -> Path:
    return fetch.download(url, to, hashlib.sha256(Sender.content).hexdigest(), len(Sender.content), progress)


def test_a_download_is_whole_and_the_file_expected_or_not_there(server: str, tmp_path: Path) -> None:
    assert fetched(f"{server}/file", tmp_path).read_bytes() == Sender.content
    for name, reason in (
        ("short", "stopped after"), ("other", "not the expected one"), ("missing", "cannot be fetched .*Not Found"),
    ):  # fmt: skip
        with pytest.raises(BadInput, match=reason):
            fetched(f"{server}/{name}", tmp_path)
    with pytest.raises(BadInput, match="cannot be fetched"):
        fetched("http://127.0.0.1:9/gone", tmp_path)
    with pytest.raises(BadInput, match="Cannot write"):
        fetched(f"{server}/file", tmp_path / "no" / "folder")

    def stop(_: float, __: str) -> None:
        raise Cancelled

    with pytest.raises(Cancelled):
        fetched(f"{server}/stopped", tmp_path, stop)
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_who_answers_and_sends_nothing_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fetch, "CONNECT_SECONDS", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        with pytest.raises(BadInput, match=r"cannot be fetched .*timed out"):
            fetched(f"http://127.0.0.1:{silent.getsockname()[1]}/file", tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_pip_that_says_nothing_more_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "pip3").write_text("#!/bin/sh\nexec sleep 60\n")
    (tmp_path / "pip3").chmod(0o755)
    monkeypatch.setattr(fetch, "find_spec", lambda _: None)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    monkeypatch.setattr(fetch, "STALL_SECONDS", 0.5)
    (place := tmp_path / "place").mkdir()
    with pytest.raises(BadInput, match="stopped sending"):
        fetch.from_index("name", "1.0", "name-1.0.tar.gz", place, "0" * 64, 1000)


@pytest.mark.parametrize(("count", "text"), [(6_943_360, "6.9 MB"), (63_794_605, "64 MB"), (553_433_881, "553 MB")])
def test_sizes_are_named_as_people_read_them(count: int, text: str) -> None:
    assert fetch.megabytes(count) == text
