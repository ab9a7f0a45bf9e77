"""Rendering of scenes and style pictures into images, movies and contact sheets."""
