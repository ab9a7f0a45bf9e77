"""Training: one module a stage, from view sets to scenes."""
