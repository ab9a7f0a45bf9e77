#!/usr/bin/env bash
# numba 0.68.1: dividing by 0 in a parallel loop gives infinity, or a SystemError and half of the results, depending on
# where the division stands.
#
# Compiled functions have Python's error model by default: a division by 0 is a ZeroDivisionError. In the body of a prange
# it is infinity instead, as in NumPy. If the same division is in a function that the body calls, the call ends with
# SystemError ("returned a result with an exception set"), and the thread's other items keep what was in the array before.
# With error_model="numpy" on both functions, all three give infinity.
#
# Seen: for each kind of loop, how it ended, and how many of 1,000 results were not written, on two threads.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q --disable-pip-version-check numba==0.68.1 numpy==2.4.4
cat >divide.py <<'PY'
import numpy as np
from numba import njit, prange


def inverse(x):
    return 1.0 / x


def loop_of(function, **options):
    @njit(**options)
    def loop(x, out):
        for i in prange(len(x)):
            out[i] = function(x[i])

    return loop


def within(x, out):
    for i in prange(len(x)):
        out[i] = 1.0 / x[i]


python, numpy = njit(inverse), njit(error_model="numpy")(inverse)
kinds = {
    "serial": njit(within),
    "parallel": njit(parallel=True)(within),
    "parallel, in a function": loop_of(python, parallel=True),
    "the same, NumPy's errors": loop_of(numpy, parallel=True, error_model="numpy"),
}
for name, kind in kinds.items():
    x, out = np.ones(1000), np.full(1000, -1.0)
    x[1] = 0.0
    try:
        kind(x, out)
        ended = out[1]
    except (ZeroDivisionError, SystemError) as error:
        ended = type(error).__name__
    print(f"{name}: {ended}, {(out == -1.0).sum()} not written")
PY
NUMBA_NUM_THREADS=2 venv/bin/python divide.py >seen
diff - seen <<'SEEN'
serial: ZeroDivisionError, 999 not written
parallel: inf, 0 not written
parallel, in a function: SystemError, 499 not written
the same, NumPy's errors: inf, 0 not written
SEEN
echo "as described"
