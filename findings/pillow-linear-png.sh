#!/usr/bin/env bash
# Pillow 13.0.0: PNG files of linear light are read as if they were sRGB, with half of their bits.
#
# The chunk gAMA says that numbers are proportional to light, as renderers write it with 16 bits. Pillow tells it in
# info and does not apply it; of colours, unlike of grey values, it keeps the upper 8 bits, so dark tones are lost
# before anybody can convert them. A grey of 0.2133 is 127 in sRGB; it reads as 54.
#
# Seen: mode, pixel and info of a file with the values 13980, 258 and 511 of 65535.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q --disable-pip-version-check pillow==13.0.0
venv/bin/python - >seen 2>/dev/null <<'PY'
import struct
import zlib

from PIL import Image


def chunk(name, data):
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


with open("linear.png", "wb") as file:  # one pixel of linear light, 16 bits for each of red, green and blue
    file.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 1, 1, 16, 2, 0, 0, 0)))
    file.write(chunk(b"gAMA", struct.pack(">I", 100000)))
    file.write(chunk(b"IDAT", zlib.compress(b"\0" + struct.pack(">HHH", 13980, 258, 511))) + chunk(b"IEND", b""))
with Image.open("linear.png") as image:
    print(image.mode, image.getpixel((0, 0)), image.info)
PY
diff - seen <<'SEEN'
RGB (54, 1, 1) {'gamma': 1.0}
SEEN
echo "as described"
