"""Mathematics of pictures: metrics, features' statistics, edges, outlines.

Reading and writing of pictures is in :mod:`svv.io.pictures`.
"""
