"""What the panels of all filters show before their advanced properties."""

from __future__ import annotations

from collections.abc import Callable

FEW = 12
"""The most properties of a panel that are not advanced, without buttons and what appears only beside another one."""


def test_every_panel_shows_few_properties_and_its_status(pvpython: Callable) -> None:
    pvpython(f"""
from paraview.simple import *
from paraview import servermanager as sm
from svv.pv.filters import edit_filters, figure_filter, look_filter, scene_filters, volume_filters

def appears(property):
    hints = property.GetHints()
    inside = range(0 if hints is None else hints.GetNumberOfNestedElements())
    return any(hints.GetNestedElement(k).GetAttribute("type") == "GenericDecorator" for k in inside)

modules = (edit_filters, figure_filter, look_filter, scene_filters, volume_filters)
names = [name for module in modules for name in module.__all__]
assert len(names) >= 12, names
for name in names:
    proxy = sm.ProxyManager().NewProxy("filters", name)
    shown = []
    groups = [proxy.GetPropertyGroup(k) for k in range(proxy.GetNumberOfPropertyGroups())]
    assert all(group.GetXMLLabel() for group in groups), name
    iterator = proxy.NewPropertyIterator()
    iterator.Begin()
    while not iterator.IsAtEnd():
        found, key = iterator.GetProperty(), iterator.GetKey()
        plain = not found.GetInformationOnly() and not found.IsA("vtkSMInputProperty") and not appears(found)
        if plain and found.GetPanelVisibility() == "default" and found.GetPanelWidget() != "command_button":
            shown.append(key)
            assert len(found.GetXMLLabel()) <= 24, key
        iterator.Next()
    assert 0 < len(shown) <= {FEW}, (name, len(shown), shown)
    assert proxy.GetProperty("Status").GetPanelVisibility() == "default", name
""")
