"""Style pictures and their parts, the gallery, and the networks whose features the preset ``paper`` matches."""
