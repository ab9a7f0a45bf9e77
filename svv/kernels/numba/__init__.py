"""The kernels for CPUs, compiled with numba.

The definitions are in :mod:`svv.core.rays`, the interface in :mod:`svv.kernels.types`.
"""
