#!/usr/bin/env bash
# colour-science 0.4.6: after importing it where matplotlib is missing, "import matplotlib.pyplot" succeeds, with a mock.
#
# Other packages look whether matplotlib can be imported, find a MagicMock, and go on: figures are drawn and saved without
# an error, and no file is there. Where matplotlib is installed, importing colour for one formula loads pyplot.
#
# Seen: what another import finds after "import colour", whether savefig leaves a file, and the same with matplotlib.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
install="venv/bin/pip install -q --disable-pip-version-check"
$install colour-science==0.4.6 numpy==2.3.5 scipy==1.17.1
cat >look.py <<'PY'
import os
import sys
import warnings

warnings.simplefilter("ignore")
try:
    import matplotlib.pyplot
except ImportError:
    print("no matplotlib")
import colour

print("difference", round(float(colour.delta_E([50.0, 2.6772, -79.7751], [50.0, 0.0, -82.7485], method="CIE 2000")), 4))
import matplotlib.pyplot as plt

plt.plot([0, 1])
plt.savefig("figure.png")
print(type(sys.modules["matplotlib.pyplot"]).__name__, os.path.exists("figure.png"))
PY
export MPLBACKEND=agg
venv/bin/python look.py >seen
$install matplotlib==3.11.2
venv/bin/python look.py >>seen
diff - seen <<'SEEN'
no matplotlib
difference 2.0425
MagicMock False
difference 2.0425
module True
SEEN
echo "as described"
