# One command each; every target sets up its own .venv first. Needs Python 3.11+ and make.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
ARGS ?=

.PHONY: fly test fuzz check setup format lint types imports clean

fly: setup
	$(BIN)/gcs-sim fly $(ARGS)

test: setup
	$(BIN)/pytest $(ARGS)

fuzz: setup
	$(BIN)/python tests/fuzz/fuzz_datagrams.py $(ARGS)
	$(BIN)/python tests/fuzz/fuzz_frames.py $(ARGS)

check: setup
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/pytest

format: setup
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

setup: $(VENV)/.ready

# MAVProxy, for the conformance tests, without the gigabyte of graphics that it names: only its prompt is used.
$(VENV)/.ready: pyproject.toml Makefile
	$(PYTHON) -c 'import sys; assert sys.version_info >= (3, 11), "Python 3.11 or newer is needed, this is " + sys.version'
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps "MAVProxy>=1.8.70"
	touch $@

clean:
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .hypothesis runs
