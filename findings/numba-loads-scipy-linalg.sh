#!/usr/bin/env bash
# numba 0.68.1, SciPy 1.17.1: the first compiled function that is called loads scipy.linalg, whatever it computes.
#
# When numba compiles a function, or reads one that it has kept (cache=True), it sets up what it knows of arrays, and
# asks on that occasion whether SciPy has a BLAS. That imports scipy.linalg, 80 of its modules and about a tenth of a
# second, into every process that adds two numbers. Without SciPy, the same function needs none.
#
# Seen: whether scipy.linalg is loaded after "import numba", after a function is compiled, and in a second process that
# reads it from the cache; and what the function returns where there is no SciPy.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q --disable-pip-version-check numba==0.68.1 scipy==1.17.1 numpy==2.3.5
cat >add.py <<'PY'
import sys

from numba import njit

imported = "scipy.linalg" in sys.modules


@njit(cache=True)
def add(a, b):
    return a + b


result = add(1.0, 2.0)
where = "kept" if add.stats.cache_hits else "compiled"
print(where, result, imported, "scipy.linalg" in sys.modules)
PY
cat >expected <<'TEXT'
compiled 3.0 False True
kept 3.0 False True
kept 3.0 False False
TEXT
{
    venv/bin/python add.py
    venv/bin/python add.py
    venv/bin/pip uninstall -q --disable-pip-version-check -y scipy
    venv/bin/python add.py
} | tee seen
diff expected seen
echo "as described"
