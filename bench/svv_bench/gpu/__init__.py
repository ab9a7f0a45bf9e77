"""``svv bench gpu``: whether the kernels are right on this GPU, and how fast training, images and painting are.

Each part runs in a process of its own (:mod:`svv_bench.gpu.parts`), because a fault on a GPU makes all further work of
its process fail.
"""
