"""Training, from view sets to scenes: one folder per stage, and ``pipeline`` with all of them in order."""
