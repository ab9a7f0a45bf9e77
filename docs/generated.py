"""Reference pages generated entirely from the code: commands, filters, presets, and where modules are."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import sys
import types
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Any, get_args

OPEN = "```{note}\nThis page is made from the code (`docs/generated.py`).\n```\n"


def write(folder: Path) -> None:
    """Write ``commands.md``, ``filters.md``, ``presets.md`` and ``layers.md`` into a folder; equal files stay."""
    pages = {"commands": commands, "filters": filters, "presets": presets, "layers": layers}
    for name, page in pages.items():
        path, text = folder / f"{name}.md", "\n".join(page()) + "\n"
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


# --- layers ---------------------------------------------------------------------------------------------------------

LAYERS = "cli pv job render train styles fields kernels dvr bricks io core options".split()
"""The layers from top to bottom."""

ROOT = Path(__file__).resolve().parents[1]
sys.path += [str(ROOT), str(ROOT / "bench")]  # so these pages can be made where svv-bench is not installed

FIRST = {
    "Where does a ray march, and what is composited?": "core/rays/marching.py core/rays/compositing.py",
    "What paints a stroke?": "train/paint/brushwork.py core/strokes/stroke_reference.py",
    "What happens on *Apply*?": "pv/filters/volume_filters.py pv/filters/engine.py",
    "How is a scene file read?": "io/scene_file.py fields/scene/scene_arrays.py",
    "How is a scene trained, stage by stage?": "train/training.py train/base/reconstruct.py train/palette/recolour.py",
    "Which settings are there?": "options/making.py train/run/config.py",
}
"""What newcomers look for, and the modules to open first."""


def layers() -> Iterator[str]:
    """Yield every folder with what lives there and the folders that it imports, so that arrows point down the page."""
    from tests import arrows

    modules = arrows.sources()
    found = arrows.arrows(modules)
    order = arrows.components(arrows.without({one: set(others) for one, others in found.items()}, arrows.LEFT))
    down = [one for (one,) in reversed(order) if not one.endswith("(facade)")]
    yield "# The layers of the code\n"
    yield OPEN
    yield "**Imports point down only.** A folder imports from folders below it on this page, and nothing else: never"
    yield "from one above, so never in a circle. Imports inside functions and modules that are named as text count"
    yield "(`tests/arrows.py` measures; `tests/test_layers.py` tests, also which layer may use which library).\n"
    left = ", ".join(f"`{_short(one)}` to `{_short(other)}`" for one, other in arrows.LEFT)
    yield f"Arrows that still point up: {left}. The facades `svv` and `svv.pv` hand on what lies anywhere below."
    yield "`plugin/` is ParaView's entry point. What measures all this is a distribution of its own in `bench/`;"
    yield "nothing in `svv` imports it.\n"
    yield "| Where to start | |\n|---|---|"
    for question, names in FIRST.items():
        yield f"| {question} | {', '.join(f'`svv/{name}`' for name in names.split())} |"
    for layer in ("svv_bench", *(f"svv.{name}" for name in LAYERS), "svv"):
        own = [one for one in down if one == layer or (layer != "svv" and one.startswith(f"{layer}."))]
        yield f"\n## `{_short(layer)}/`\n\n| folder | what lives there | imports |\n|---|---|---|"
        for folder in own:
            others = [other for other in down if other in found[folder] and (folder, other) not in arrows.LEFT]
            near = [_short(other) for other in others if other in own]
            far = list(dict.fromkeys(_short(other).split("/")[0] for other in others if other not in own))
            text = _told_of(arrows.PACKAGES[folder.split(".")[0]] / folder.replace(".", "/"))
            yield f"| `{_short(folder)}` | {text} | {', '.join(f'`{name}`' for name in (*near, *far))} |"


def _short(folder: str) -> str:
    """Return a folder's path in its package: 'train/run' for 'svv.train.run'."""
    return folder.removeprefix("svv.").replace(".", "/")


def _told_of(folder: Path) -> str:
    """Return the first sentence of what a folder says of itself."""
    if folder.name == "svv":
        return "What everything uses: errors, the environment, progress, memory and time."
    text = (ast.get_docstring(ast.parse((folder / "__init__.py").read_text("utf-8"))) or "").split("\n\n")[0]
    return re.sub(r":\w+:`~?([\w.]+)`", r"`\1`", " ".join(text.split())).replace("``", "`")


# --- commands -------------------------------------------------------------------------------------------------------


def commands() -> Iterator[str]:
    """Yield every command with its arguments, options and examples."""
    from svv.cli import paraview
    from svv.cli.app import COMMANDS, GROUPS, command_of

    yield "# Commands\n"
    yield OPEN
    yield "`svv COMMAND --help` says the same in a terminal. How commands end, what they read and what they resume: "
    yield "[conventions](command-line.md).\n"
    for name in COMMANDS:
        if name not in GROUPS:  # they follow at the end
            yield from _command(f"svv {name}", *command_of(name))
    for function in (paraview.paraview, paraview.pvpython, paraview.pvbatch, paraview.pvserver):
        yield from _command(f"svv {function.__name__}", function, ())
    for group, module in (*((name, f"svv.cli.{name}") for name in GROUPS), ("bench", "svv_bench.cli")):
        if group == "bench":
            yield "`svv bench` is a distribution of its own: `pip install ./bench` in a checkout; `make` installs it."
            yield "`svv bench --results FILE.csv COMMAND ...` appends what a command measures, one row a figure.\n"
        for name, (function, examples) in importlib.import_module(module).COMMANDS.items():
            yield from _command(f"svv {group} {name}", function, examples)


def _command(name: str, function: Any, examples: Any) -> Iterator[str]:
    yield f"## `{name}`\n"
    yield inspect.cleandoc(function.__doc__ or "") + "\n"
    yield "| | | default |\n|---|---|---|"
    for parameter in inspect.signature(function, eval_str=True).parameters.values():
        kind, *notes = get_args(parameter.annotation)
        (info,) = (note for note in notes if hasattr(note, "help"))
        # In an annotated option, `default` holds the first name if the parameter has a default of its own.
        given = [d for d in (info.default, *(info.param_decls or ())) if isinstance(d, str) and d.startswith("-")]
        option = "default_factory" in vars(info) and "prompt" in vars(info)
        names = ", ".join(f"`{d}`" for d in given) or (f"`--{parameter.name.replace('_', '-')}`" if option else "")
        value = info.metavar or _choices(kind) or ("" if option else parameter.name.upper())
        default = parameter.default
        if default is inspect.Parameter.empty:
            shown = "required"
        else:
            shown = (
                ""
                if default is None or default is False or default == ()
                else f"`{getattr(default, 'value', default)}`"
            )
        yield f"| {names} {_cell(value)} | {_cell(info.help or '')} | {shown} |"
    yield ""
    if examples:
        yield "```sh"
        yield from examples
        yield "```\n"


def _choices(kind: Any) -> str:
    """Return the values of an enumeration, which may be optional, separated by bars; empty for other types."""
    for each in (kind, *get_args(kind)):
        if isinstance(each, type) and issubclass(each, Enum):
            return "|".join(str(member.value) for member in each)
    return ""


def _cell(text: str) -> str:
    return " ".join(text.replace("|", "\\|").replace("<", "&lt;").split())


# --- filters --------------------------------------------------------------------------------------------------------


def filters() -> Iterator[str]:
    """Yield every filter and reader with its properties, in the order of its panel."""
    found = _decorated()
    yield "# Filters and readers in ParaView\n"
    yield OPEN
    yield "In scripts a property has the name of its label without spaces. What the filters are for: "
    yield "[ParaView](../how-to/paraview.md).\n"
    for cls in found:
        kind, label = cls.proxy
        yield f"## {label}\n"
        yield f"*{kind}*, in scripts `{cls.__name__}`. {' '.join((cls.__doc__ or '').split())}\n"
        yield "| property | | default |\n|---|---|---|"
        for element in ElementTree.fromstring(f"<all>{''.join(reversed(cls.xml))}</all>"):
            label = element.get("label") or element.get("name") or ""
            if re.match(r"(Region [1-9]|Colour [1-9]) ", label):
                continue  # the same as the first, whose number is shown as K
            label = re.sub(r"^(Region|Colour) 0 ", r"\1 K ", label)
            shown = element.get("panel_visibility", "default") != "never"
            if not element.tag.endswith("Property") or not shown or element.get("name") in (None, "Input"):
                continue
            text = re.sub(r"<br/><img [^>]*>", "", element.findtext("Documentation") or "")  # a picture in the tooltip
            more = " *(advanced)*" if element.get("panel_visibility") == "advanced" else ""
            default, entries = element.get("default_values", ""), element.findall(".//Entry")
            if entries:
                default = entries[int(default)].get("text", "")
            elif element.find("BooleanDomain") is not None:
                default = "on" if default == "1" else "off"
            yield f"| {label}{more} | {_cell(text)} | {_default(default)} |"
        yield ""


def _default(text: str) -> str:
    return "" if text in ("", "None") else f"`{text}`"


@cache
def _decorated() -> list[Any]:
    """Return the classes of the plugin without ParaView: stand-ins for its decorators record what they are given."""
    found: list[Any] = []

    def note(xml: str) -> Any:
        def decorate(cls: Any) -> Any:
            cls.xml = [*cls.__dict__.get("xml", []), xml]
            return cls

        return decorate

    def proxy(kind: str) -> Any:
        def named(name: str = "", label: str = "", group: str = "filters", **_: Any) -> Any:
            def decorate(cls: Any) -> Any:
                cls.proxy = kind, label or name
                if group == "filters":  # others are for scripts only
                    found.append(cls)
                return cls

            return decorate

        return named

    ignore = lambda *_, **__: lambda cls: cls  # noqa: E731
    fake = types.ModuleType("paraview.util.vtkAlgorithm")
    fake.VTKPythonAlgorithmBase = type("VTKPythonAlgorithmBase", (), {})  # type: ignore[attr-defined]
    some = types.SimpleNamespace
    fake.smproperty = some(xml=note, input=ignore, doublevector=ignore)  # type: ignore[attr-defined]
    fake.smdomain = some(xml=ignore, datatype=ignore)  # type: ignore[attr-defined]
    fake.smhint = some(xml=ignore)  # type: ignore[attr-defined]
    fake.smproxy = some(filter=proxy("Filter"), reader=proxy("Reader"), writer=proxy("Writer"))  # type: ignore[attr-defined]
    names = {"paraview": types.ModuleType("paraview"), "paraview.util": types.ModuleType("paraview.util"),
             "paraview.util.vtkAlgorithm": fake}  # fmt: skip
    sys.modules.update(names)
    try:
        for module in ("volume_filters", "edit_filters", "figure_filter", "look_filter", "scene_filters", "readers"):
            importlib.import_module(f"svv.pv.filters.{module}")
    finally:
        for name in names:
            del sys.modules[name]
    return found


# --- presets --------------------------------------------------------------------------------------------------------


def presets() -> Iterator[str]:
    """Yield every setting of every stage with its value in each preset."""
    from svv.fields.radiance import networks
    from svv.options.described import described
    from svv.train.run import config

    yield "# Presets and settings\n"
    yield OPEN
    yield "A preset is a name for the settings of all stages: `--preset`, *Preset* in the panels, the argument of"
    yield "`svv.train_scene` and `svv.stylize_scene`. To change a single setting, write `--set` and its name:"
    yield "`--set reconstruct.iterations=4000`, *Settings* in the panels, or in Python"
    yield '`svv.train_scene(views, "fast", change=("reconstruct.iterations=4000",))`.\n'
    for title, field, cls in (
        ("Field", "field", networks.FieldSettings),
        ("Stage 1: density and base colours", "reconstruct", config.ReconstructSettings),
        ("Stage 2: the palette network", "recolour", config.RecolourSettings),
        ("Stage 3: paint that is laid", "stylize", config.StylizeSettings),
        ("Stage 3: paint that is learned", "stylize", config.MatchSettings),
    ):
        # A preset lays paint or learns it: its settings are of one class or the other.
        exact = field == "stylize"
        names = [n for n, p in config.PRESETS.items() if not exact or type(getattr(p, field)) is cls]
        yield f"## {title}\n"
        yield f"`{cls.__name__}`\n"
        yield f"| setting | | {' | '.join(names)} |\n|---|---|{'---|' * len(names)}"
        for setting in described(cls):
            values = [getattr(getattr(config.PRESETS[name], field), setting.name) for name in names]
            shown = " | ".join(_value(v) for v in values)
            yield f"| `{field}.{setting.name}` | {_cell(setting.sentence)} | {shown} |"
        yield ""


def _value(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:g}"
    return "none" if value is None else " ".join(map(str, value)) if isinstance(value, tuple) else str(value)
