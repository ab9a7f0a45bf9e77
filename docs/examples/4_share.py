"""Show it in a browser and in a notebook
======================================

A scene becomes one HTML file, which needs neither svv nor a server nor a network. The same page is the notebook's
widget, and it works on this page, too: drag the picture, and change its colours.
"""

from pathlib import Path

import svv
from svv import write_html

scene = svv.Scene.load("scene.svv")
size = write_html(Path("scene.html"), scene, "The demo")
print(f"{size / 1e6:.1f} MB")

# %%
# In a notebook, ``widget.scene`` and ``widget.camera`` are what is set in the page.
svv.widget(scene, title="The demo", height=460)
