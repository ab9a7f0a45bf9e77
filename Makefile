# From nothing but make and python3 with venv:
#   make demo       the whole job on generated data; the result is demo/report.html
#   make test       style, types and tests, those in ParaView included
#   make paraview   what ParaView needs to run svv; with PARAVIEW=DIR for one that is unpacked in DIR
PYTHON ?= python3
VENV   ?= .venv
OUT    ?= demo
export SVV_PARAVIEW := $(or $(PARAVIEW),$(SVV_PARAVIEW))

BIN       := $(VENV)/bin
INSTALLED := $(VENV)/installed
PIP       := $(BIN)/python -m pip install -qq --disable-pip-version-check --no-input -c constraints.txt

.DELETE_ON_ERROR:
.PHONY: demo test check install paraview clean

demo: $(INSTALLED)
	$(BIN)/svv demo --out $(OUT)

test: check paraview
	OMP_WAIT_POLICY=passive $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

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
