"""Colours: spaces, colour vision, palettes and their correction, light and shading.

Scenes' edits of colour are in :mod:`svv.fields.scene.edits`.
"""
