"""Radiance fields: occupancy, encodings, networks, and images of them.

The references of the mathematics are in :mod:`svv.core.rays`.
"""
