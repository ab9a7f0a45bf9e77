"""Edits in words: a small grammar of regions' names, colours, opacities, light, materials and styles."""
