"""Whether pictures agree with their cameras: silhouettes, usual mistakes, what stands still on the screen.

The judgement and its sentences are in :mod:`svv.io.views.agreement`.
"""
