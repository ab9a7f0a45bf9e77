#!/usr/bin/env bash
# F3D 4.0.0 with Mesa's software OpenGL: Gaussian splats are read, listed and not drawn, without a word.
#
# Neither .ply nor .spz is drawn as any kind of sprite (gaussian, circle, stddev, bound, cross), with EGL; gaussian
# sprites not with OSMesa, GLX, another blending (sort, ddp, stochastic), or version 3.5.0 either. The same points are
# drawn as points where sprites are off. Graphics cards were not tried.
#
# Seen: whether any pixel is not white, of three large opaque splats as gaussian sprites, and of a
# triangle.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q --disable-pip-version-check f3d==4.0.0 numpy==2.4.6 pillow==13.0.0
cat >draw.py <<'PY'
import struct

import f3d
import numpy as np
from PIL import Image

names = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3".split()
lines = ["ply", "format binary_little_endian 1.0", "element vertex 3", *(f"property float {n}" for n in names)]
with open("splat.ply", "wb") as file:
    file.write("\n".join([*lines, "end_header", ""]).encode())
    for x in (-1.0, 0.0, 1.0):
        file.write(struct.pack("<14f", x, x, 0, 0, -1, -1, 5, -0.5, -0.5, -0.5, 1, 0, 0, 0))
with open("triangle.obj", "w") as file:
    file.write("v -1 -1 0\nv 1 -1 0\nv 0 1 0\nf 1 2 3\n")
f3d.Engine.autoload_plugins()
for path in ("splat.ply", "triangle.obj"):
    engine = f3d.Engine.create(True)
    engine.options["render.background.color"] = (1.0, 1.0, 1.0)
    engine.options["render.grid.enable"] = False
    if path == "splat.ply":
        engine.options["model.point_sprites.type"] = "gaussian"
        engine.options["render.effect.blending.mode"] = "sort_cpu"
    engine.window.size = (200, 200)
    engine.scene.add(path)
    engine.window.render_to_image().save("picture.png")
    print(path, (np.asarray(Image.open("picture.png").convert("RGB")) < 250).any(axis=2).sum() > 0)
PY
LIBGL_ALWAYS_SOFTWARE=1 venv/bin/python draw.py 2>/dev/null | tr '\r' '\n' | grep -E "^(splat|triangle)" >seen
diff - seen <<'SEEN'
splat.ply False
triangle.obj True
SEEN
echo "as described"
