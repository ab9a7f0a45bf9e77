"""Legibility of pictures of nested regions: generated scenes with questions, a figure, and sheets for judges."""
