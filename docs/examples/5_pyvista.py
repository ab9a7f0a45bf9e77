"""Among other data in PyVista
===========================

``pyvista.read("scene.svv")`` returns the scene's cells with their regions and opacities, which PyVista's filters take.
"""

import pyvista

cells = pyvista.read("scene.svv")
lines = cells.threshold((1, 1), scalars="Region")
print(f"Region 1 fills {lines.volume:.2f} of {cells.volume:.2f} cubic units.")

# %%
# Cells of region 1, coloured by how opaque they are, with the outline of all:
plotter = pyvista.Plotter(off_screen=True, window_size=(480, 480))
plotter.add_mesh(lines, scalars="Opacity", cmap="viridis", show_scalar_bar=False)
plotter.add_mesh(cells.outline(), color="black")
picture = plotter.screenshot(return_img=True)

# %%
# The same region as svv draws it:
picture = cells.svv.edited(lambda scene: scene.isolated(1)).svv.plot(size=(480, 480), off_screen=True)
