"""The scene: its model, regions, edits and their history, paintings, and its file's arrays.

The container on disk is :mod:`svv.io.scene_file`; training is in :mod:`svv.train`.
"""
