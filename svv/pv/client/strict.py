"""Errors of filters become exceptions of the script that runs them (:func:`svv.pv.strict`), in pvpython and pvbatch.

VTK lets no exception out of a filter, so a filter notes that it has failed, and what the script called raises it: every
function of ``paraview.simple``, and ``UpdatePipeline``. Functions that save refuse what is not there.
"""

from __future__ import annotations

import functools
import sys
import traceback
from collections.abc import Callable, Iterator
from types import FunctionType, ModuleType, TracebackType
from typing import Any

from svv.errors import BadInput, Cancelled
from svv.pv.display.linked_camera import displays_in, inputs_of
from svv.pv.failed import FAILED_STRICT, NUMBER, end_now, in_script, is_strict, name_of, set_strict, take_failure
from svv.pv.paraview_types import Proxy, View

OURS = "StyleRF"
"""How the XML names of our filters begin."""

NOT_SAVED = "{file} is not saved, because {name} has failed: {status}"

NOTHING = "{file} is not saved, because {name} shows nothing{said}"

NOTHING_SHOWN = "{file} is not saved, because the view shows nothing: Show(filter, view) shows a filter in it."

Function = Callable[..., Any]

_depth = [0]
"""How many functions that tell failures are being called; the outermost raises them."""

_told: dict[str, float] = {}
"""The last failure of each filter of a server that the script has been told, by the filter's number."""


def be_strict(on: bool) -> None:
    """Make errors of filters exceptions from now on, or no longer."""
    set_strict(on)
    if in_script():
        import paraview.simple  # noqa: F401  (starts the session, which a script needs anyway)

        install()


def install() -> None:
    """Let ParaView's functions tell failures, if this is a script and as soon as ``paraview.simple`` is there."""
    simple = sys.modules.get("paraview.simple")
    if simple is None or not hasattr(simple, "SaveData") or hasattr(simple.SaveData, "__wrapped__") or not in_script():
        return
    from paraview import servermanager

    servermanager.SourceProxy.UpdatePipeline = _telling(servermanager.SourceProxy.UpdatePipeline)
    servermanager.Property.__call__ = _telling(servermanager.Property.__call__)  # buttons
    servermanager.Proxy.GetPropertyValue = _with_present_status(servermanager.Proxy.GetPropertyValue)
    for name, function in _functions_of(simple):
        told = _telling(function, _BEFORE.get(name))
        setattr(simple, name, told)
        script = vars(sys.modules["__main__"])
        if script.get(name) is function:  # the script has imported it already
            script[name] = told
    _end_in_a_sentence()


def _functions_of(simple: ModuleType) -> Iterator[tuple[str, FunctionType]]:
    """Yield the public functions that paraview.simple defines, which is a package since 6.0."""
    for name, thing in list(vars(simple).items()):
        if isinstance(thing, FunctionType) and not name.startswith("_") and simple.__name__ in thing.__module__:
            yield name, thing


def _telling(function: Function, before: Function | None = None) -> Function:
    """Return a function that does the same, and raises what has failed; ``before`` raises what speaks against it."""

    @functools.wraps(function)
    def telling(*arguments: Any, **options: Any) -> Any:
        outermost = not _depth[0]
        _depth[0] += 1
        try:
            if before is not None and outermost and is_strict():
                before(*arguments, **options)
            result = function(*arguments, **options)
        except Exception as error:
            if outermost and is_strict():
                _raise_failure(error)
            raise
        finally:
            _depth[0] -= 1
        if outermost and is_strict():
            _raise_failure()
        return result

    return telling


def _raise_failure(cause: Exception | None = None) -> None:
    """Raise the failure of a filter that the script has not been told yet, if there is one."""
    failure = take_failure() or _failure_on_server()
    if failure is not None:
        raise failure from cause


def _failure_on_server() -> Exception | None:
    """Return the failure of a filter that works in another process, unless it was told before."""
    from paraview import servermanager

    connection = servermanager.ActiveConnection
    if connection is None or not connection.IsRemote():
        return None
    failures = []
    for (_, number), proxy in servermanager.ProxyManager().GetProxiesInGroup("sources").items():
        if not _is_ours(proxy):
            continue
        failed = failure_of(proxy)
        if failed and failed != _told.get(number):
            failures.append(BadInput(f"{name_of(proxy.GetXMLName())}: {proxy.Status}"))
        _told[number] = failed
    return failures[0] if failures else None


def _with_present_status(plain: Function) -> Function:
    """Return the function that reads a property, for which ParaView keeps what a filter said when it was last asked."""

    @functools.wraps(plain)
    def read(self: Any, name: str) -> Any:
        if name == "Status" and _is_ours(self):
            self.UpdatePropertyInformation()
        return plain(self, name)

    return read


# --- what is to be saved --------------------------------------------------------------------------------------------


def _before_data(filename: object, proxy: Proxy | None = None, *_: object, **__: object) -> None:
    from paraview import simple

    source = proxy or simple.GetActiveSource()
    if source is not None:
        source.UpdatePipeline()
        _check(source, filename)


def _before_picture(filename: object, shown: Any = None, *_: object, **options: Any) -> None:
    from paraview import simple

    shown = shown or next((options[key] for key in ("viewOrLayout", "view", "layout") if options.get(key)), None)
    shown = shown or simple.GetActiveView()
    if shown is None:
        return
    views: list[View] = [shown] if hasattr(shown, "Representations") else simple.GetViewsInLayout(shown)
    displays = [(display, view) for view in views for display in displays_in(view)]
    for display, view in displays:
        display.Input.UpdatePipeline(view.ViewTime)
        _check(display.Input, filename)
    if not displays and any(map(_is_ours, simple.GetSources().values())):
        raise BadInput(NOTHING_SHOWN.format(file=filename))


_BEFORE: dict[str, Function] = {
    "SaveData": _before_data,
    "SaveScreenshot": _before_picture,
    "SaveAnimation": _before_picture,
    "ExportView": _before_picture,
    "WriteImage": _before_picture,
}
"""What is asked before a function saves something."""


def _check(source: Proxy, file: object) -> None:
    """Raise what speaks against saving what a source shows: a filter of ours that has failed, or that it is nothing."""
    _raise_failure()
    ours = list(_ours_until(source))
    failed = next(filter(failure_of, ours), None)
    if failed is not None:
        name = name_of(failed.GetXMLName())
        raise BadInput(NOT_SAVED.format(file=file, name=name, status=failed.Status))
    if ours and _is_empty(source):
        said = f": {ours[0].Status}" if ours[0] is source else "."
        name = name_of(source.GetXMLName()) if _is_ours(source) else source.GetXMLLabel()
        raise BadInput(NOTHING.format(file=file, name=name, said=said))


def _ours_until(source: Any) -> Iterator[Any]:
    """Yield our filters at and before a source, the nearest first."""
    ahead, seen = [source], set()
    while ahead:
        one = ahead.pop(0)
        if one.GetGlobalIDAsString() in seen:
            continue
        seen.add(one.GetGlobalIDAsString())
        if _is_ours(one):
            yield one
        ahead += inputs_of(one)


def _is_ours(proxy: Any) -> bool:
    return proxy is not None and str(proxy.GetXMLName()).startswith(OURS)


def failure_of(proxy: Any) -> float:
    """Return the number of the failure with which a filter of ours has marked what it gives; 0 if it is right."""
    information = proxy.SMProxy.GetDataInformation(0).GetFieldDataInformation().GetArrayInformation(NUMBER)
    return 0.0 if information is None else float(information.GetComponentRange(0)[0])


def _is_empty(source: Any) -> bool:
    information = source.SMProxy.GetDataInformation(source.Port)
    return not information.GetNumberOfPoints() + information.GetNumberOfCells() + information.GetNumberOfRows()


# --- the end --------------------------------------------------------------------------------------------------------


def _end_in_a_sentence() -> None:
    """Let a script that does not catch an error of a filter end with the sentence alone."""
    from paraview.modules.vtkRemotingCore import vtkProcessModule

    usual = sys.excepthook

    def hook(kind: type[BaseException], error: BaseException, at: TracebackType | None) -> None:
        if not (is_strict() and isinstance(error, BadInput | Cancelled)):
            usual(kind, error, at)
            return
        frames = traceback.extract_tb(at)
        own = [frame for frame in frames if frame.filename == sys.argv[0]]
        frame = next(iter([*reversed(own), *frames]), None)
        where = "" if frame is None else f"{frame.filename}, line {frame.lineno}: "
        print(f"{where}{' '.join(str(error).split())}", file=sys.stderr)
        if vtkProcessModule.GetProcessModule().GetSymmetricMPIMode():
            end_now(FAILED_STRICT)  # the other ranks have the same script, and wait for this one: MPI ends them

    sys.excepthook = hook
