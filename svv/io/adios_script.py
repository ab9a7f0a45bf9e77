"""A program that lets adios2 read a file of ADIOS, in a process of its own. It needs nothing of svv.

ADIOS ends its process on many damaged files, and waits for ever on others that were cut off; so an alarm ends the
process where an answer takes longer than a limit, and :mod:`svv.io.adios_process` tells what happened.

``FILE SECONDS``: writes a line of JSON with ``variables`` (``shape``, ``type`` and ``steps`` by name; ``shape`` is null
if it changes) and ``attributes``. For each line of JSON that it reads (``name``, ``start``, ``count``, ``step``), it
writes one with ``dtype`` and ``bytes``, and the bytes. Instead, a line may have ``says``, what is wrong, or
``missing``.
"""

from __future__ import annotations

import json
import os
import signal
import sys
from typing import Any, BinaryIO


def told_of(opened: Any) -> dict[str, Any]:
    """Return what a file holds."""
    variables = {}
    for name, about in opened.available_variables().items():
        found = opened.inquire_variable(name)
        steps = int(about["AvailableStepsCount"])
        shape = [int(side) for side in found.shape()] if about["Shape"] else []
        same = not shape or all(list(found.shape(step)) == shape for step in range(steps))
        variables[name] = {"shape": shape if same else None, "type": about["Type"], "steps": steps}
    attributes = {}
    for name, about in opened.available_attributes().items():
        if about["Type"] == "long double":  # openPMD writes positions so, and adios2 cannot read them with NumPy 2
            attributes[name] = [float(word) for word in about["Value"].strip("{} ").split(",")]
            continue
        value = opened.read_attribute(name)
        attributes[name] = value.tolist() if hasattr(value, "tolist") else value
    return {"variables": variables, "attributes": attributes}


def serve(out: BinaryIO, file: str, seconds: int) -> None:
    """Answer one question after another, until the input ends."""

    def say(told: dict[str, Any]) -> None:
        out.write(json.dumps(told).encode() + b"\n")
        out.flush()

    signal.alarm(seconds)
    sys.modules["torch"] = None  # type: ignore[assignment] # adios2 would load it, for seconds
    try:
        import adios2
    except ImportError:
        say({"missing": "adios2"})
        return
    try:
        opened = adios2.FileReader(file)
        say(told_of(opened))
    except Exception as error:
        say({"says": str(error)})
        return
    signal.alarm(0)
    for line in sys.stdin.buffer:
        asked = json.loads(line)
        signal.alarm(seconds)
        try:
            step = [asked["step"], 1]
            values = opened.read(asked["name"], start=asked["start"], count=asked["count"], step_selection=step)
        except Exception as error:
            say({"says": str(error)})
            continue
        finally:
            signal.alarm(0)
        content = values.tobytes()
        say({"dtype": values.dtype.str, "bytes": len(content)})
        out.write(content)
        out.flush()


if __name__ == "__main__":
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # ADIOS may write anything there
    serve(answers, sys.argv[1], int(sys.argv[2]))
