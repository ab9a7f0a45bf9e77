"""How a volume is displayed: which properties are reproduced or refused, and the volume as shown.

The drawing itself is in :mod:`svv.dvr.draw`.
"""
