"""What filters say that fail, and marks on their outputs: no filter behind one passes an earlier result off as right.

A filter that fails outputs its previous result, or nothing, with the reason, which filters behind it repeat. A script
that ends while a filter lacks what it was asked to show has exit code 2; if scripts are strict
(:mod:`svv.pv.client.strict`), failures are exceptions, and what is left of them at the end gives exit code 1.
"""

from __future__ import annotations

import atexit
import ctypes
import os
import sys
import traceback
from pathlib import Path
from typing import NoReturn

import numpy as np
from vtkmodules.vtkCommonDataModel import vtkDataObject, vtkDataSet

from svv.dvr.read.appearance import named, named_text
from svv.ending import describe_os_error
from svv.errors import BadInput, Cancelled, is_lack_of_memory
from svv.pv.launch.programs import STRICT
from svv.pv.panel_sentences import say_in_panel
from svv.pv.panel_values import label_of

MARK = "StyleRF Failed"
"""Field data of what a filter outputs that has failed, and of what is made from it: the reason."""

NUMBER = "StyleRF Failure"
"""The same: the number of the failure, from 1. A client learns numbers of its server's data, but no texts."""

UNEXPECTED = (
    "This should not have failed ({error} in {place}): please report it, with the input and this line. Other filters, "
    "and this one with another input, go on working."
)

NO_MEMORY = "There is not enough memory for this: choose fewer or smaller views, or a smaller preset."

NOT_INSTALLED = (
    "{name} is missing in ParaView's Python, and StyleRF needs it: start ParaView with `svv paraview` (a server with "
    "`svv pvserver`), which provides it."
)

EARLIER = "This shows an earlier result: {reason}"

FAILED_SCRIPT = 2
"""Exit code of a script that ends with wrong pictures, as that of commands with bad input."""

FAILED_STRICT = 1
"""The same if scripts are strict: that of any script that ends with an exception."""

_strict = [os.environ.get(STRICT) == "1"]
"""Whether failures are to be exceptions of scripts."""

_count = [0]
"""How many outputs have been marked."""

_untold: dict[str, Exception] = {}
"""Failures that no exception has told the script yet, by the filter's address."""

_wrong: dict[str, str] = {}
"""Reason why a filter does not show what it was asked to, by its address; filters behind one that failed."""


def sentence_on(error: Exception) -> str:
    """Return one sentence for the user about an error in a filter."""
    if isinstance(error, BadInput):
        return say_in_panel(str(error))
    if isinstance(error, ImportError):
        return NOT_INSTALLED.format(name=error.name or str(error))
    if isinstance(error, OSError):  # a disk that fails
        return describe_os_error(error)
    if is_lack_of_memory(error):
        return NO_MEMORY
    frames = traceback.extract_tb(error.__traceback__)
    place = f"{Path(frames[-1].filename).name}, line {frames[-1].lineno}" if frames else "an unknown place"
    return UNEXPECTED.format(error=f"{type(error).__name__}: {error}", place=place)


class FailedBefore(BadInput):
    """A filter before this one has failed; the message says which, and why."""


def reason_of(filter: str, sentence: str, stopped: bool = False) -> str:
    """Return what filters behind one of a class say if it has failed.

    >>> reason_of("StyleRFStylizedView", "There is no style picture a.png: choose another.")
    'StyleRF Stylized View before this filter failed: There is no style picture a.png: choose another.'
    """
    return f"{name_of(filter)} before this filter {'was stopped' if stopped else 'failed'}: {sentence}"


def mark_failed(data: vtkDataObject, reason: str) -> None:
    """Mark data as not what the filter was asked for."""
    data.GetFieldData().AddArray(named_text(MARK, reason))
    _count[0] += 1
    data.GetFieldData().AddArray(named(NUMBER, np.array([float(_count[0])])))


def reason_in(data: vtkDataObject | None) -> str:
    """Return why data are not what their filter was asked for; '' if they are."""
    fields = None if data is None else data.GetFieldData()
    array = None if fields is None else fields.GetAbstractArray(MARK)
    return "" if array is None else str(array.GetValue(0))


def check_there(data: vtkDataObject | None) -> None:
    """Raise FailedBefore if there are no data because the filter before this one has failed."""
    reason = reason_in(data)
    if reason and is_empty(data):
        raise FailedBefore(reason)


def is_empty(data: vtkDataObject | None) -> bool:
    """Return whether data have neither points nor rows."""
    kind = vtkDataObject.POINT if isinstance(data, vtkDataSet) else vtkDataObject.ROW
    return data is None or data.GetNumberOfElements(kind) == 0


def note_right(filter: object) -> None:
    """Take note that a filter shows what it was asked to."""
    _wrong.pop(_address(filter), None)
    _untold.pop(_address(filter), None)


def note_wrong(filter: object, reason: str) -> None:
    """Take note that a filter shows something else than it was asked to; a script that ends now has failed."""
    _wrong[_address(filter)] = reason
    _untold.setdefault(_address(filter), BadInput(reason))


def note_failed(filter: object, sentence: str, stopped: bool = False) -> None:
    """Take note of what a strict script is to be told: that a filter has failed, or was stopped."""
    said = f"{name_of(type(filter).__name__)}: {sentence}"
    _untold[_address(filter)] = Cancelled(said) if stopped else BadInput(said)


def take_failure() -> Exception | None:
    """Return the first failure that the script has not been told; the others follow from it, or were before it."""
    first = next(iter(_untold.values()), None)
    _untold.clear()
    return first


def name_of(filter: str) -> str:
    """Return the label of a class of filters, 'StyleRF Stylized View' for 'StyleRFStylizedView'."""
    return f"StyleRF {label_of(filter.removeprefix('StyleRF'))}"


def in_script() -> bool:
    """Return whether this process runs a script in pvpython or pvbatch; neither ParaView's window nor a server does."""
    from paraview.modules.vtkRemotingCore import vtkProcessModule

    scripts = (vtkProcessModule.PROCESS_CLIENT, vtkProcessModule.PROCESS_BATCH)
    return not in_window() and vtkProcessModule.GetProcessType() in scripts


def in_window() -> bool:
    """Return whether this process is ParaView's window; ``paraview.fromGUI`` is not set there, at least in 5.11."""
    import paraview
    from paraview.modules.vtkRemotingCore import vtkProcessModule

    module = vtkProcessModule.GetProcessModule()
    return paraview.fromGUI or (module is not None and Path(module.GetProgramPath() or "").stem.startswith("paraview"))


def pressing(button: str = "Take What Is Shown Now") -> str:
    """Return what the user does so that a filter does what a button of its panel stands for, in a script or not."""
    return f"call {button.replace(' ', '')}() of the filter" if in_script() else f"press {button}"


def is_strict() -> bool:
    """Return whether failures of filters are exceptions here."""
    return _strict[0] and in_script()


def set_strict(on: bool) -> None:
    """Choose whether failures of filters are exceptions of scripts; those before this count as told."""
    _untold.clear()
    _strict[0] = on


def _address(filter: object) -> str:
    return str(getattr(filter, "__this__", id(filter)))


@atexit.register
def _end() -> None:
    """End a script with an exit code that says so if it leaves filters that do not show what they were asked to."""
    left = [str(error) for error in _untold.values()] if _strict[0] else list(_wrong.values())
    if left and in_script():
        print(f"svv: {left[0]}", file=sys.stderr)
        end_now(FAILED_STRICT if _strict[0] else FAILED_SCRIPT)


def end_now(code: int) -> NoReturn:
    """End the process, with everything written that it has said."""
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    ctypes.CDLL(None).fflush(None)  # what ParaView's own streams hold
    os._exit(code)
