#!/usr/bin/env bash
# numba 0.66.0: what it compiles and keeps for a package stays in site-packages after the package is uninstalled.
#
# A function with cache=True is kept next to its module, in __pycache__, as .nbi and .nbc files. pip removes the files
# that it installed and the bytecode of the modules, so that nothing but compiled functions remains: a folder of the
# package's name that Python still imports, as a namespace package. An installation check by import passes.
#
# Seen: what is left of the package, by suffix, and what importing it gives.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q --disable-pip-version-check numba==0.66.0 numpy==2.4.4 setuptools==80.9.0
mkdir -p project/fastsum
cat >project/pyproject.toml <<'TOML'
[build-system]
requires = ["setuptools==80.9.0"]
build-backend = "setuptools.build_meta"
[project]
name = "fastsum"
version = "1.0"
TOML
cat >project/fastsum/__init__.py <<'PY'
from numba import njit


@njit(cache=True)
def total(values):
    result = 0.0
    for value in values:
        result += value
    return result
PY
venv/bin/pip install -q --disable-pip-version-check --no-build-isolation ./project
venv/bin/python -c 'import fastsum, numpy; print(fastsum.total(numpy.arange(5.0)))' >seen
venv/bin/pip uninstall -q -y fastsum
(cd venv/lib/python3.*/site-packages && find fastsum -type f | sed 's/.*\.//' | sort | uniq -c | awk '{print $1, $2}') >>seen
venv/bin/python -c 'import fastsum; print(fastsum.__file__)' >>seen
diff - seen <<'SEEN'
10.0
1 nbc
1 nbi
None
SEEN
echo "as described"
