"""View sets: pictures with cameras, read, checked and written.

Cinema databases are in :mod:`svv.io.cinema`.
"""
