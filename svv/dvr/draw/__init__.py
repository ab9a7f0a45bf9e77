"""Views of a volume, drawn by VTK or brick by brick, and its classification.

Scenes are rendered by :mod:`svv.fields.radiance.rendering`.
"""
