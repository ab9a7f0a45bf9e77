"""Expressive volume visualization: radiance fields of direct volume renderings, edited and stylized by region."""

__version__ = "0.1.0"
