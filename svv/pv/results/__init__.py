"""Results that filters keep: in files, under hashes of what they depend on, and for each time step.

What makes them is in :mod:`svv.pv.filters`.
"""
