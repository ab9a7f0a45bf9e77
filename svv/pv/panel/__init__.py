"""ParaView's panels: properties made from the options' dataclasses, their groups, undo.

What the properties do is in :mod:`svv.pv.filters`.
"""
