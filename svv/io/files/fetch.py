"""Downloads of files with a known SHA-256; a file with another hash is never opened."""

from __future__ import annotations

import hashlib
import http.client
import os
import urllib.error
import urllib.parse
import urllib.request
from http.client import HTTPMessage
from pathlib import Path
from typing import IO, BinaryIO

from svv.errors import BadInput, Progress, silent
from svv.io.files.atomic import cannot_write, check_writable

CONNECT_SECONDS = 15
"""Timeout of a connection in seconds."""
BLOCK = 1 << 20
"""Number of bytes that are read at a time."""


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
    """Fetch a file over HTTPS, under a temporary name until its hash was checked.

    Args:
        url: Address of the file.
        folder: Target folder; the file name is the last part of the address.
        sha256: SHA-256 of the file, hexadecimal.
        size: Length of the file in bytes.
        progress: Called for every megabyte.

    Returns:
        The file's path.

    Raises:
        BadInput: The address is not encrypted or cannot be reached, the download is interrupted, the disk is full, or
            the file has another hash. The incomplete file is removed.
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
                _write(file, block, path)
                done += len(block)
                progress(done / size, f"{done / 1e6:.0f} of {megabytes(size)}")
        if done < size and _is_announced(reply, size):
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


def _is_announced(reply: http.client.HTTPResponse, size: int) -> bool:
    """Return whether the server announced the expected size; otherwise it sends a different file, not too little."""
    return int(reply.headers.get("Content-Length") or size) == size


def _write(file: BinaryIO, block: bytes, path: Path) -> None:
    """Write a block; errors of the disk are reported separately from those of the network."""
    try:
        file.write(block)
    except OSError as error:
        raise cannot_write(path, error) from error


def _check(path: Path, sha256: str, what: str) -> None:
    if sha256_of(path) != sha256:
        raise BadInput(f"{what} is not the expected one (different SHA-256): try again, or provide it yourself.")
