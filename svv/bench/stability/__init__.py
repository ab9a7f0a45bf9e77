"""Training and palettes where they could fail: scenes, cases and what counts as failure."""
