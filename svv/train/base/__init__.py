"""Stage 1: the base radiance field, from a first extinction to the lattice's finest level."""
