"""Volumes after classification: extinction and range at each point, and how they are packed into bytes.

Reading of volumes is in :mod:`svv.dvr.read` and :mod:`svv.bricks`.
"""
