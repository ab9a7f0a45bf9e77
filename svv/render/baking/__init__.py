"""Scenes baked into volumes of bytes that VTK's mappers, OpenVDB and other programs draw.

Pages for browsers are made in :mod:`svv.render.web`.
"""
