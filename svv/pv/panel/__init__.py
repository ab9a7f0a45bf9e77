"""ParaView's panels: properties made from the options' dataclasses, their groups, undo."""
