# make demo    the built-in study, end to end: what does its model leave out? Its report is demo_out/report.html
# make prove   concealed cases of all plants, diagnosed blind, and the scorecard (hours; prove_out/ keeps what is done)
# make calibrate  false alarms on clean recordings, and power against strength (hours; calibrate_out/ keeps what is done)
# make test    lint, types, every test but a few that take minutes: quick ones on the built wheel in a bare environment, the others here
# make lint | types | unit | slow | cover | wheel | bench | lock | clean
#
# Needs make and Python 3.11 or newer; everything else is installed into .venv, at the versions of requirements.lock.
# Another interpreter: make PYTHON=/path/to/python3.12 demo

SHELL := /bin/sh
VENV := .venv
BUILD := .build
BIN := $(VENV)/bin
BARE := $(BUILD)/bare
CORES := -n auto --dist loadfile --no-loadscope-reorder
PIP := -m pip --disable-pip-version-check --quiet
export HYPOTHESIS_STORAGE_DIRECTORY := $(CURDIR)/$(BUILD)/hypothesis

# Candidates are run, not only found: a pyenv shim may stand on the path and yet have no interpreter behind it.
CANDIDATES := python3.13 python3.12 python3.11 python3.14 python3 python
PYTHON ?= $(shell for p in $(CANDIDATES); do \
	if $$p -c 'import ensurepip, sys, venv; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1; then command -v $$p; break; fi; done)

.PHONY: help demo test lint types unit slow cover wheel bench prove calibrate lock clean
.DELETE_ON_ERROR:

help:
	@sed -n 's/^# make/make/p' Makefile

demo: $(VENV)/.installed
	$(BIN)/backsight demo --out demo_out

# Both environments are made side by side; tests have all cores for themselves, whatever -j says.
test:
	@$(MAKE) -j2 lint types $(BARE)/.installed
	@$(MAKE) wheel
	@$(MAKE) slow

lint: $(VENV)/.installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.installed
	$(BIN)/mypy

# All tests, here.
unit: $(VENV)/.installed
	OPENBLAS_NUM_THREADS=1 $(BIN)/pytest $(CORES) --durations=40

# Those that the wheel is not tested by, but for some that take their time beside others that look at the same.
slow: $(VENV)/.installed
	OPENBLAS_NUM_THREADS=1 $(BIN)/pytest $(CORES) --durations=40 -m "(slow or checkout) and not long"

# Which lines and branches the tests pass.
cover: $(VENV)/.installed
	OPENBLAS_NUM_THREADS=1 $(BIN)/pytest $(CORES) --cov --cov-report=term:skip-covered

# The quick tests, against the wheel in an environment without the checkout: what is missing from the package list fails here.
wheel: $(VENV)/.installed $(BARE)/.installed
	rm -rf $(BUILD)/dist $(BUILD)/installed backsight.egg-info
	$(BIN)/python -m build --no-isolation --outdir $(BUILD)/dist . >$(BUILD)/dist.log 2>&1 || { cat $(BUILD)/dist.log; exit 1; }
	$(BARE)/bin/python $(PIP) install --no-deps --force-reinstall $(BUILD)/dist/backsight-*.whl
	mkdir $(BUILD)/installed
	cp -R tests pyproject.toml $(BUILD)/installed/
	cd $(BUILD)/installed && OPENBLAS_NUM_THREADS=1 ../bare/bin/pytest $(CORES) --durations=40 -m "not slow and not checkout" -o cache_dir=.pytest_cache

bench: $(VENV)/.installed
	$(BIN)/python tests/benchmarks/bench.py
	$(BIN)/python tests/benchmarks/compile.py
	$(BIN)/python tests/benchmarks/columns.py
	$(BIN)/python tests/benchmarks/tracking.py
	$(BIN)/python tests/benchmarks/weighing.py

prove: $(VENV)/.installed
	$(BIN)/python tests/studies/prove.py --out prove_out

calibrate: $(VENV)/.installed
	$(BIN)/python tests/studies/calibrate.py --out calibrate_out

lock: $(BUILD)/lock/.installed
	$(BUILD)/lock/bin/uv pip compile --universal --python-version 3.11 --fork-strategy fewest --generate-hashes --all-extras \
		--no-header --no-emit-index-url --upgrade --quiet --output-file requirements.lock pyproject.toml

clean:
	rm -rf $(VENV) $(BUILD) demo_out build dist backsight.egg-info
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# Stamps: an environment is made again only when what it was made from has changed.
# The lock is complete. Without --no-deps, pip before 23.3 looks beyond it for what is required with an extra (coverage[toml]),
# and refuses the first release that is newer than the lock.
$(VENV)/.installed: requirements.lock pyproject.toml
	@$(call environment,$(VENV))
	$(VENV)/bin/python $(PIP) install --no-deps --require-hashes --requirement requirements.lock
	$(VENV)/bin/python $(PIP) install --no-deps --no-build-isolation --editable .
	@touch $@

# Only what a user gets, and pytest: the declared dependencies at the locked versions, no extras.
# (pip wants every requirement pinned beside hashes, so the lock serves here as constraints, without them.)
$(BARE)/.installed: requirements.lock pyproject.toml
	@$(call environment,$(BARE))
	sed -n 's/^\([A-Za-z0-9._-]*==[^\]*\)\\$$/\1/p' requirements.lock >$(BARE)/pins
	$(BARE)/bin/python -c 'import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["dependencies"], sep="\n")' >$(BARE)/needs
	$(BARE)/bin/python $(PIP) install --constraint $(BARE)/pins --requirement $(BARE)/needs pytest pytest-xdist hypothesis
	@touch $@

$(BUILD)/lock/.installed:
	@$(call environment,$(BUILD)/lock)
	$(BUILD)/lock/bin/python $(PIP) install uv
	@touch $@

# A virtual environment at $(1), kept when it still works.
define environment
	test -n "$(PYTHON)" || { echo "error: no Python 3.11 or newer with the venv and ensurepip modules on the path; install one, or name it: make PYTHON=/path/to/python3" >&2; exit 1; }; \
	$(1)/bin/python -c 'import pip' 2>/dev/null || { echo "making $(1) with $(PYTHON)"; rm -rf $(1); mkdir -p $(dir $(1)); "$(PYTHON)" -m venv $(1); }
endef
