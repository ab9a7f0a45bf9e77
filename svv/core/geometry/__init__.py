"""Where things are: the box and its cells' places, cameras and their matrices, directions, surfaces.

No colours and no pixels; what lies along a ray is in :mod:`svv.core.rays`.
"""
