"""The hot functions of the renderer and its training; what each must calculate stands in ``svv.core``.

One interface (:class:`svv.kernels.types.Kernels`), three sets of kernels, chosen by :mod:`svv.kernels.dispatch`:

- ``numba``, on the CPU: :mod:`svv.kernels.numba_kernels`, whose loops stand in the other ``numba_*`` modules;
- ``triton``, on the GPU: :mod:`svv.kernels.triton_kernels`, whose programs stand in the other ``triton_*`` modules;
- ``reference``, in plain torch on either: :mod:`svv.kernels.reference`.

A module's prefix is the name of its set, so that no module is called as the package that it uses is.
"""
