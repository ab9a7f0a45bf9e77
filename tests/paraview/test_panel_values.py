"""The types of what panels hold (svv/pv/panel_values.py) are those of the properties, in the real ParaView."""

from __future__ import annotations


def test_every_property_read_by_name_is_listed_with_its_type(inside) -> None:
    said = inside("""
from typing import get_args, get_origin, get_type_hints, Literal, Union
from types import UnionType
from dataclasses import is_dataclass
import svv.options.baking, svv.options.editing, svv.options.figures, svv.options.making, svv.options.splats
from svv.options.described import described
from svv.options.figures import VisionName
from svv.options.making import DeviceName, PresetName
from svv.pv import panel_values
from svv.pv.work import base

names = dict(vars(panel_values), VisionName=VisionName, DeviceName=DeviceName, PresetName=PresetName,
             vtkImplicitFunction=object, vtkDiscretizableColorTransferFunction=object, PVDataRepresentation=object)
listed = get_type_hints(panel_values.Values, None, names)
rows = {kind: get_type_hints(getattr(panel_values, kind), None, names) for kind in ("RegionRow", "ColourRow")}

def is_of(value, kind):
    origin = get_origin(kind)
    if kind is object or value is None:
        return True
    if origin is Literal:
        return value in get_args(kind)
    if origin in (Union, UnionType):
        return any(is_of(value, one) for one in get_args(kind))
    if origin is tuple:
        parts = get_args(kind)
        parts = parts[:1] * len(value) if parts[1:] == (...,) else parts
        return isinstance(value, tuple) and len(value) == len(parts) and all(map(is_of, value, parts))
    return isinstance(value, (int, float) if kind is float else kind) and (kind is bool) == isinstance(value, bool)

def every(cls):
    yield cls
    for one in cls.__subclasses__():
        yield from every(one)

options, switches = set(), set()
modules = svv.options.baking, svv.options.editing, svv.options.figures, svv.options.making, svv.options.splats
for module in modules:
    for kind in vars(module).values():
        if is_dataclass(kind) and isinstance(kind, type):
            shown = [f for f in described(kind) if f.property_name]
            options |= {f.property_name for f in shown}
            switches |= {f.setting.switch.name for f in shown if f.setting.switch}
seen, unlisted, wrong = set(), [], []
for cls in every(base.Filter):
    for name, default in cls.defaults.items():
        bare = name
        for kind, prefix in (("RegionRow", "Region"), ("ColourRow", "Colour")):
            if name.startswith(prefix) and name[len(prefix):len(prefix) + 1].isdigit():
                bare = name[len(prefix):].lstrip("0123456789")
                types = rows[kind]
                break
        else:
            types = listed
        seen.add(bare)
        if bare in types:
            if not is_of(default, types[bare]):
                wrong.append([cls.__name__, name, repr(default), str(types[bare])])
        elif bare not in options | switches:
            unlisted.append([cls.__name__, name])
said["filters"] = len(list(every(base.Filter)))
said["unlisted"], said["wrong"] = unlisted, wrong
said["of no panel"] = sorted({*listed, *rows["RegionRow"], *rows["ColourRow"]} - seen)
""")
    assert said["filters"] > 20
    # An option of figures has the name of a property that images have, and is read as an option.
    assert [wrong[:2] for wrong in said["wrong"]] == [["StyleRFFigure", "Frame"]]
    assert said["unlisted"] == []
    # Set beside the setters of other properties, or handed to the process that learns.
    assert said["of no panel"] == ["KeyOfViews", "ScalarsOnCells"]
