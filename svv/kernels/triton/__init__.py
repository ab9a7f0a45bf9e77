"""The kernels for GPUs, in Triton.

The definitions are in :mod:`svv.core.rays`, the interface in :mod:`svv.kernels.types`.
"""
