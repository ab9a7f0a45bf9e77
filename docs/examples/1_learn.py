"""Learn a scene from a volume
===========================

A volume and its transfer function become views, and views become a scene. The volume is the demo's: a knotted
vortex and the sheet that it bounds, in a ball of superfluid.
"""

import svv
from svv import make_views
from svv.dvr.demo_volume import demo_transfer_function, demo_volume

views, unseen = make_views(demo_volume(64), demo_transfer_function(), n=32, test=4, size=128)
scene, report = svv.train_scene(views, "draft")
scene.save("scene.svv")

# %%
# The scene from the front. PyVista draws the window; ``off_screen`` returns its picture.
picture = svv.show(scene, size=(480, 480), off_screen=True)

# %%
# How close it is to views that it was not trained on, and what its regions are:
scores = svv.evaluate_scene(scene, unseen)
print(f"{scores.psnr:.1f} dB")
for number, region in enumerate(scene.regions):
    print(number, "values", region.values, "colour", [round(c, 2) for c in region.colour])
