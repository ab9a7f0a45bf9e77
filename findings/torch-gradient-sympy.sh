#!/usr/bin/env bash
# torch 2.13.0: a backward pass that is given the gradient of its outputs imports SymPy, one that begins at a scalar
# does not.
#
# torch.autograd.grad(y, x, g) and y.backward(g) compare the sizes of y and g with code for sizes that are symbols, and
# that imports SymPy: 300 to 400 modules, about 30 MB and a third of a second in each process that trains in this way,
# although no size is a symbol. (x * y).sum().backward() for the same numbers imports none.
#
# Seen: whether SymPy is loaded after each kind of backward pass, each in a process of its own, and MB that it takes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install -q --disable-pip-version-check torch==2.13.0 numpy==2.4.4
cat >back.py <<'PY'
import sys

import torch


def resident():
    return int(open("/proc/self/statm").read().split()[1]) * 4096 / 1e6


def begin_at_a_scalar(x, g):
    (2.0 * x * g).sum().backward()
    return x.grad


def give_to_grad(x, g):
    return torch.autograd.grad(2.0 * x, [x], g)[0]


def give_to_backward(x, g):
    (2.0 * x).backward(g)
    return x.grad


x, g = torch.ones(3, requires_grad=True), torch.tensor([1.0, 2.0, 3.0])
(3.0 * x).sum().backward()  # what any backward pass loads
x.grad = None
before = resident()
found = globals()[sys.argv[1]](x, g)
assert found.tolist() == [2.0, 4.0, 6.0]
print(sys.argv[1], "sympy" in sys.modules, "more than 15 MB" if resident() - before > 15.0 else "less than 15 MB")
PY
cat >expected <<'TEXT'
begin_at_a_scalar False less than 15 MB
give_to_grad True more than 15 MB
give_to_backward True more than 15 MB
TEXT
for kind in begin_at_a_scalar give_to_grad give_to_backward; do venv/bin/python back.py "$kind"; done | tee seen
diff expected seen
echo "as described"
