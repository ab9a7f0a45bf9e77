"""Results that filters keep: in files, under hashes of what they depend on, and for each time step."""
