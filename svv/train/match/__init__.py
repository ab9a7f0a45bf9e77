"""Stage 3 as in the paper: the unrestricted colour network (UCN) is distilled and matched to features of VGG-16.

Used by the preset ``paper``; it needs published weights.
"""
