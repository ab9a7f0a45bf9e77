"""Consistency of any folder of frames: reading them in order, their motion, figures of pairs, other methods' frames.

``sequence`` reads and checks a folder, ``motion`` finds the flow between two of its frames, ``measure`` compares pairs
along it, ``painted`` makes frames of methods that stylize pictures, and ``result`` shows what was found.
"""
