"""Volumes that are larger than memory: access by bricks, pyramids of coarser levels, and a ray caster of our own."""
