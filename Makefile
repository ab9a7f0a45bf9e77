# From nothing but make and python3 with venv:
#   make demo       the whole job on generated data; the result is demo/report.html
#   make test       style, types and tests, those in ParaView included
#   make test-processors   the tests outside ParaView with the arithmetic of other processors
#   make paraview   what ParaView needs to run svv; with PARAVIEW=DIR for one that is unpacked in DIR
PYTHON ?= python3
VENV   ?= .venv
OUT    ?= demo
export SVV_PARAVIEW := $(or $(PARAVIEW),$(SVV_PARAVIEW))

BIN       := $(VENV)/bin
INSTALLED := $(VENV)/installed
PYTEST    := OMP_WAIT_POLICY=passive $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder
PIP       := $(BIN)/python -m pip install -qq --disable-pip-version-check --no-input -c constraints.txt

.DELETE_ON_ERROR:
.PHONY: demo test test-processors check install paraview clean

demo: $(INSTALLED)
	$(BIN)/svv demo --out $(OUT)

test: check paraview
	$(PYTEST)

# Sums are rounded in another order on every processor, and some have half precision. Here is one without AVX on one thread,
# one with AVX2 on two, and one with AMX.
test-processors: $(INSTALLED)
	ATEN_CPU_CAPABILITY=default ONEDNN_MAX_CPU_ISA=SSE41 MKL_CBWR=COMPATIBLE OPENBLAS_CORETYPE=Nehalem \
		NUMBA_CPU_NAME=generic NUMBA_NUM_THREADS=1 OMP_NUM_THREADS=1 $(PYTEST) --ignore=tests/paraview
	ATEN_CPU_CAPABILITY=avx2 ONEDNN_MAX_CPU_ISA=AVX2 NUMBA_NUM_THREADS=2 OMP_NUM_THREADS=2 \
		$(PYTEST) --ignore=tests/paraview
	$(PYTEST) --ignore=tests/paraview -p tests.amx

check: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/mypy

install: $(INSTALLED)

paraview: $(INSTALLED)
	@.ci/paraview "$(SVV_PARAVIEW)"
	@$(BIN)/svv paraview --prepare

clean:
	rm -rf $(VENV) .venv-paraview build svv.egg-info .mypy_cache .pytest_cache .ruff_cache .hypothesis

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "make needs python3 3.11 or newer; name one, for example: make test PYTHON=python3.12" >&2; exit 1; }
	@$(PYTHON) -m venv $(VENV) || \
		{ rm -rf $(VENV); echo "python3 lacks venv; install it first, for example: sudo apt-get install python3-venv" >&2; exit 1; }

# torch goes first and alone: asked for by name with its pinned version, it is taken from wherever pip is set up to
# look, and nothing after it can pull in another build.
$(INSTALLED): pyproject.toml constraints.txt .ci/offscreen | $(BIN)/python
	@.ci/offscreen
	@echo 'Installing into $(VENV): a few minutes, once.'
	@$(PIP) setuptools
	@$(PIP) "$$(grep '^torch==' constraints.txt)"
	@$(PIP) --no-build-isolation -e '.[standalone,dev]'
	@touch $@
