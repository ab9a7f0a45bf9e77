"""Volumes from files and data sets, as regular grids.

Formats that are read brick by brick are in :mod:`svv.bricks.formats`.
"""
