"""Brush strokes as primitives, and the reference of the paint that they leave.

How strokes are laid is in :mod:`svv.train.paint`; the compiled kernel is :mod:`svv.kernels.numba.strokes`.
"""
