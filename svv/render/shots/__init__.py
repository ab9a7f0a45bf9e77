"""Shots: films of a scene by key frames and ready-made moves; what is between them, and their frames."""
