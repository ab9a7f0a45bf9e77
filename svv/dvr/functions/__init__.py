"""Transfer functions: presets, scales, and a default from the histogram.

What they make of a volume is in :mod:`svv.dvr.draw.classify`.
"""
