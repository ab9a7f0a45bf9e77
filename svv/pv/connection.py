"""Whether the process at the other end of a connection, ParaView's client or its server, is still there.

ParaView itself finds out only when it reads from it: until then a server works for a client that has gone, and a client
that asks a dead server for a property's value is ended by an assertion.
"""

from __future__ import annotations

import select
import sys

import vtkmodules.vtkCommonSystem
import vtkmodules.vtkParallelCore  # noqa: F401  (these let Python know the classes of a connection's parts)

from svv.pv.paraview_types import Session, SMProxy

GONE = select.POLLHUP | select.POLLERR | getattr(select, "POLLRDHUP", 0) if hasattr(select, "poll") else 0
"""Events of a socket whose other end has been closed."""


def client_gone() -> bool:
    """Return whether this is a server whose client has gone."""
    from paraview.modules.vtkRemotingCore import vtkProcessModule, vtkPVSession

    module = vtkProcessModule.GetProcessModule()
    session = None if module is None else module.GetActiveSession()
    return session is not None and session.IsA("vtkPVSessionServer") and _is_gone(session, vtkPVSession.CLIENT)


def server_gone(proxy: SMProxy) -> bool:
    """Return whether the server that has the object of a proxy (``SMProxy``) has gone."""
    from paraview.modules.vtkRemotingCore import vtkPVSession

    return _is_gone(proxy.GetSession(), vtkPVSession.DATA_SERVER_ROOT)


def _is_gone(session: Session, whom: int) -> bool:
    controller = session.GetController(whom)
    communicator = None if controller is None else controller.GetCommunicator()
    socket = communicator.GetSocket() if hasattr(communicator, "GetSocket") else None
    if socket is None or not GONE or sys.platform == "win32":
        return False
    poll = select.poll()
    poll.register(socket.GetSocketDescriptor(), GONE)
    return bool(poll.poll(0))
