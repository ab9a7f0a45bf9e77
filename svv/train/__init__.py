"""Training, from view sets to scenes: one module per stage."""
