#!/usr/bin/env bash
# adios2 2.12.1.1001: importing it imports torch where that is installed, which takes seconds and some hundred megabytes.
#
# adios2/engine.py and adios2/stream.py look for torch to accept its tensors. A program that only reads arrays avoids it:
# sys.modules["torch"] = None, before the import, stands for a package that is not there.
#
# Seen: whether a module of the name torch, here an empty one, is imported, without and with that line.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q --disable-pip-version-check adios2==2.12.1.1001 numpy==2.3.5
echo 'print("torch is imported")' >torch.py
venv/bin/python -c 'import adios2' >seen
venv/bin/python -c 'import sys; sys.modules["torch"] = None; import adios2; print("it is not")' >>seen
diff - seen <<'SEEN'
torch is imported
it is not
SEEN
echo "as described"
