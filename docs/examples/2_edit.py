"""Recolour, thin out and hide
===========================

An edit is a few numbers: it trains nothing, and returns a new scene that shares the old one's networks.
"""

import svv

scene = svv.Scene.load("scene.svv")
edited = scene.edited(1, colour=(0.1, 0.5, 0.45)).edited(0, opacity=0.4)
picture = svv.show(edited, size=(480, 480), off_screen=True)

# %%
# Everything but one region can be hidden. Every edit can be undone.
alone = edited.isolated(1)
assert alone.undone().regions == edited.regions
picture = svv.show(alone, size=(480, 480), off_screen=True)
