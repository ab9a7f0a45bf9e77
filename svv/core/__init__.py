"""Pure mathematics on NumPy and torch: no VTK, no files, no devices, no globals."""
