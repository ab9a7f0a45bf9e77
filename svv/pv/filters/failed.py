"""What filters say that fail, and marks on their outputs: no filter behind one passes an earlier result off as right.

A filter that fails outputs its previous result, or nothing. Both carry the reason, which filters behind it repeat. In
pvpython and pvbatch, which show no messages, a script that ends while a filter still lacks what it was asked to show
has failed as well: its exit code is 2.
"""

from __future__ import annotations

import atexit
import ctypes
import os
import sys
import traceback
from pathlib import Path

from vtkmodules.vtkCommonCore import vtkStringArray
from vtkmodules.vtkCommonDataModel import vtkDataObject, vtkDataSet

from svv.ending import said_of
from svv.errors import BadInput, is_lack_of_memory
from svv.pv.panel.properties import label_of

MARK = "StyleRF Failed"
"""Field data of what a filter outputs that has failed, and of what is made from it: the reason."""

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

_wrong: dict[str, str] = {}
"""Reason why a filter does not show what it was asked to, by its address; filters behind one that failed."""


def sentence_on(error: Exception) -> str:
    """Return one sentence for the user about an error in a filter."""
    if isinstance(error, BadInput):
        return str(error)
    if isinstance(error, ImportError):
        return NOT_INSTALLED.format(name=error.name or str(error))
    if isinstance(error, OSError):  # a disk that fails
        return said_of(error)
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
    label = f"StyleRF {label_of(filter.removeprefix('StyleRF'))}"
    return f"{label} before this filter {'was stopped' if stopped else 'failed'}: {sentence}"


def mark_failed(data: vtkDataObject, reason: str) -> None:
    """Mark data as not what the filter was asked for."""
    array = vtkStringArray()
    array.SetName(MARK)
    array.InsertNextValue(reason)
    data.GetFieldData().AddArray(array)


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


def note_wrong(filter: object, reason: str) -> None:
    """Take note that a filter shows something else than it was asked to; a script that ends now has failed."""
    _wrong[_address(filter)] = reason


def _address(filter: object) -> str:
    return str(getattr(filter, "__this__", id(filter)))


@atexit.register
def _end() -> None:
    """End a script with an exit code that says so if it leaves filters that do not show what they were asked to."""
    if not _wrong:
        return
    import paraview
    from paraview.modules.vtkRemotingCore import vtkProcessModule

    scripts = (vtkProcessModule.PROCESS_CLIENT, vtkProcessModule.PROCESS_BATCH)
    if paraview.fromGUI or vtkProcessModule.GetProcessType() not in scripts:
        return
    print(f"svv: {next(iter(_wrong.values()))}", file=sys.stderr)
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    ctypes.CDLL(None).fflush(None)  # what ParaView's own streams hold
    os._exit(FAILED_SCRIPT)
