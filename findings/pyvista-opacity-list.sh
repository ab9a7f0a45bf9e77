#!/usr/bin/env bash
# PyVista 0.49.1, add_volume: a list of opacities means something else when it is as long as there are colours.
#
# Shorter lists are interpolated, and 1 is opaque. A list of exactly n_colors entries is taken as bytes, so that 1
# is 1/255 and the volume is all but invisible.
#
# Seen: n_colors, and the opacity of the greatest value for a list that ends with 1.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q --disable-pip-version-check pyvista==0.49.1 vtk==9.7.2 numpy==2.4.6
venv/bin/python - >seen 2>/dev/null <<'PY'
import pyvista

levels = [0, 0.25, 0.5, 0.75, 1.0]
for colours in (5, 6, 256):
    plotter = pyvista.Plotter(off_screen=True)
    volume = plotter.add_volume(pyvista.Wavelet(), opacity=levels, n_colors=colours)
    opacity = volume.prop.GetScalarOpacity()
    print(colours, round(opacity.GetValue(opacity.GetRange()[1]), 3))
PY
diff - seen <<'SEEN'
5 0.004
6 0.998
256 0.998
SEEN
echo "as described"
