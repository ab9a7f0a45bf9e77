"""What happens along a ray: marching, encodings, small networks, compositing. These are the references.

The compiled kernels (:mod:`svv.kernels`) must match them in value and gradient.
"""
