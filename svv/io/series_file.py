"""Files that list the time steps of a series: ParaView's ``.pvd`` and ``.series``."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

from svv.core.json_values import parsed
from svv.core.xml_values import parsed_xml
from svv.errors import BadInput

EXTENSIONS = (".pvd", ".series")


def read_series(path: Path) -> list[tuple[float, Path]]:
    """Return times and files that a ``.pvd`` or ``.series`` file lists, in order; raises BadInput if it is invalid."""
    try:
        text = path.read_bytes()
        if path.suffix.lower() == ".pvd":
            listed = [(set_.attrib["timestep"], set_.attrib["file"]) for set_ in parsed_xml(text).iter("DataSet")]
        else:
            listed = [(entry["time"], entry["name"]) for entry in parsed(text)["files"]]
        found = sorted((float(time), path.parent / str(name)) for time, name in listed)
    except OSError as error:
        raise BadInput(f"{path} cannot be read: {error.strerror}.") from error
    except (KeyError, TypeError, ValueError, UnicodeError) as error:
        raise BadInput(f"{path} is no list of time steps ({type(error).__name__}: {error}).") from error
    if not found:
        raise BadInput(f"{path} lists no time steps.")
    for (time, first), (other, second) in pairwise(found):
        if not time < other:
            raise BadInput(f"{path} gives {first.name} and {second.name} the same time, {time:g}.")
    return found
