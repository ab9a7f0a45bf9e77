#!/usr/bin/env bash
# nibabel 5.4.2: loading an uncompressed FreeSurfer volume leaves its file open; NIfTI and the compressed .mgz do not.
#
# The file is closed when Python collects it, with a ResourceWarning. Test suites in which warnings are errors fail, and
# programs that look at many volumes run short of files. An opened file that is handed over is closed by its owner.
#
# Seen: the warnings of nibabel.load, by file, and of a file that is handed over.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q --disable-pip-version-check nibabel==5.4.2 numpy==2.4.4
cat >look.py <<'PY'
import gc
import warnings

import nibabel
import numpy as np

values = np.arange(60, dtype=np.float32).reshape(3, 4, 5)
for name, kind in (("a.nii", nibabel.Nifti1Image), ("a.mgz", nibabel.MGHImage), ("a.mgh", nibabel.MGHImage)):
    nibabel.save(kind(values, np.eye(4)), name)
gc.collect()


def handed_over(name):
    with open(name, "rb") as opened:
        return nibabel.MGHImage.from_file_map({"image": nibabel.FileHolder(fileobj=opened)})


for name, load in (("a.nii", nibabel.load), ("a.mgz", nibabel.load), ("a.mgh", nibabel.load), ("a.mgh", handed_over)):
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        load(name)
        gc.collect()
    print(name, load.__name__, *(one.category.__name__ for one in found))
PY
venv/bin/python look.py >seen
diff - seen <<'SEEN'
a.nii load
a.mgz load
a.mgh load ResourceWarning
a.mgh handed_over
SEEN
