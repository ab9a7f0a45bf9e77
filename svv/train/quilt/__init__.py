"""Pieces of a style picture laid on surfaces: for mosaics, prints, textures and photographs.

Which styles are painted this way is decided in :mod:`svv.train.paint.manner`.
"""
