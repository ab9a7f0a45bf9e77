"""Measurements of the rest of the package, which does not import them."""
