"""A volume that is distributed over MPI's ranks, drawn as one.

Training on several ranks is in :mod:`svv.train.run.ranks`.
"""
