"""The properties of the StyleRF filters, as ParaView's panel shows them.

Before 5.13, ParaView's own decorators sort properties by name, so :func:`panel` passes a class's list on as one piece
of XML, and gives the class the setters that it names: they store a changed value, then call ``Modified()``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol, TypeVar, cast
from xml.sax.saxutils import escape, quoteattr

from svv.pv.panel.function_edits import marker, observe_for, watch
from svv.pv.panel.tooltips import with_picture
from svv.pv.panel_values import Values, by_name, label_of
from svv.pv.paraview_types import Observed

if TYPE_CHECKING:
    from vtkmodules.vtkRenderingCore import vtkDiscretizableColorTransferFunction

SHAPES = ("Plane", "Box", "Sphere", "Cylinder")
"""ParaView's names of the surfaces between which :func:`shape` chooses."""

CELLS = 1
"""VTK's number of arrays that belong to cells."""

Class = TypeVar("Class", bound=type)


class Owner(Protocol):
    """The filter to which properties belong: it holds their values, by name."""

    values: Values
    shows_edits: bool

    def Modified(self) -> None: ...


@dataclass(frozen=True)
class Property:
    """A property: its XML, its default in the filter's ``values``, and its setters by method name."""

    name: str
    xml: str
    default: object
    setters: dict[str, Callable[..., None]]


def _element(
    kind: str, name: str, help: str, attributes: str, inside: str = "", advanced: bool = False, hints: str = ""
) -> str:
    level = "advanced" if advanced else "default"
    hints = f"<Hints>{hints}</Hints>" if hints else ""
    return (
        f"<{kind} name={quoteattr(name)} label={quoteattr(label_of(name))} "
        f"panel_visibility={quoteattr(level)} {attributes}>"
        f"{inside}<Documentation>{escape(help)}</Documentation>{hints}</{kind}>"
    )


def _single(
    kind: str, name: str, default: str, help: str, inside: str = "", advanced: bool = False, hints: str = "",
    more: str = "",
) -> str:  # fmt: skip
    """Return the XML of a property with one element."""
    attributes = f'command="Set{name}" number_of_elements="1" default_values={quoteattr(default)}{more}'
    return _element(f"{kind}VectorProperty", name, help, attributes, inside, advanced, hints)


def hidden(
    kind: str, name: str, help: str, setter: Callable[..., None], default: str = "", more: str = "", inside: str = ""
) -> Property:
    """Return a property that no panel shows, for client code: a text, or a switch if it has a default."""
    xml = (
        f'<{kind}VectorProperty name="{name}" command="Set{name}" number_of_elements="1" default_values="{default}" '
        f'panel_visibility="never"{more}>{inside}<Documentation>{escape(help)}</Documentation></{kind}VectorProperty>'
    )
    return Property(name, xml, False if default else "", {f"Set{name}": setter})


def stored(name: str, convert: Callable[..., object]) -> Callable[..., None]:
    """Return a setter that converts what it is given, and marks the filter as modified if that is another value."""

    def setter(self: Owner, *given: object) -> None:
        value, held = convert(*given), by_name(self.values)
        if held[name] != value:
            held[name] = value
            self.Modified()

    return setter


def _range(kind: str, low: float | None, high: float | None) -> str:
    ends = "".join(f' {key}="{value:g}"' for key, value in (("min", low), ("max", high)) if value is not None)
    return f'<{kind} name="range"{ends}/>' if ends else ""


def integer(
    name: str, default: int, help: str, low: int | None = None, high: int | None = None,
    advanced: bool = False,
) -> Property:  # fmt: skip
    """Return a whole-number property; a slider if both ``low`` and ``high`` are given."""
    xml = _single("Int", name, str(default), help, _range("IntRangeDomain", low, high), advanced)
    return Property(name, xml, default, {f"Set{name}": stored(name, int)})


def number(
    name: str, default: float, help: str, low: float | None = None, high: float | None = None,
    advanced: bool = False,
) -> Property:  # fmt: skip
    """Return a number property; a slider if both ``low`` and ``high`` are given."""
    xml = _single("Double", name, f"{default:g}", help, _range("DoubleRangeDomain", low, high), advanced)
    return Property(name, xml, float(default), {f"Set{name}": stored(name, float)})


def numbers(
    name: str, default: Sequence[float], help: str, widget: str | None = None, advanced: bool = False
) -> Property:
    """Return a property of several numbers, such as a colour (``widget="color_selector"``)."""
    shown = f' panel_widget="{widget}"' if widget else ""
    values = " ".join(f"{value:g}" for value in default)
    xml = _element(
        "DoubleVectorProperty", name, help,
        f'command="Set{name}" number_of_elements="{len(default)}" default_values="{values}"{shown}',
        '<DoubleRangeDomain name="range"/>', advanced,
    )  # fmt: skip
    convert = lambda *given: tuple(float(value) for value in given)  # noqa: E731
    return Property(name, xml, tuple(map(float, default)), {f"Set{name}": stored(name, convert)})


def switch(name: str, default: bool, help: str, advanced: bool = False) -> Property:
    """Return a check box."""
    xml = _single("Int", name, str(int(default)), help, '<BooleanDomain name="bool"/>', advanced)
    return Property(name, xml, default, {f"Set{name}": stored(name, bool)})


def client_switch(name: str, help: str) -> Property:
    """Return a check box for client code, off by default; the filter's output does not depend on it."""

    def setter(self: Owner, value: int) -> None:
        by_name(self.values)[name] = bool(value)

    return replace(switch(name, False, help), setters={f"Set{name}": setter})


def choice(name: str, entries: Sequence[str], default: str, help: str, advanced: bool = False) -> Property:
    """Return a choice between words; ``values`` holds the word."""
    inside = "".join(f'<Entry value="{k}" text={quoteattr(entry)}/>' for k, entry in enumerate(entries))
    domain = f'<EnumerationDomain name="enum">{inside}</EnumerationDomain>'
    xml = _single("Int", name, str(list(entries).index(default)), help, domain, advanced)
    return Property(name, xml, default, {f"Set{name}": stored(name, lambda k: entries[int(k)])})


def text(name: str, help: str, default: str = "", advanced: bool = False) -> Property:
    """Return a line of text."""
    xml = _single("String", name, default, help, "", advanced)
    return Property(name, xml, default, {f"Set{name}": stored(name, lambda value: value or "")})


def file(name: str, extensions: str, what: str, help: str, save: bool = False, advanced: bool = False) -> Property:
    """Return a file on the server, or a folder if ``extensions`` is empty."""
    domain = '<FileListDomain name="files"/>'
    if extensions:
        hints = f"<FileChooser extensions={quoteattr(extensions)} file_description={quoteattr(what)}/>"
        hints += "<AcceptAnyFile/>" if save else ""  # else the dialog offers only files that exist
    else:
        hints = "<UseDirectoryName/>"
    xml = _single("String", name, "", help, domain, advanced, hints, ' animateable="0"')
    return Property(name, xml, "", {f"Set{name}": stored(name, lambda value: value or "")})


def files(name: str, extensions: str, what: str, help: str) -> Property:
    """Return a list of files on the server."""
    hints = f"<FileChooser extensions={quoteattr(extensions)} file_description={quoteattr(what)}/>"
    xml = _element(
        "StringVectorProperty", name, help,
        f'command="Add{name}" clean_command="Clear{name}" repeat_command="1" number_of_elements_per_command="1" '
        f'number_of_elements="0" animateable="0"',
        '<FileListDomain name="files"/>', False, hints,
    )  # fmt: skip

    def add(self: Owner, value: str) -> None:
        if value:
            by_name(self.values)[name] = (*cast("tuple[str, ...]", by_name(self.values)[name]), value)
            self.Modified()

    def clear(self: Owner) -> None:
        by_name(self.values)[name] = ()
        self.Modified()

    return Property(name, xml, (), {f"Add{name}": add, f"Clear{name}": clear})


def button(name: str, help: str, command: str = "") -> Property:
    """Return a button that calls the filter's method ``command``, by default that of the same name."""
    xml = _element("Property", name, help, f'command="{command or name}" panel_widget="command_button"')
    return Property(name, xml, None, {})


def status() -> Property:
    """Return the status, which shows all that ``GetStatus`` returns; a line edit would show the end of a long text."""
    xml = hidden_text("Status", "GetStatus", "What the filter last did, or why it failed.").xml
    # ParaView made this widget for expressions, hence the row of greyed buttons below it.
    hints = '<Hints><Widget type="one_liner_wrapped"/></Hints></StringVectorProperty>'
    xml = xml.replace("never", "default").replace("</StringVectorProperty>", hints)
    return Property("Status", xml, None, {})


def shown_view() -> Sequence[Property]:
    """Return the properties that choose the view to show; the filter's ``GetViewNumbers`` returns the range."""
    ends = (
        '<IntVectorProperty name="ViewNumbers" command="GetViewNumbers" information_only="1" number_of_elements="2" '
        'default_values="0 0" panel_visibility="never"><SimpleIntInformationHelper/>'
        "<Documentation>Numbers of the first and the last view.</Documentation></IntVectorProperty>"
    )
    xml = _element(
        "IntVectorProperty", "ShownView", "Number of the view to show, from 0.",
        'command="SetShownView" number_of_elements="1" default_values="0"',
        '<IntRangeDomain name="range"><RequiredProperties><Property name="ViewNumbers" function="RangeInfo"/>'
        "</RequiredProperties></IntRangeDomain>",
    )  # fmt: skip
    shown = Property("ShownView", xml, 0, {"SetShownView": stored("ShownView", int)})
    return [Property("ViewNumbers", ends, None, {}), shown]


def scalars() -> Property:
    """Return the property that chooses a point or cell array of the input."""
    xml = (
        '<StringVectorProperty name="Scalars" command="SetScalars" number_of_elements="5" element_types="0 0 0 0 2" '
        'animateable="0" label="Scalars"><ArrayListDomain name="array_list" attribute_type="Scalars" '
        'input_domain_name="input_array"><RequiredProperties><Property name="Input" function="Input"/>'
        "</RequiredProperties></ArrayListDomain><Documentation>The array that the volume rendering shows; one number "
        "per voxel.</Documentation></StringVectorProperty>"
    )

    def setter(self: Owner, index: int, port: int, connection: int, belongs_to: int, array: str | None) -> None:
        chosen = array or "", bool(array) and int(belongs_to) == CELLS
        if chosen != (self.values["Scalars"], self.values.get("ScalarsOnCells", False)):
            self.values["Scalars"], self.values["ScalarsOnCells"] = chosen
            self.Modified()

    return Property("Scalars", xml, "", {"SetScalars": setter})


def capture_reports() -> list[Property]:
    """Return the properties with which the client says what it could not take over of how the volume is shown."""
    helps = {
        "Refusal": "Why the volume cannot be drawn as it is shown; empty if it can.",
        "Notice": "How it is drawn otherwise than it is shown; empty if it is not.",
        "DefaultColours": "The colours that ParaView gives an array by itself: position from 0 to 1, red, green, blue.",
    }
    return [hidden("String", name, help, stored(name, lambda value: value or "")) for name, help in helps.items()]


def transfer_function() -> Property:
    """Return the property for colours and opacities: ParaView's colour transfer function with its opacity function."""
    xml = (
        '<ProxyProperty name="TransferFunction" label="Transfer Function" command="SetTransferFunction" '
        'panel_widget="proxy_editor" null_on_empty="1">'
        '<ProxyGroupDomain name="groups"><Group name="lookup_tables"/></ProxyGroupDomain>'
        "<Documentation>Colours and opacities of the volume rendering to learn, taken from the volume as the active "
        "view shows it when the filter is created; the Color Map Editor edits the same transfer function."
        "</Documentation></ProxyProperty>"
    )

    def setter(self: Owner, table: vtkDiscretizableColorTransferFunction | None) -> None:
        if self.values["TransferFunction"] is not table:
            self.values["TransferFunction"] = table
            watch(self, table)
            self.Modified()

    return Property("TransferFunction", xml, None, {"SetTransferFunction": setter})


def shape(name: str, help: str) -> Property:
    """Return the property for a surface with handles in the view, as Clip has it: a plane, box, sphere or cylinder."""
    kinds = "".join(f'<Proxy group="implicit_functions" name="{kind}"/>' for kind in SHAPES)
    xml = (
        f'<ProxyProperty name="{name}" label="{label_of(name)}" command="Set{name}">'
        f'<ProxyListDomain name="proxy_list">{kinds}</ProxyListDomain>'
        f"<Documentation>{escape(help)}</Documentation></ProxyProperty>"
    )

    def setter(self: Owner, function: Observed | None) -> None:
        if by_name(self.values)[name] is not function:
            by_name(self.values)[name] = function
            self.Modified()
            if function is not None:
                observe_for(self, function, marker(self))

    return Property(name, xml, None, {f"Set{name}": setter})


def display() -> Property:
    """Return the property for a display of data in a view."""
    xml = '<ProxyProperty name="Display" command="SetDisplay" null_on_empty="1"/>'
    return Property("Display", xml, None, {"SetDisplay": stored("Display", lambda shown: shown)})


def cached_names_property() -> list[Property]:
    """Return the property with the names of kept results, so that a saved state finds them; it starts no work."""
    xml = _single(
        "String", "KeptAs", "", "Names under which the filter keeps its results, so that a saved state finds "
        "them; filled in by the filter. If this is empty, missing results are made without waiting for a button.",
        advanced=True, more=' animateable="0"',
    )  # fmt: skip

    def setter(self: Owner, value: str) -> None:
        self.values["KeptAs"] = value or ""

    current = hidden_text("Kept", "GetKept", "Names under which the results are kept now.")
    return [Property("KeptAs", xml, "", {"SetKeptAs": setter}), current]


def moving() -> Property:
    """Return the property with which the client says that the camera moves, so that the image is made in a hurry."""
    return hidden(
        "Int", "Moving", "Whether the image is made in a hurry, with fewer samples, because the camera moves.",
        stored("Moving", bool), "0", ' state_ignored="1"', '<BooleanDomain name="bool"/>',
    )  # fmt: skip


def picked() -> list[Property]:
    """Return the properties by which the client asks what a pixel shows (:mod:`svv.pv.client.part_picking`)."""
    setter = lambda self, value: self.pick(value or "")  # noqa: E731
    pick = hidden("String", "Pick", "Camera and pixel of the last click, as JSON.", setter, "", ' state_ignored="1"')
    return [
        pick,
        hidden_text("Picked", "GetPicked", "The point in space that is visible there; empty if there is none."),
    ]


def hidden_text(name: str, command: str, help: str) -> Property:
    """Return a text that the filter's method ``command`` gives to client code; no panel shows it."""
    xml = (
        f'<StringVectorProperty name={quoteattr(name)} command={quoteattr(command)} information_only="1" '
        'number_of_elements="1" default_values="None" panel_visibility="never">'
        f"<Documentation>{escape(help)}</Documentation></StringVectorProperty>"
    )
    return Property(name, xml, None, {})


def shown_where(chosen: str, value: int, properties: Sequence[Property]) -> list[Property]:
    """Return the properties such that the panel shows them only while the property ``chosen`` has this value."""
    hint = (
        f'<Hints><PropertyWidgetDecorator type="GenericDecorator" mode="visibility" property={quoteattr(chosen)} '
        f'value="{value}"/></Hints>'
    )
    return [replace(p, xml=p.xml.replace("</Documentation>", f"</Documentation>{hint}")) for p in properties]


def group(label: str, properties: Sequence[Property]) -> Sequence[Property]:
    """Return the properties under a common heading."""
    inside = "".join(f"<Property name={quoteattr(p.name)}/>" for p in properties)
    xml = f"<PropertyGroup label={quoteattr(label)}>{inside}</PropertyGroup>"
    return [*properties, Property("", xml, None, {})]


def panel(*properties: Property) -> Callable[[Class], Class]:
    """Return a decorator that gives a filter's class these properties, in this order."""

    def decorate(cls: Class) -> Class:
        from paraview.util.vtkAlgorithm import smproperty

        plain = getattr(cls, "_pv_original_func", cls)  # ParaView's decorators do not return a class
        own: dict[str, object] = {"defaults": {p.name: p.default for p in properties if p.setters}}
        for property in properties:
            own.update(property.setters)
        for name, value in own.items():
            setattr(plain, name, value)
        return smproperty.xml("".join(with_picture(p.name, p.xml) for p in properties))(cls)

    return decorate
