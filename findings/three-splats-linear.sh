#!/usr/bin/env bash
# three.js r187: Gaussian splats are washed out. A splat whose colour is the grey 128 of sRGB is drawn as 188.
#
# The coefficients of splats are colours for the display, and KHR_gaussian_splatting asks that they are blended before
# any transfer function. GLTFGaussianSplatLoaderExtension and GaussianSplatPLYLoader put them unchanged where three.js
# keeps linear light, which the renderer then encodes again. A renderer with outputColorSpace "srgb-linear" shows them
# as they are, and everything else wrongly.
#
# Seen: the red of the pixel in the middle of an opaque grey splat, by the renderer's colour space, in Chromium.
set -euo pipefail
chromium=$(command -v chromium || command -v chromium-browser || command -v google-chrome)
folder=$(mktemp -d)
server=
trap '[ -z "$server" ] || kill "$server"; rm -rf "$folder"' EXIT
cd "$folder"
npm init -y >/dev/null
npm install --silent three@0.187.0
python3 - <<'PY'
import json
import struct

values = {
    "POSITION": (0, 0, 0), "ROTATION": (0, 0, 0, 1), "SCALE": (1, 1, 1), "OPACITY": (1,),
    "SH_DEGREE_0_COEF_0": (0.00695, 0.00695, 0.00695),
}  # 0.5 + 0.2821 * 0.00695 = 128 / 255
kinds = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
block, views, accessors, attributes = b"", [], [], {}
for name, numbers in values.items():
    attributes[name if name == "POSITION" else f"KHR_gaussian_splatting:{name}"] = len(views)
    views.append({"buffer": 0, "byteOffset": len(block), "byteLength": 4 * len(numbers)})
    accessors.append({"bufferView": len(accessors), "componentType": 5126, "count": 1, "type": kinds[len(numbers)]})
    block += struct.pack(f"<{len(numbers)}f", *numbers)
accessors[0] |= {"min": [0, 0, 0], "max": [0, 0, 0]}
extension = {"KHR_gaussian_splatting": {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}}
scene = json.dumps({
    "asset": {"version": "2.0"}, "extensionsUsed": list(extension), "scene": 0, "scenes": [{"nodes": [0]}],
    "nodes": [{"mesh": 0}], "accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": len(block)}],
    "meshes": [{"primitives": [{"mode": 0, "attributes": attributes, "extensions": extension}]}],
}).encode()
scene += b" " * (-len(scene) % 4)
with open("grey.glb", "wb") as file:
    file.write(struct.pack("<4sIII4s", b"glTF", 2, 28 + len(scene) + len(block), len(scene), b"JSON") + scene)
    file.write(struct.pack("<I4s", len(block), b"BIN\0") + block)
PY
cat >index.html <<'HTML'
<!doctype html><pre></pre>
<script type="importmap">{"imports": {
  "three": "./node_modules/three/build/three.module.js", "three/webgpu": "./node_modules/three/build/three.webgpu.js",
  "three/tsl": "./node_modules/three/build/three.tsl.js", "three/addons/": "./node_modules/three/examples/jsm/"
}}</script>
<script type="module">
import * as THREE from "three/webgpu";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { GLTFGaussianSplatLoaderExtension } from "three/addons/loaders/GLTFGaussianSplatLoaderExtension.js";

const loader = new GLTFLoader();
loader.register((parser) => new GLTFGaussianSplatLoaderExtension(parser));
const camera = new THREE.PerspectiveCamera(30, 1, 0.1, 100);
camera.position.z = 5;
let said = "";
for (const space of ["srgb", "srgb-linear"]) {
  const renderer = new THREE.WebGPURenderer({ forceWebGL: true });
  await renderer.init();
  renderer.outputColorSpace = space;
  renderer.setSize(64, 64, false);
  const scene = (await loader.loadAsync("grey.glb")).scene;
  for (let k = 0; k < 5; k++) {
    renderer.render(scene, camera);
    await new Promise((go) => setTimeout(go, 50));
  }
  const flat = document.createElement("canvas").getContext("2d");
  renderer.render(scene, camera);
  flat.drawImage(renderer.domElement, 0, 0);
  said += `${space} ${flat.getImageData(32, 32, 1, 1).data[0]}\n`;
}
document.querySelector("pre").textContent = said;
document.title = "done";
</script>
HTML
python3 -u -m http.server --bind 127.0.0.1 0 >port 2>&1 &
server=$!
until grep -q "port [0-9]" port; do sleep 0.1; done
port=$(sed -n 's/.*port \([0-9]*\).*/\1/p' port | head -1)
"$chromium" --headless --no-sandbox --use-angle=swiftshader --enable-unsafe-swiftshader --ignore-gpu-blocklist \
  --virtual-time-budget=20000 --dump-dom "http://127.0.0.1:$port/" 2>/dev/null |
  sed -n '/<pre>/,/<\/pre>/p' | sed 's/.*<pre>//; s/<\/pre>.*//' | grep . >seen
diff - seen <<'SEEN'
srgb 188
srgb-linear 128
SEEN
echo "as described"
