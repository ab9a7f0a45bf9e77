#!/usr/bin/env bash
# @playcanvas/splat-transform 2.7.1: a point at (1, 2, 3) of a .ply of Gaussian splats is at (1, -2, -3) in the .spz and
# at (-1, -2, 3) in the .glb that it is converted to.
#
# Formats are taken to have their own axes: .ply y down and z away (as COLMAP has cameras), .spz y up, .glb y up with
# another half turn. Files do not say which axes they have, and viewers such as Spark and three.js show all three as
# they are, so converted files stand on their heads beside those that they come from.
#
# Seen: the positions in the files' own bytes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm init -y >/dev/null
npm install --silent @playcanvas/splat-transform@2.7.1
python3 - <<'PY'
import struct

names = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3".split()
lines = ["ply", "format binary_little_endian 1.0", "element vertex 1", *(f"property float {n}" for n in names)]
with open("point.ply", "wb") as file:
    file.write("\n".join([*lines, "end_header", ""]).encode())
    file.write(struct.pack("<14f", 1, 2, 3, 0, 0, 0, 0, -3, -3, -3, 1, 0, 0, 0))
PY
npx splat-transform -q point.ply point.spz --spz-version 3 >/dev/null 2>&1
npx splat-transform -q point.ply point.glb >/dev/null 2>&1
python3 - >seen <<'PY'
import gzip
import json
import struct

with gzip.open("point.spz") as file:
    content = file.read()
unit = 2.0 ** content[13]
print(".spz", [int.from_bytes(content[k : k + 3], "little", signed=True) / unit for k in (16, 19, 22)])
with open("point.glb", "rb") as file:
    content = file.read()
scene = json.loads(content[20 : 20 + struct.unpack("<I", content[12:16])[0]])
position = scene["meshes"][0]["primitives"][0]["attributes"]["POSITION"]
print(".glb", scene["accessors"][position]["min"], "rotation" in scene["nodes"][0])
PY
diff - seen <<'SEEN'
.spz [1.0, -2.0, -3.0]
.glb [-1, -2, 3] False
SEEN
echo "as described"
