"""How a view shows: what becomes of a display's properties, the volume as shown, the linked camera and its mouse.

The drawing itself is in :mod:`svv.dvr.draw`.
"""
