"""Rendering of the volume against that of the scene, by size: a generated volume, its writer, the table and chart."""
