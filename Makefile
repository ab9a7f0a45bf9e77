# These targets need only make and python3 with venv:
#   make demo       the whole job on generated data; the result is demo/report.html. OPTIONS are those of svv demo:
#                   make demo OPTIONS=--views-only learns without the volume, as the paper does
#   make test       style, types and tests, including those in ParaView
#   make test-slow  the longest tests, which make test leaves out, laws with new random examples, and the tests in ParaView
#                   each in a process that is started for it
#   make test-processors   the tests with the arithmetic of other CPUs
#   make coverage   all tests, and a report of the lines and branches that they miss, as pages in build/coverage
#   make docs       the documentation, as pages in build/docs
#   make paraview   the packages that ParaView needs to run svv; PARAVIEW=DIR names a ParaView unpacked in DIR
# `svv bench ...` measures; it is a distribution of its own, in bench/, which all of these install.
# TORCH=cpu|cuda|keep selects torch's build. By default an installed torch is kept, and otherwise the build is cuda with
# an NVIDIA GPU and cpu without.
PYTHON ?= python3
VENV   ?= .venv
OUT    ?= demo
export SVV_PARAVIEW := $(or $(PARAVIEW),$(SVV_PARAVIEW))
export TORCH
# Bytecode is kept even if the shell says otherwise: it stays in here, and without it, each start of ParaView takes 5 s longer.
unexport PYTHONDONTWRITEBYTECODE

# Paths may contain spaces: they are escaped for make and quoted for the shell.
space     := $(subst ,, )
BIN       := $(VENV)/bin
HERE      := $(subst $(space),\ ,$(VENV))
INSTALLED := $(HERE)/installed$(TORCH:%=-%)
TOOLS     := $(HERE)/tools$(TORCH:%=-%)
DOCS      := $(HERE)/docs$(TORCH:%=-%)
PIP       := "$(BIN)/python" -m pip install -qq --disable-pip-version-check --no-input --no-compile -c "$(VENV)/constraints.txt"
PYTEST    := OMP_WAIT_POLICY=passive "$(BIN)/python" -m pytest -n 2 --dist loadfile --no-loadscope-reorder

.DELETE_ON_ERROR:
.PHONY: demo test test-slow test-processors coverage check docs tools install paraview browser openvdb ready system kernels clean

demo: $(INSTALLED)
	"$(BIN)/svv" demo --out "$(OUT)" $(OPTIONS)

# Tests of what measures (bench/, campaign/) run again when something that they import has changed since they passed.
test: ready
	SVV_TESTS_UNCHANGED=skip $(PYTEST) -m "not slow"

# pip and apt fetch packages side by side. Then one CPU checks types while the other compiles the kernels, which each of
# pytest's processes would otherwise compile for itself.
ready:
	@$(MAKE) --no-print-directory -j2 tools system
	@$(MAKE) --no-print-directory -j3 check paraview kernels

system:
	@.ci/paraview "$(SVV_PARAVIEW)"
	@.ci/browser
	@.ci/openvdb

kernels: $(INSTALLED)
	@"$(BIN)/python" -m svv.job.compile_ahead

test-slow: paraview browser
	$(PYTEST) -m "slow or hypothesis" --hypothesis-profile thorough
	SVV_TESTS_FORK=0 $(PYTEST) -m "not slow" tests/paraview

# Every CPU rounds sums in a different order, and some have half precision. These runs imitate a CPU without AVX on one
# thread, one with AVX2 on two threads, and one with AMX, that last one in ParaView, too.
test-processors: $(TOOLS) paraview
	ATEN_CPU_CAPABILITY=default ONEDNN_MAX_CPU_ISA=SSE41 MKL_CBWR=COMPATIBLE OPENBLAS_CORETYPE=Nehalem \
		NUMBA_CPU_NAME=generic NUMBA_NUM_THREADS=1 OMP_NUM_THREADS=1 $(PYTEST) --ignore=tests/paraview
	ATEN_CPU_CAPABILITY=avx2 ONEDNN_MAX_CPU_ISA=AVX2 NUMBA_NUM_THREADS=2 OMP_NUM_THREADS=2 \
		$(PYTEST) --ignore=tests/paraview
	$(PYTEST) --ignore=tests/paraview -p tests.amx
	$(PYTEST) -p tests.amx -m "not slow" tests/paraview

coverage: $(TOOLS) paraview browser openvdb
	$(PYTEST) --cov --cov-report=html:build/coverage --cov-report=term:skip-covered

check: $(TOOLS)
	"$(BIN)/ruff" check .
	"$(BIN)/ruff" format --check .
	"$(BIN)/mypy"

# Warnings, such as a broken link or a page that is in no table of contents, are errors.
docs: $(DOCS)
	"$(BIN)/python" -m sphinx -W --keep-going -q -b html docs build/docs
	@echo build/docs/index.html

install: $(INSTALLED)

tools: $(TOOLS)

paraview: $(INSTALLED)
	@.ci/paraview "$(SVV_PARAVIEW)"
	@"$(BIN)/svv" paraview --prepare

# Tests of scenes' pages need it; where it can neither be found nor installed, they are skipped.
browser:
	@.ci/browser

# The same holds for tests that read volumes for Blender.
openvdb:
	@.ci/openvdb

clean:
	rm -rf "$(VENV)" .venv-paraview build docs/made docs/examples/scene.svv docs/examples/scene.html svv.egg-info bench/build bench/svv_bench.egg-info .mypy_cache .pytest_cache .ruff_cache .hypothesis

# The oldest supported Python is defined only in pyproject.toml.
$(HERE)/bin/python:
	@"$(PYTHON)" -c 'import re, sys; oldest = re.search(r"requires-python = \">=3\.(\d+)", open("pyproject.toml").read())[1]; \
		sys.exit("make needs python3 3.%s or newer; name one, for example: make test PYTHON=python3.12" % oldest \
			if sys.version_info < (3, int(oldest)) else 0)'
	@"$(PYTHON)" -m venv "$(VENV)" || \
		{ rm -rf "$(VENV)"; echo "python3 lacks venv; install it first, for example: sudo apt-get install python3-venv" >&2; exit 1; }

# torch comes first, so that no later installation brings in another build.
$(INSTALLED): pyproject.toml bench/pyproject.toml constraints.txt .ci/offscreen | $(HERE)/bin/python
	@.ci/offscreen
	@rm -f "$(VENV)"/installed* "$(VENV)"/tools* "$(VENV)"/docs*
	@echo 'Installing into $(VENV): a few minutes, once.'
	@"$(BIN)/python" -m svv.pv.launch.torch_build "$(VENV)/constraints.txt"
	@$(PIP) setuptools
	@$(PIP) --no-build-isolation -e '.[standalone,figure,cinema]' -e ./bench
	@touch "$@"

$(DOCS): $(INSTALLED)
	@echo 'Installing the packages that the documentation needs.'
	@$(PIP) --no-build-isolation -e '.[standalone,figure,cinema,notebook,docs]'
	@touch "$@"

# Packages that only the tests need, such as triton with 0.7 GB.
$(TOOLS): $(INSTALLED)
	@echo 'Installing the packages that the tests need.'
	@$(PIP) --no-build-isolation -e '.[standalone,figure,cinema,large,formats,notebook,dev]'
	@touch "$@"
