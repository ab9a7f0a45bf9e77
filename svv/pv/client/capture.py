"""Copy how a volume is displayed from the client's active view into a filter's panel.

Only the client knows the views, so this is client code, which sets properties. ``paraview.simple`` and
``servermanager`` are imported only when needed: in a program that is just starting, they would create another session.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from typing import Any

from paraview.modules.vtkRemotingServerManager import vtkSMProxyIterator, vtkSMProxyManager

from svv.errors import BadInput
from svv.pv.client import follow_property, mask_points, part_picking, placed_shapes, placing, strict
from svv.pv.client.strict import failure_of
from svv.pv.display import linked_camera
from svv.pv.display.display_table import LIGHT_KIT, LIGHTS, light_of, name_in, refused_by, value_of
from svv.pv.display.shown import PLAIN
from svv.pv.failed import in_window
from svv.pv.live.sharpening import BESIDE, watch_learning
from svv.pv.observers import Watched, WeakReference, observe, python_proxy, with_data
from svv.pv.panel.cached_names import KEEPING, take_names
from svv.pv.panel.undo import watch
from svv.pv.paraview_types import Display, Observer, Proxy, SMProxy, SMProxyManager, SMSessionProxyManager, View
from svv.pv.timers import Timer, window
from svv.pv.work.default_function import colours_of
from svv.pv.work.volume_display import as_volume, set_looks

CAPTURED = ("StyleRFStylizedView", "StyleRFViews", "StyleRFTrain")
"""Filters that read a volume's display."""

BUTTONS = ("StyleRFEdit", "StyleRFPalette")
"""Filters with buttons that set their panel (:mod:`svv.pv.panel.undo`)."""

TAKE = ("TakeWhatIsShownNow", "TakeAsEdited")
"""Buttons, of one meaning, after which what a display has changed is captured."""

FOLLOWED = ("Camera", "ParallelScale", "ImageSize")
"""Properties that are set while an image follows a view."""

_captured: Watched[tuple[WeakReference[SMProxy], dict[str, object]]] = Watched()
"""The display that each filter has captured last, and what it was like."""

_applied: list[SMProxy] = []
"""Waiting filters while what is applied to them is passed on."""

_updating: list[Timer] = []
"""The timer that updates a filter which had failed, at most one; without this reference Python would collect it."""

OF_VIEWS = (
    ("EndEvent", follow_property.view_drawn),
    ("StartEvent", set_looks),
    ("StartEvent", placing.render_pictures),
)
"""What is called when a 3D view is drawn, by event."""

IMAGES = ("StyleRFRender", "StyleRFStylizedView", "StyleRFViews", "StyleRFViewsReader", "StyleRFStylize")
"""Filters and readers whose output is an image of colours."""

DISPLAY = "UniformGridRepresentation"
"""XML name of the representation with which ParaView shows a ``vtkImageData`` in a 3D view."""

COEFFICIENTS = ("Diffuse", "Specular", "SpecularPower")
"""Properties of how a display is lit."""

UNKNOWN = (
    "How the volume is shown could not be read ({error}): show it as a volume in the active view, and please report "
    "this."
)

SEEN = "StyleRF.seen"
"""Annotation of a representation that has been set up once; afterwards it is left to the user."""


def volume_display(source: Proxy, view: View | None = None) -> Display:
    """Return the representation that shows a source as a volume, first in the active view, or raise BadInput."""
    for display in _volume_displays(source, view):
        return display
    raise BadInput(
        "No view shows the input as a volume: set its representation to Volume in the active view, which gives it a "
        "transfer function."
    )


def _volume_displays(source: Proxy, view: View | None = None) -> Iterator[Display]:
    """Yield the representations that show a source as a volume, once for each view, those of the active one first."""
    source = getattr(source, "SMProxy", source)
    from paraview import simple

    first = view or simple.GetActiveView()
    for candidate in [first, *(other for other in simple.GetRenderViews() if other != first)]:
        for display in () if candidate is None else candidate.Representations:
            given = getattr(display, "Input", None)
            kind = getattr(display, "Representation", "")
            if given is not None and given.SMProxy == source and kind == "Volume":
                yield display


def shown_as(display: Display) -> dict[str, object]:
    """Return how a representation shows a volume, as values of filters' properties, or raise BadInput."""
    from paraview import simple

    refused = refused_by(display)
    if refused:
        raise BadInput(refused)
    table = display.LookupTable
    if table is None:
        raise BadInput("The volume is shown without a colour map: choose an array under Coloring.")
    # Representations of unstructured grids have neither light nor some of the other properties.
    shade = int(getattr(display, "Shade", 0))
    views = [view for view in simple.GetRenderViews() if display in view.Representations]
    light = light_of(views[0]) if shade and views else ""
    if light == LIGHTS:
        raise BadInput(LIGHTS)
    if display.ScalarOpacityFunction is not None:
        table.ScalarOpacityFunction = display.ScalarOpacityFunction
    names = {name: name_in(display, name) for name in (*COEFFICIENTS, *PLAIN)}
    return {
        "TransferFunction": table,
        "Scalars": [display.ColorArrayName[0], display.ColorArrayName[1]],
        "OpacityUnitDistance": display.ScalarOpacityUnitDistance,
        "Shade": shade,
        "Ambient": 0.0 if light == LIGHT_KIT else getattr(display, "Ambient", 0.0),
        "Notice": light,
        **{name: value_of(display, own) for name, own in names.items() if own is not None},
    }


def capture(filter: Proxy, view: View | None = None) -> None:
    """Copy how a view, by default the active one, shows a filter's input to its panel: function, shading, place ...

    Raises BadInput if it does not show it as a volume, or in a way that is not supported, which the filter then
    refuses.
    """
    _take(filter, volume_display(filter.Input, view), {})


@with_data("string0")
def capture_changes(proxy: SMProxy, event: str, name: str) -> None:
    """Capture what has changed in the display of a filter's input since the last time; an observer of its buttons.

    What was changed in the panel alone stays. If the input is no longer shown as a volume, all does, and also if a
    state was loaded that shows it in several views: it does not say from which one the filter has its panel.
    """
    filter = python_proxy(proxy)
    if name not in TAKE:
        if waits(filter) and _is_applied(filter, name):
            _applied.append(proxy)  # what is set now would not be passed on
        return
    known = _captured.get(proxy)
    displays = list(_volume_displays(filter.Input))
    same = [display for display in displays if known is not None and known[0].Get() is display.SMProxy]
    if same or known is not None or filter.TransferFunction is None or len(displays) == 1:
        _capture_first(filter, same or displays, {} if known is None else known[1])
    interactor = window() if failure_of(filter) else None
    if interactor is not None:  # no view shows it, and so no view's rendering would update it
        _updating[:] = [Timer(interactor, 1, filter.UpdatePipeline)]


def waits(filter: Proxy) -> bool:
    """Return whether a filter of the window lacks a function: learning then waits for *Apply*, not for a view."""
    return in_window() and filter.TransferFunction is None and bool(failure_of(filter))


def applied(proxy: SMProxy, event: str) -> None:
    """Capture the display of a waiting filter's input once all that was applied has been passed on; an observer."""
    if proxy in _applied:
        _applied.remove(proxy)
        filter = python_proxy(proxy)
        _capture_first(filter, _volume_displays(filter.Input), {})


def _is_applied(filter: Proxy, name: str) -> bool:
    """Return whether a property is one that *Apply* passes on, and not one that following a view sets."""
    shown = filter.SMProxy.GetProperty(name)
    return name not in FOLLOWED and shown is not None and shown.GetPanelVisibility() != "never"


def default_colours() -> str:
    """Return the colours that this ParaView gives arrays by itself (:func:`svv.pv.work.default_function`)."""
    session = vtkSMProxyManager.GetProxyManager().GetActiveSessionProxyManager()
    table = session.NewProxy("lookup_tables", "PVLookupTable")
    points, space = table.GetProperty("RGBPoints"), table.GetProperty("ColorSpace")
    numbers = [points.GetElement(number) for number in range(points.GetNumberOfElements())]
    return colours_of(numbers, space.GetElement(0))


def _capture_first(filter: Proxy, displays: Iterable[Display], before: Mapping[str, object]) -> None:
    """Capture the first display, if any, as far as it differs from before; no error keeps others from being set up."""
    try:
        for display in islice(displays, 1):
            _take(filter, display, before)
    except BadInput:
        pass  # the filter reports what is missing when it is applied
    except Exception as error:
        filter.Refusal = UNKNOWN.format(error=f"{type(error).__name__}: {error}")


def _take(filter: Proxy, display: Display, before: Mapping[str, object]) -> None:
    """Give a filter what of its display differs from before."""
    try:
        shown = shown_as(display)
    except BadInput as error:
        filter.Refusal = str(error)
        raise
    filter.Refusal, filter.DefaultColours = "", default_colours()
    now = {**shown, "TransferFunction": display.LookupTable.SMProxy.GetGlobalIDAsString()}
    for name, value in shown.items():
        if name not in before or before[name] != now[name]:
            setattr(filter, name, value)
    _captured.put(filter.SMProxy, (WeakReference(display.SMProxy), now))


OBSERVERS: tuple[tuple[tuple[str, ...], str, Observer], ...] = (
    (CAPTURED, "UpdatePropertyEvent", capture_changes),
    (CAPTURED, "UpdateEvent", applied),
    (KEEPING, "UpdateDataEvent", take_names),
    ((*BUTTONS, part_picking.IMAGE), "UpdatePropertyEvent", part_picking.pressed),
    (("StyleRFStylize",), "UpdatePropertyEvent", mask_points.pressed),
    (linked_camera.IMAGES, "UpdatePropertyEvent", follow_property.property_set),
    (linked_camera.IMAGES, "UpdateDataEvent", follow_property.image_updated),
)
"""What makes buttons and properties of filters work: the filters, an event, and what is called then."""


def watch_new_filters() -> None:
    """Set up every new StyleRF filter, and capture the display of its input; the plugin calls this in the client."""
    manager = vtkSMProxyManager.GetProxyManager()
    # A plugin loaded at startup runs before the session exists, and connecting to a server creates another session.
    manager.AddObserver(manager.ActiveSessionChanged, _session_changed)
    _watch_session(manager.GetActiveSessionProxyManager())


def _session_changed(manager: SMProxyManager, *_: object) -> None:
    _watch_session(manager.GetActiveSessionProxyManager())


def _watch_session(session: SMSessionProxyManager | None) -> None:
    if session is not None:
        strict.install()
        observe(session, "RegisterEvent", _registered)


def _registered(session: SMSessionProxyManager, *_: object) -> None:
    strict.install()
    # The event does not identify the proxy, but a new one has no transfer function yet.
    for filter in _proxies(session, CAPTURED):
        if filter.TransferFunction is None and filter.Input is not None and not waits(filter):
            _capture_first(filter, _volume_displays(filter.Input), {})
    for filter in _proxies(session, BUTTONS):
        watch(filter)
    for names, event, do in OBSERVERS:
        for filter in _proxies(session, names):
            observe(filter.SMProxy, event, do)
    loading = bool(session.GetInLoadXMLState())
    for filter in _proxies(session, BESIDE):
        watch_learning(filter, loading)
    for filter in _proxies(session, linked_camera.IMAGES):
        follow_property.begin(filter, loading)
    for filter in _proxies(session, tuple(placed_shapes.SHAPED)):
        placed_shapes.place(filter, loading)
    for view in _proxies(session, ("RenderView",), "views"):
        for event, do in OF_VIEWS:
            observe(view.SMProxy, event, do)
    for display in _new_displays(session, placing.DISPLAY):
        if not loading:  # a state defines how its data is displayed
            placing.as_placed(display)
    for display in _new_displays(session, DISPLAY):
        if loading or as_volume(display):
            continue
        if display.Input.SMProxy.GetXMLName() in IMAGES:
            as_it_is(display)


def _new_displays(session: SMSessionProxyManager, kind: str) -> Iterator[Display]:
    """Yield the representations of a kind that have not been seen before."""
    for display in _proxies(session, (kind,), "representations"):
        if not display.SMProxy.HasAnnotation(SEEN) and display.Input is not None:
            display.SMProxy.SetAnnotation(SEEN, "1")
            yield display


def as_it_is(display: Display) -> None:
    """Show an image's colours directly, not through a colour map."""
    display.Representation = "Slice"
    display.ColorArrayName = ["POINTS", "RGBA"]
    display.MapScalars = 0


def _proxies(session: SMSessionProxyManager, kinds: Sequence[str], group: str = "sources") -> list[Any]:
    from paraview import servermanager  # before Python meets any proxy, because it lets it know their classes

    iterator = vtkSMProxyIterator()
    iterator.SetSessionProxyManager(session)
    iterator.SetModeToOneGroup()
    iterator.Begin(group)
    found = []
    while not iterator.IsAtEnd():
        if iterator.GetProxy().GetXMLName() in kinds:
            found.append(servermanager._getPyProxy(iterator.GetProxy()))
        iterator.Next()
    return found
