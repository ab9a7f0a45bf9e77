"""Mathematics of pictures: metrics, features' statistics, edges, outlines, flow.

Reading and writing of pictures is in :mod:`svv.io.pictures`.
"""
