"""Strokes that a scene keeps, and their evaluation at positions; their edits are in :mod:`svv.fields.scene`.

How they are laid is in :mod:`svv.train.paint`.
"""
