"""A scene as 3D Gaussian splats: their record, which is made in :mod:`svv.train.splats`."""
