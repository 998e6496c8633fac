# A fresh machine needs Python 3.11 or newer (with pip and venv), git and make. Everything else is put into .venv.
#
#   make demo    measure a simulated sensor, and print where the report is
#   make test    all tests but those of `make dozen`
#   make check   lint, types, import contracts, quick tests, wheel
#   make bench   speed, side by side
#   make verify  the fast engine against the reference engine, 1e5 pulses at each of many settings (under 40 minutes)
#   make soak    200 kills, each with a resume, and a night of 12 h of bench time with a fault every 20 minutes
#   make dozen   gross cases of the planted-effect study, merged runs and a user's effect, as tests (half an hour; part of CI)
#   make study   plant effects in 306 runs and diagnose each (hours; it goes on where it was stopped)

PYTHON ?= python3
VENV   ?= .venv
SEED   ?= 1
# As many processes as processors take the tests; WORKERS=0 takes them in one, for a debugger. A process that has come
# to the end of its tests takes half of what another has left, so neighbours mostly share their fixtures.
WORKERS ?= logical
# Cases of the planted-effect study that run side by side.
STUDY_WORKERS ?= $(shell getconf _NPROCESSORS_ONLN)
BIN    := $(VENV)/bin
PIP    := $(BIN)/python -m pip --disable-pip-version-check
# Hundreds of processes are started: they keep what they compile, whatever the environment says.
PYTEST := PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -n $(WORKERS) --maxprocesses 8 --dist worksteal

# Each level of the environment is a stamp, so that `make demo` does not wait for what only the developers need.
RUN_ENV  := $(VENV)/.ready-run
TEST_ENV := $(VENV)/.ready-test
DEV_ENV  := $(VENV)/.ready-dev

.PHONY: help demo test quick check lint types contracts wheel bench verify soak dozen study lock clean
.DELETE_ON_ERROR:

help:
	@sed -n 's/^#   //p' Makefile

demo: $(RUN_ENV)
	$(BIN)/evs-bench demo --seed $(SEED)

test: $(TEST_ENV)
	$(PYTEST)

quick: $(TEST_ENV)
	$(PYTEST) -m "not slow"

check: lint types contracts quick wheel

lint: $(DEV_ENV)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(DEV_ENV)
	$(BIN)/mypy

contracts: $(DEV_ENV)
	$(BIN)/lint-imports

wheel: $(DEV_ENV)
	$(BIN)/python .ci/check_wheel.py

bench: $(TEST_ENV)
	$(BIN)/python benchmarks/decode.py
	$(BIN)/python benchmarks/engine.py
	$(BIN)/python benchmarks/fast_engine.py

verify: $(TEST_ENV)
	$(BIN)/python benchmarks/equal_statistics.py

soak: $(TEST_ENV)
	$(BIN)/python -m benchmarks.soak

dozen: $(TEST_ENV)
	$(PYTEST) -m dozen tests/benchmarks/planted

study: $(TEST_ENV)
	$(BIN)/python -m benchmarks.planted --seed $(SEED) --workers $(STUDY_WORKERS)

lock:
	.ci/lock

clean:
	rm -rf $(VENV) build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "evs-bench needs Python 3.11 or newer; say which with: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(RUN_ENV): pyproject.toml requirements.lock | $(BIN)/python
	$(PIP) install --quiet -c requirements.lock -e .
	@touch $@

$(TEST_ENV): $(RUN_ENV)
	$(PIP) install --quiet -c requirements.lock -e '.[test]'
	@touch $@

$(DEV_ENV): $(TEST_ENV)
	$(PIP) install --quiet -c requirements.lock -e '.[dev]'
	@touch $@
