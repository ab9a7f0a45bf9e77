"""Volumes from files and data sets, as regular grids, with the appearance that they carry along."""
