"""Views of a volume, drawn by VTK or brick by brick, and its classification."""
