"""Reference pages generated entirely from the code: commands, filters, presets, and where modules are."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import sys
import types
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Iterable, Iterator
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Any, get_args

OPEN = "```{note}\nThis page is made from the code (`docs/generated.py`).\n```\n"


def write(folder: Path) -> None:
    """Write `commands.md`, `filters.md` and `presets.md` into a folder, and `layers.md` into `design` beside it.

    Equal files stay.
    """
    pages = {"commands": commands, "filters": filters, "presets": presets, "../design/layers": layers}
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
    "What happens on *Apply*?": "pv/filters/volume_filters.py pv/work/engine.py",
    "How is a scene file read?": "io/scene_file.py fields/scene/scene_arrays.py",
    "How is a scene trained, stage by stage?": "train/training.py train/base/reconstruct.py train/palette/recolour.py",
    "Which settings are there?": "options/making.py train/run/config.py",
}
"""What newcomers look for, and the modules to open first."""


def layers() -> Iterator[str]:
    """Yield every layer with those that it imports, and its folders, so that all arrows point down the page."""
    import svv
    from tests import arrows

    modules = arrows.sources()
    found = arrows.arrows(modules)
    order = arrows.components({one: set(others) for one, others in found.items()})
    down = [one for (one,) in reversed(order) if not one.endswith("(facade)")]
    yield "# The layers of the code\n"
    yield OPEN
    yield "**Imports point down only.** A folder imports only from folders below it on this page, so never in a circle;"
    yield "imports inside functions and modules that are named as text count (`tests/arrows.py` measures,"
    yield "`tests/test_layers.py` tests, also which layer may use which library). Any may import `svv`, the last."
    handed = {module.split(".")[1] for module in svv.PUBLIC.values()} & set(LAYERS)
    yield "The facades hand on what lies below:"
    yield f"`svv` names of {', '.join(f'`{name}`' for name in sorted(handed))};"
    yield "`svv.pv` of its folders; `svv.__main__` starts `cli`. `plugin/` is ParaView's entry point;"
    yield "`bench/paraview_scripts` imports `pv`.\n"
    yield "| Where to start | |\n|---|---|"
    for question, names in FIRST.items():
        yield f"| {question} | {', '.join(f'`svv/{name}`' for name in names.split())} |"
    for layer in ("svv_bench", *(f"svv.{name}" for name in LAYERS), "svv"):
        own = [one for one in down if one == layer or (layer != "svv" and one.startswith(f"{layer}."))]
        yield f"\n## `{_path_in(layer)}/`\n"
        others = {other for folder in own for other in found[folder]}.difference(own, ["svv"])
        if far := dict.fromkeys(_path_in(other).split("/")[0] for other in down if other in others):
            yield f"Imports {', '.join(f'`{name}`' for name in far)}.\n"
        for folder in own:
            near = ", ".join(f"`{_path_in(other)}`" for other in down if other in found[folder] and other in own)
            text = _told_of(arrows.PACKAGES[folder.split(".")[0]] / folder.replace(".", "/"))
            yield f"- `{_path_in(folder)}`: {text}{f' Imports {near}.' if near else ''}"


def _path_in(folder: str) -> str:
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
    """Yield every command with its arguments, options and examples; what several commands share is described once."""
    from svv.cli import paraview
    from svv.cli.app import COMMANDS, GROUPS, command_of

    every: dict[str, tuple[Any, Any]] = {f"svv {n}": command_of(n) for n in COMMANDS if n not in GROUPS}
    for function in (paraview.paraview, paraview.pvpython, paraview.pvbatch, paraview.pvserver):
        every[f"svv {function.__name__}"] = function, ()
    for group in GROUPS:
        for name, found in importlib.import_module(f"svv.cli.{group}").COMMANDS.items():
            every[f"svv {group} {name}"] = found
    measuring = importlib.import_module("svv_bench.cli").COMMANDS
    rows = {name: list(_options(function)) for name, (function, _) in every.items()}
    shared = _shared(rows.values())
    yield "# Commands\n"
    yield OPEN
    yield "`svv COMMAND --help` has more examples. How commands end: [conventions](command-line.md). Defaults are in"
    yield "brackets; `...` follows what may be repeated.\n"
    both = every | {f"svv bench {name}": found for name, found in measuring.items()}
    resuming = [name.removeprefix("svv ") for name, (function, _) in both.items() if RESUMES.search(_text(function))]
    yield f"After Ctrl-C, the same command resumes: {', '.join(resuming)}.\n"
    yield from _described_once(shared, "options", "command")
    for name, (function, examples) in every.items():
        yield f"## `{name}`\n"
        yield re.sub(r" *\n\s*\n", "\n\n", RESUMES.sub("", _text(function))).strip() + "\n"
        yield from _rows(rows[name], shared, "options")
        if examples:
            yield "```sh"
            yield from examples[:2]  # the help has all
            yield "```\n"
    yield "## `svv bench`\n"
    yield "A distribution of its own: `pip install ./bench` in a checkout (`make` does). `svv bench COMMAND --help`"
    yield "lists the options; `svv bench --results FILE.csv COMMAND ...` appends the figures to a file.\n"
    for name, (function, _) in measuring.items():
        yield f"- `{name}`: {' '.join(_text(function).split(chr(10) * 2)[0].split())}"
    yield "\n```sh"
    yield from (examples[0] for _, examples in measuring.values())
    yield "```"


RESUMES = re.compile(
    r"After\s+Ctrl-C,\s+the\s+same\s+command\s+resumes(\.|; finished\s+stages\s+are\s+not\s+repeated\.)"
)

Row = tuple[str, str, str, bool]
"""Name (an option with what it takes), explanation, default, and whether it is among a panel's advanced properties."""


def _text(function: Any) -> str:
    return inspect.cleandoc(function.__doc__ or "")


def _given(default: str) -> str:
    return f" ({default})" if default else ""


def _first(name: str) -> str:
    """Return an option's first name without what it takes."""
    return f"`{name.split('`')[1]}`" if name.startswith("`") else name


def _shared(tables: Iterable[Iterable[Row]]) -> dict[str, tuple[str, str, str]]:
    """Return what stands in several tables with the same words, by short name: name, explanation, commonest default."""
    defaults: dict[tuple[str, str], Counter[str]] = {}
    for rows in tables:
        for name, text, default, _ in rows:
            defaults.setdefault((name, text), Counter())[default] += 1
    found: dict[str, tuple[str, str, str]] = {}
    for (name, text), times in sorted(defaults.items(), key=lambda one: one[1].total()):  # the commonest comes last
        if times.total() > 1:
            found[_first(name)] = name, text, times.most_common(1)[0][0]
    return {_first(name): found[_first(name)] for name, _ in defaults if _first(name) in found}


def _described_once(shared: dict[str, tuple[str, str, str]], what: str, who: str) -> Iterator[str]:
    yield f"## Shared {what}\n"
    yield f"Each {who} names those that it has, with its default where it differs. *A to B*: all from A to B here.\n"
    for name, text, default in shared.values():
        yield f"- {name}{_given(default)}: {text}"
    yield ""


def _rows(rows: Iterable[Row], shared: dict[str, tuple[str, str, str]], what: str) -> Iterator[str]:
    """Yield a list of what only this command or filter has, and the names of what it shares with others."""
    others: dict[str, tuple[str, bool]] = {}
    for name, text, default, advanced in rows:
        known = shared.get(_first(name), ("", "", ""))
        if known[:2] == (name, text):
            others[_first(name)] = "" if default == known[2] else _given(default or "none"), advanced
        else:
            yield f"- {f'*{name}*' if advanced else name}{_given(default)}: {text}"
    if others:
        yield f"\n[Shared](#shared-{what}): {', '.join(_runs(list(shared), others))}."
    yield ""


def _runs(order: list[str], others: dict[str, tuple[str, bool]]) -> Iterator[str]:
    """Yield names with what is given of them, in an order; 'first to last' where at least four follow each other."""
    places = [place for place, name in enumerate(order) if name in others]
    # Neighbours in the order, both with the shared default, and both advanced or neither, belong to one run.
    same = lambda a, b: b == a + 1 and others[order[a]] == others[order[b]] and not others[order[a]][0]  # noqa: E731
    runs: list[list[int]] = []
    for place in places:
        if runs and same(runs[-1][-1], place):
            runs[-1].append(place)
        else:
            runs.append([place])
    for run in runs:
        shown = [f"*{order[p]}*{others[order[p]][0]}" if others[order[p]][1] else order[p] + others[order[p]][0]
                 for p in run]  # fmt: skip
        yield from [f"{shown[0]} to {shown[-1]}"] if len(run) > 3 else shown


def _options(function: Any) -> Iterator[Row]:
    """Yield a command's arguments and options."""
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
        text, again = _cell(info.help or ""), " May be repeated."
        name = f"{names} {_cell(value)}".strip() + " ..." * (again in text)
        yield name, text.replace(again, ""), shown, False


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
    rows = [list(_properties(cls)) for cls in found]
    shared = _shared(rows)
    yield "# Filters and readers in ParaView\n"
    yield OPEN
    yield "In scripts a property has the name of its label without spaces. What the filters are for: "
    yield "[ParaView](../how-to/paraview.md).\n"
    yield "Defaults are in brackets, advanced properties in italics. K is the number of a region or colour, from 0.\n"
    yield from _described_once(shared, "properties", "filter")
    for cls, properties in zip(found, rows):
        kind, label = cls.proxy
        yield f"## {label}\n"
        yield f"*{kind}*, in scripts `{cls.__name__}`. {' '.join((cls.__doc__ or '').split())}\n"
        yield from _rows(properties, shared, "properties")


def _properties(cls: Any) -> Iterator[Row]:
    """Yield the properties of a filter, in the order of its panel."""
    for element in ElementTree.fromstring(f"<all>{''.join(reversed(cls.xml))}</all>"):
        label = element.get("label") or element.get("name") or ""
        if re.match(r"(Region|Colour) [1-9]\d* ", label):
            continue  # the same as the first, whose number is shown as K
        label = re.sub(r"^(Region|Colour) 0 ", r"\1 K ", label)
        shown = element.get("panel_visibility", "default") != "never"
        if not element.tag.endswith("Property") or not shown or element.get("name") in (None, "Input"):
            continue
        text = re.sub(r"<br/><img [^>]*>", "", element.findtext("Documentation") or "")  # a picture in the tooltip
        default, entries = element.get("default_values", ""), element.findall(".//Entry")
        if entries:
            default = entries[int(default)].get("text", "")
        elif element.find("BooleanDomain") is not None:
            default = "on" if default == "1" else "off"
        yield label, _cell(text), _default(default), element.get("panel_visibility") == "advanced"


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
    told: dict[str, str] = {}  # what a stage says of a setting that has the same words in a later one
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
        rows = {s: [_value(getattr(getattr(config.PRESETS[n], field), s.name)) for n in names] for s in described(cls)}
        if any(len(set(values)) > 1 for values in rows.values()):
            yield f"| setting | | {' | '.join(names)} |\n|---|---|{'---|' * len(names)}"
            for setting, values in rows.items():
                if len(set(values)) > 1:
                    text = told.setdefault(setting.sentence, _cell(setting.sentence))
                    told[setting.sentence] = f"As `{field}.{setting.name}`."
                    yield f"| `{field}.{setting.name}` | {text} | {' | '.join(values)} |"
            yield "\nThe same in all presets:\n"
        for setting, values in rows.items():
            if len(set(values)) == 1:
                text = told.setdefault(setting.sentence, _cell(setting.sentence))
                told[setting.sentence] = f"As `{field}.{setting.name}`."
                yield f"- `{field}.{setting.name}`{_given(values[0])}: {text}"
        yield ""


def _value(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:g}"
    return "none" if value is None else " ".join(map(str, value)) if isinstance(value, tuple) else str(value)
