#!/usr/bin/env bash
# nbconvert 7.17.2: the alternative text of a picture in a notebook is left out of exported pages by the default
# template.
#
# A picture's metadata may say what it shows, {"image/png": {"alt": ...}}. The template "classic" writes it; "lab",
# which is the default, writes a sentence that there is no description, so pages do not say what their pictures
# show, though the notebooks do.
#
# Seen: what each template writes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q --disable-pip-version-check nbconvert==7.17.2 nbformat==5.10.4
venv/bin/python - >seen 2>/dev/null <<'PY'
import re

import nbformat
from nbconvert import HTMLExporter

pixel = "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR4nGNgAAAAAgABSK+kcQAAAABJRU5ErkJggg=="
notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell("picture")])
metadata = {"image/png": {"alt": "A rendering of two regions"}}
notebook.cells[0].outputs = [nbformat.v4.new_output("display_data", {"image/png": pixel}, metadata=metadata)]
for template in ("lab", "classic"):
    page, _ = HTMLExporter(template_name=template).from_notebook_node(notebook)
    print(template, re.findall('<img[^>]*alt="([^"]*)"', page))
PY
diff - seen <<'SEEN'
lab ['No description has been provided for this image']
classic ['A rendering of two regions']
SEEN
echo "as described"
