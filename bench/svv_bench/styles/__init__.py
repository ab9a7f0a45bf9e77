"""Comparison of paintings: other ways to stylize, consistency between frames, similarity to the style."""
