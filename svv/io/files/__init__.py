"""Files of any kind: written whole or not at all, locked, cached, fetched, checked before memory is allocated.

What is in them is known by ``views``, ``pictures``, ``cinema`` and :mod:`svv.io.scene_file`.
"""
