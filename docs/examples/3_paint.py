"""Paint a region
==============

A style is a picture, a name of the gallery, or ink, which needs no picture. A painting is a variant of the scene, with
the same edits, seen from all sides.
"""

import svv

scene = svv.Scene.load("scene.svv")
drawn, report = svv.stylize_scene(scene, [svv.Ink("hatching")], "draft", keep=(0,), variant="drawn")
picture = svv.show(drawn.hidden(0), size=(480, 480), off_screen=True)

# %%
# Half of the palette's colours, half of the drawing:
picture = svv.show(drawn.with_strength(0.5), size=(480, 480), off_screen=True)
