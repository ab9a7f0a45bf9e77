"""Ablations: stages repeated with one part left out, to measure what the part contributes."""
