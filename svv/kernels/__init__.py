"""The hot functions of the renderer and its training; ``svv.core`` defines the results that they must match.

One interface (:class:`svv.kernels.types.Kernels`), three sets of kernels, chosen by :mod:`svv.kernels.dispatch`:

- ``numba``, on the CPU: :mod:`svv.kernels.numba.kernels`, whose loops are in the other ``numba_*`` modules;
- ``triton``, on the GPU: :mod:`svv.kernels.triton.kernels`, whose programs are in the other ``triton_*`` modules;
- ``reference``, in plain torch on either: :mod:`svv.kernels.reference`.

Each module has the name of its set as a prefix, so that no module has the same name as the package that it uses.
"""
