"""Radiance fields along rays: occupancy, encodings, networks, and fields that follow from a volume's values.

The references of the mathematics are in :mod:`svv.core.rays`; images of a scene are in :mod:`svv.fields.scene`.
"""
