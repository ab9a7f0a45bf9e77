"""The hot functions of the renderer and its training; ``svv.core`` defines the results that they must match.

One interface (:class:`svv.kernels.types.Kernels`), three sets of kernels, chosen by :mod:`svv.kernels.dispatch`:
``numba`` for CPUs, ``triton`` for GPUs, and :mod:`svv.kernels.reference` in plain torch on either.
"""
