"""Paintings compared: other ways to stylize, consistency between frames, likeness to the style."""
