# One command each; every target sets up what it needs in a .venv of its own first. Needs Python 3.11+ and make.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
ARGS ?=

.PHONY: fly test fuzz rooms mutants paper check setup format clean

fly: $(VENV)/.fly
	$(BIN)/gcs-sim fly $(ARGS)

# Three at once, since tests of processes wait more than they work: one flight at a time by real processes; the other
# tests of processes; and, giving way to both, all that only computes. Exit code 5: ARGS leave none of them.
define PYTEST
	$(BIN)/pytest -m flights $(ARGS) >$(VENV)/flights.log 2>&1 & flights=$$!; \
	$(BIN)/pytest -n 2 --dist loadfile -m 'processes and not flights' $(ARGS) >$(VENV)/processes.log 2>&1 & waiting=$$!; \
	nice -n 3 $(BIN)/pytest -n auto --maxprocesses 4 --dist loadfile -m 'not processes' $(ARGS); codes=$$?; \
	for lane in $$flights $$waiting; do wait $$lane; codes="$$codes $$?"; done; \
	cat $(VENV)/flights.log $(VENV)/processes.log; \
	for code in $$codes; do test $$code = 0 -o $$code = 5 || exit $$code; done
endef

test: $(VENV)/.test
	$(PYTEST)

fuzz: $(VENV)/.fly
	$(BIN)/python tests/fuzz/fuzz_datagrams.py $(ARGS)
	$(BIN)/python tests/fuzz/fuzz_frames.py $(ARGS)
	PYTHONPATH=tests/gcs:tests/drone_agent $(BIN)/python tests/fuzz/fuzz_flight.py $(ARGS)
	$(BIN)/python tests/fuzz/fuzz_vrpn.py $(ARGS)
	$(BIN)/python tests/fuzz/fuzz_natnet.py $(ARGS)
	$(BIN)/python tests/fuzz/fuzz_qtm.py $(ARGS)
	$(BIN)/python tests/fuzz/fuzz_vicon.py $(ARGS)

# Every shipped scenario in five rooms of turned cameras.
rooms: $(VENV)/.fly
	$(BIN)/python tests/sim/sim_rooms.py $(ARGS)

# Small wrong changes of formation/, one at a time, which its unit tests must notice: a fixed list, then drawn ones.
mutants: $(VENV)/.test
	$(BIN)/python tests/mutants/mutate.py --named
	$(BIN)/python tests/mutants/mutate.py $(ARGS)

# The paper's experiments again, some tens of minutes, and their tables into README.md and docs/paper_vehicle.md.
paper: $(VENV)/.fly
	$(BIN)/python tests/figures/paper_tables.py $(ARGS)

check: setup
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(PYTEST)

format: setup
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

setup: $(VENV)/.check

# What flies; compiled here, once, so that no flight waits for it.
$(VENV)/.fly: pyproject.toml Makefile
	$(PYTHON) -c 'import sys; assert sys.version_info >= (3, 11), "Python 3.11 or newer is needed, this is " + sys.version'
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(PIP) --editable .
	$(BIN)/gcs-sim compile
	touch $@

# What tests it: MAVProxy without the gigabyte of graphics that it names, only its prompt is used.
$(VENV)/.test: $(VENV)/.fly
	$(PIP) --editable '.[test]'
	$(PIP) --no-deps "MAVProxy>=1.8.70"
	touch $@

# What judges the code.
$(VENV)/.check: $(VENV)/.test
	$(PIP) --editable '.[dev]'
	touch $@

clean:
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .hypothesis .mutants runs
