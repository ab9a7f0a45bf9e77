"""The hot functions of the renderer and its training; references stand in ``svv.core``.

One interface (:class:`svv.kernels.types.Kernels`), three ways to calculate it: :mod:`~svv.kernels.compiled`
(numba, on the CPU), :mod:`~svv.kernels.fused` (Triton, on the GPU) and :mod:`~svv.kernels.plain` (torch alone).
"""
