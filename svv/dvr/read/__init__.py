"""Volumes from files and data sets, as regular grids, with the appearance that they carry along.

Formats that are read brick by brick are in :mod:`svv.bricks.formats`.
"""
