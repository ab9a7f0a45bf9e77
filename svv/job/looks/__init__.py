"""Looks: everything that makes a scene look as it does, in one file, for other scenes."""
