"""Strokes that a scene keeps: evaluation at positions, edits afterwards, opacity.

How they are laid is in :mod:`svv.train.paint`.
"""
