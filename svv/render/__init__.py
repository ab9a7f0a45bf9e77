"""Scenes and style pictures as images, movies and sheets of pictures."""
