"""Radiance fields of a scene: occupancy, encodings, networks, and their rendering."""
