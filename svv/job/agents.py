"""A server of the Model Context Protocol over standard input and output: any assistant drives svv in one folder.

Needs the package mcp (the extra ``agents``). Standard output belongs to the protocol, so nothing may be printed there.
"""

from __future__ import annotations

import functools
import inspect
import io
import threading
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_type_hints

from PIL import Image

from svv._version import __version__
from svv.errors import BadInput, Cancelled
from svv.job.background import Jobs
from svv.job.workshop import TOOLS, Workshop

if TYPE_CHECKING:
    from mcp.server.mcpserver import Context, MCPServer

SAID = (
    "svv turns volumes into scenes that are edited, painted and rendered region by region. Paths are relative to one "
    "folder. Look at info first, name regions, edit them in words, and render to see the result. Drawing views, "
    "training and painting may take minutes: start them with background=true if your calls are given up after a minute."
)
"""What an assistant is told about the server."""

BACKGROUND = (
    "\n\nWith background=true it returns at once with the number of a job, for what would take more than a minute; the "
    "tool job says how far it is."
)
"""What is told of each tool that takes long."""

TELL_EVERY, LEAST = 1.0, 1e-6
"""Seconds between two reports of progress, and by how much each is above the last one, as the protocol demands."""

MOST_CHARACTERS = 700_000
"""Largest number of characters of base64 in which a picture is sent; some clients refuse answers of a megabyte."""

SMALLER = 0.85
"""Factor by which a picture that is too large is made smaller until it is not."""


def serve(root: str | Path) -> None:
    """Serve a folder over standard input and output, until the client leaves.

    Tools that take long report their progress and stop when the client cancels the call or leaves; nothing is left half
    written. In the background, they end with the server. Raises BadInput if there is no such folder, or the package mcp
    is missing or too old.
    """
    jobs = Jobs(Workshop(root))
    server = _server_for(jobs)
    try:
        server.run("stdio")
    finally:
        jobs.end()


def _server_for(jobs: Jobs) -> MCPServer:
    if find_spec("mcp") is None:
        raise BadInput("The server needs the package mcp, which is not installed: pip install 'svv[agents]'.")
    try:
        module = import_module("mcp.server.mcpserver")
    except ImportError as error:
        raise BadInput("The package mcp is too old for this server: pip install 'mcp>=2'.") from error
    server = module.MCPServer("svv", instructions=SAID, version=__version__)
    offered = _Offered(module, jobs)
    for name in TOOLS:
        method = getattr(jobs.workshop, name)
        is_long = "progress" in inspect.signature(method).parameters
        server.tool(
            name=name,
            description=method.__doc__ + BACKGROUND * is_long,
            structured_output=False if name == "render" else None,
        )(offered.long(method, background=True) if is_long else offered.short(method))
    server.tool(name="job", structured_output=False)(offered.long(jobs.job, background=False))
    return server


class _Offered:
    """Methods as tools of the protocol of ``mcp.server.mcpserver``; their errors are one sentence for assistants."""

    def __init__(self, module: Any, jobs: Jobs) -> None:
        self._context, self._picture = module.Context, module.Image
        self._failed = import_module("mcp.server.mcpserver.exceptions").ToolError
        self._jobs = jobs
        self._alone = import_module("anyio").CapacityLimiter(1)  # what computes shares kernels, random numbers and CPUs

    def short(self, method: Callable[..., object]) -> Callable[..., object]:
        """Return a method as a tool."""

        @functools.wraps(method)
        def tool(**given: object) -> object:
            try:
                return method(**given)
            except BadInput as error:
                raise self._failed(str(error)) from None

        return tool

    def long(self, method: Callable[..., object], background: bool) -> Callable[..., object]:
        """Return a method as a tool that reports its progress, ends with its caller, or starts in the background."""
        hints, name = get_type_hints(method), method.__name__

        async def tool(context: Context, **given: Any) -> object:
            if background and given.pop("background"):
                try:
                    said = self._jobs.start(name, given)
                except BadInput as error:
                    raise self._failed(str(error)) from None
                return said if hints["return"] is str else [said]
            work = functools.partial(method, **given)
            result = await self._worked(work, context, self._alone if background else None)
            if name == "render":
                return self._seen(str(result))
            if name == "job" and result["tool"] == "render" and result["state"] == "done":
                return [result, *self._seen(result["result"])]
            return result

        taken = [p.replace(annotation=hints[p.name]) for p in inspect.signature(method).parameters.values()]
        kind = inspect.Parameter.KEYWORD_ONLY
        more = [inspect.Parameter("background", kind, default=False, annotation=bool)] if background else []
        own = [*taken[:-1], *more, inspect.Parameter("context", kind, annotation=self._context)]
        tool.__name__, tool.__doc__ = name, method.__doc__
        tool.__signature__ = inspect.Signature(own, return_annotation=hints["return"])  # type: ignore[attr-defined]
        tool.__annotations__ = {p.name: p.annotation for p in own} | {"return": hints["return"]}
        return tool

    async def _worked(self, work: Callable[..., Any], context: Context, limiter: Any) -> Any:
        """Work in a thread, tell how far that is, and if the call is cancelled, stop it and wait until it has."""
        import anyio.lowlevel

        stopped, newest = threading.Event(), (0.0, "starting")

        def heard(fraction: float, label: str) -> None:
            nonlocal newest
            newest = fraction, label
            if stopped.is_set():
                raise Cancelled

        def outcome() -> tuple[Any, Exception | None]:
            try:
                return work(progress=heard), None
            except BadInput as error:
                return None, self._failed(str(error))
            except Exception as error:
                return None, error

        async def tell() -> None:
            told = 0.0
            try:
                while True:
                    await context.report_progress(told, 1.0, newest[1])
                    await anyio.sleep(TELL_EVERY)
                    told = max(newest[0], told + LEAST)
            finally:
                stopped.set()

        async with anyio.create_task_group() as tasks:
            tasks.start_soon(tell)
            result, error = await anyio.to_thread.run_sync(outcome, limiter=limiter)
            tasks.cancel_scope.cancel()
        await anyio.lowlevel.checkpoint_if_cancelled()
        if error is not None:
            raise error
        return result

    def _seen(self, name: str) -> list[Any]:
        """Return the path of a picture with the picture, which is sent smaller if it is too large."""
        said, content = _within(self._jobs.workshop.place(name))
        return [f"{name}{said}", self._picture(data=content, format="png")]


def _within(path: Path) -> tuple[str, bytes]:
    """Return what is to be said of a PNG, and the PNG itself, or a smaller one of at most :data:`MOST_CHARACTERS`."""
    content, factor, said = path.read_bytes(), 1.0, ""
    while 4 * -(-len(content) // 3) > MOST_CHARACTERS:
        factor *= SMALLER
        with Image.open(path) as picture:
            width, height = (max(round(factor * side), 1) for side in picture.size)
            said = f" has {picture.width} x {picture.height} pixels; it is shown at {width} x {height}, to be sent."
            buffer = io.BytesIO()
            picture.convert("RGB").resize((width, height), Image.Resampling.LANCZOS).save(buffer, format="PNG")
        content = buffer.getvalue()
    return said, content
