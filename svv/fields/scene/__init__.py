"""The scene: a record of values (``model``), functions on it (images, edits), and ``scene.Scene`` with them as methods.

The container on disk is :mod:`svv.io.scene_file`; training is in :mod:`svv.train`.
"""
