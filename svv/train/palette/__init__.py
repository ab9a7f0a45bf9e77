"""Stage 2: regions, their colours and the palette colour network (PCN).

Edits of a trained palette are in :mod:`svv.fields.scene.edits`.
"""
