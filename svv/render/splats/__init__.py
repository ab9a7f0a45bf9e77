"""Scenes as 3D Gaussian splats, in files that other programs draw; they are fitted in :mod:`svv.train.splats`."""
