"""A server of the Model Context Protocol over standard input and output: any assistant drives svv in one folder.

Needs the package mcp (the extra ``agents``). Standard output belongs to the protocol, so nothing may be printed there.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from svv._version import __version__
from svv.errors import BadInput
from svv.job.workshop import TOOLS, Workshop

if TYPE_CHECKING:
    from mcp.server.mcpserver import MCPServer

SAID = (
    "svv turns volumes into scenes that are edited, painted and rendered region by region. Paths are relative to one "
    "folder. Look at info first, name regions, edit them in words, and render to see the result."
)
"""What an assistant is told about the server."""


def server_for(root: str | Path) -> MCPServer:
    """Return the server of a folder.

    Raises:
        BadInput: There is no such folder, or the package mcp is missing or too old.
    """
    workshop = Workshop(root)
    if find_spec("mcp") is None:
        raise BadInput("The server needs the package mcp, which is not installed: pip install 'svv[agents]'.")
    try:
        module = import_module("mcp.server.mcpserver")
    except ImportError as error:
        raise BadInput("The package mcp is too old for this server: pip install 'mcp>=2'.") from error
    server = module.MCPServer("svv", instructions=SAID, version=__version__)
    for name in TOOLS:
        method = getattr(workshop, name)
        tool = _plain(method, import_module("mcp.server.mcpserver.exceptions").ToolError)
        if name == "render":
            server.tool(name=name, structured_output=False)(_showing(tool, workshop, module.Image))
        else:
            server.tool(name=name)(tool)
    return server


def _plain(method: Callable[..., object], failed: type[Exception]) -> Callable[..., object]:
    """Return a method whose errors are one sentence for the assistant."""

    @functools.wraps(method)
    def tool(**given: object) -> object:
        try:
            return method(**given)
        except BadInput as error:
            raise failed(str(error)) from None

    return tool


def _showing(
    method: Callable[..., object], workshop: Workshop, picture: Callable[..., object]
) -> Callable[..., object]:
    """Return a method whose result, the path of a picture, comes with the picture itself."""

    @functools.wraps(method)
    def tool(**given: object) -> list[object]:
        path = method(**given)
        return [path, picture(path=workshop.place(str(path)))]

    return tool
