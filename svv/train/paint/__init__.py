"""Stage 3 as it is by default: brush strokes, ink and pieces of pictures, laid on the regions' visible surfaces.

Strokes as primitives are in :mod:`svv.core.strokes`; the picture's hand is measured in :mod:`svv.styles.hand`.
"""
