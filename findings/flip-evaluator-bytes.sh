#!/usr/bin/env bash
# flip-evaluator 1.7: pictures of 0 to 255 are not refused; they give an error that is much too small.
#
# evaluate expects numbers from 0 to 1. Arrays of uint8 are taken as they are and clamped at 1, so that all but the
# darkest pixels are white in both pictures. And the map that it returns is coloured for the eye by default: its
# mean is not the mean error.
#
# Seen: the mean error of one pair of pictures as float32 of 0 to 1, and as uint8; the mean of the map, and its
# shape.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q --disable-pip-version-check flip-evaluator==1.7 numpy==2.4.6
venv/bin/python - >seen 2>/dev/null <<'PY'
import flip_evaluator
import numpy as np

one = np.random.default_rng(0).random((32, 32, 3)).astype(np.float32)
other = np.clip(one + 0.1, 0, 1).astype(np.float32)
print("0..1", round(flip_evaluator.evaluate(one, other, "LDR")[1], 3))
bytes_of = [(255 * picture).astype(np.uint8) for picture in (one, other)]
print("uint8", round(flip_evaluator.evaluate(*bytes_of, "LDR")[1], 3))
shown, mean, _ = flip_evaluator.evaluate(one, other, "LDR")
print("mean of the map", round(float(shown.mean()), 3), shown.shape)
PY
diff - seen <<'SEEN'
0..1 0.302
uint8 0.041
mean of the map 0.333 (32, 32, 3)
SEEN
echo "as described"
