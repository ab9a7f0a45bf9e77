"""How a volume is shown: from the client's active view into a filter's panel.

Only the client knows the views, so this is client code: it sets properties, which ParaView then carries to the server
like any others. ``paraview.simple`` and ``servermanager`` are imported when they are needed and no sooner: in a program
that is just starting, they would make a session of their own.
"""

from __future__ import annotations

from typing import Any

from paraview.modules.vtkRemotingServerManager import vtkSMProxyIterator, vtkSMProxyManager

from svv.errors import BadInput
from svv.pv import follow
from svv.pv.kept_as import KEEPING, watch_kept
from svv.pv.live import watch_camera, watch_view
from svv.pv.points import watch_points
from svv.pv.undo import watch

CAPTURED = ("StyleRFStylizedView", "StyleRFViews", "StyleRFTrain")
"""Filters that look at a volume."""

BUTTONS = ("StyleRFEdit", "StyleRFPalette")
"""Filters with buttons that set their panel (:mod:`svv.pv.undo`)."""

POINTS = "StyleRFStylize"
"""The filter whose points can be set in a view (:mod:`svv.pv.points`)."""

IMAGES = ("StyleRFRender", "StyleRFStylizedView", "StyleRFViews", "StyleRFViewsReader", "StyleRFStylize")
"""Filters and readers whose output is an image of colours."""

DISPLAY = "UniformGridRepresentation"
"""What ParaView shows a ``vtkImageData`` with in a 3D view."""

SEEN = "StyleRF.seen"
"""Mark on a representation that has been looked at once: from then on it is the user's."""

_observed: list[Any] = []


def volume_display(source: Any, view: Any = None) -> Any:
    """The representation that shows a source as a volume.

    Args:
        source: A source or filter, as ParaView's Python has them.
        view: Where it is shown; by default the active view, then any other.

    Raises:
        BadInput: it is shown nowhere as a volume.
    """
    source = getattr(source, "SMProxy", source)
    from paraview import simple

    first = view or simple.GetActiveView()
    for candidate in [v for v in (first, *simple.GetRenderViews()) if v is not None]:
        for display in candidate.Representations:
            given = getattr(display, "Input", None)
            if given is not None and given.SMProxy == source and display.Representation == "Volume":
                return display
    raise BadInput(
        "The input is shown nowhere as a volume: set its representation to Volume in the active view, so that there is "
        "a transfer function to learn from."
    )


def shown_as(display: Any) -> dict[str, Any]:
    """How a representation shows a volume: the values of the properties of the same names of our filters.

    Args:
        display: A representation, as ParaView's Python has it.

    Raises:
        BadInput: it shows the volume in a way that cannot be learned.
    """
    if getattr(display, "UseSeparateOpacityArray", 0) or getattr(display, "UseTransfer2D", 0):
        raise BadInput("The volume is shown with a second array or a 2D transfer function; use one array and a 1D one.")
    table = display.LookupTable
    if table is None:
        raise BadInput("The volume is shown without a colour map; choose an array under Coloring.")
    if display.ScalarOpacityFunction is not None:
        table.ScalarOpacityFunction = display.ScalarOpacityFunction
    return {
        "TransferFunction": table,
        "Scalars": [display.ColorArrayName[0], display.ColorArrayName[1]],
        "OpacityUnitDistance": display.ScalarOpacityUnitDistance,
        **{name: getattr(display, name) for name in ("Shade", "Ambient", "Diffuse", "Specular", "SpecularPower")},
    }


def capture(filter: Any, view: Any = None) -> None:
    """Take transfer function, opacity unit distance and shading from the display of a filter's input into its panel.

    Args:
        filter: A StyleRF filter, as ParaView's Python has it.
        view: Where its input is shown, by default the active view.

    Raises:
        BadInput: the input is not shown as a volume, or in a way that cannot be learned.
    """
    for name, value in shown_as(volume_display(filter.Input, view)).items():
        setattr(filter, name, value)


def watch_new_filters() -> None:
    """Capture into every filter of ours when it is made, where there is something to capture.

    A filter begins without a transfer function; this saves the user from linking it by hand, in the window as in a
    script. Called by the plugin, in the client.
    """
    manager = vtkSMProxyManager.GetProxyManager()
    # A plugin that is loaded at the start comes before the session; and a connection to a server is another session.
    manager.AddObserver(manager.ActiveSessionChanged, _session_changed)
    _watch_session(manager.GetActiveSessionProxyManager())


def _session_changed(manager: Any, *_: Any) -> None:
    _watch_session(manager.GetActiveSessionProxyManager())


def _watch_session(session: Any) -> None:
    if session is not None and session not in _observed:
        _observed.append(session)
        session.AddObserver("RegisterEvent", _registered)


def _registered(session: Any, *_: Any) -> None:
    for name in CAPTURED:
        # There is no saying which proxy the event is about, but a new one has no transfer function yet.
        for filter in _proxies(session, name):
            if filter.TransferFunction is None and filter.Input is not None:
                try:
                    capture(filter)
                except BadInput:
                    continue  # the filter says what is missing when it is applied
    for name in BUTTONS:
        for filter in _proxies(session, name):
            watch(filter)
    for name in KEEPING:
        for filter in _proxies(session, name):
            watch_kept(filter)
    for filter in _proxies(session, POINTS):
        watch_points(filter)
    for name in follow.IMAGES:
        for filter in _proxies(session, name):
            watch_camera(filter)
    for view in _proxies(session, "RenderView", "views"):
        watch_view(view)
    loading = session.GetInLoadXMLState()  # a state says itself how things are shown
    for display in _proxies(session, DISPLAY, "representations"):
        if not display.SMProxy.HasAnnotation(SEEN) and display.Input is not None:
            display.SMProxy.SetAnnotation(SEEN, "1")
            if not loading and display.Input.SMProxy.GetXMLName() in IMAGES:
                as_it_is(display)


def as_it_is(display: Any) -> None:
    """Show an image's colours as they are, and not through a colour map."""
    display.Representation = "Slice"
    display.ColorArrayName = ["POINTS", "RGBA"]
    display.MapScalars = 0


def _proxies(session: Any, kind: str, group: str = "sources") -> list[Any]:
    from paraview import servermanager

    iterator = vtkSMProxyIterator()
    iterator.SetSessionProxyManager(session)
    iterator.SetModeToOneGroup()
    iterator.Begin(group)
    found = []
    while not iterator.IsAtEnd():
        if iterator.GetProxy().GetXMLName() == kind:
            found.append(servermanager._getPyProxy(iterator.GetProxy()))
        iterator.Next()
    return found
