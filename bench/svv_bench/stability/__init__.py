"""Stability of training and palettes in difficult cases: scenes, cases and criteria of failure."""
