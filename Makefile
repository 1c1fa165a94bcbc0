# One command each; every target sets up what it needs in a .venv of its own first. Needs Python 3.11+ and make.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
SUPPLY := $(VENV)/supply
ARGS ?=

.PHONY: fly test nightly slow campaign fuzz mutants paper docs samples reference pictures lock audit wheel check lint setup format clean

fly: $(VENV)/.fly
	$(BIN)/gcs-sim fly $(ARGS)

# Three at once, since tests of processes wait more than they work: one flight at a time by real processes; the other
# tests of processes; and, giving way to both, all that only computes. Exit code 5: ARGS leave none of them.
# Bytecode is kept, whatever the environment says: else each of some hundred processes compiles every module anew.
define PYTEST
	$(BIN)/gcs-sim compile
	export PYTHONDONTWRITEBYTECODE=; \
	$(BIN)/pytest -m 'flights and not nightly' $(ARGS) >$(VENV)/flights.log 2>&1 & flights=$$!; \
	$(BIN)/pytest -n 2 --dist loadfile -m 'processes and not flights and not nightly' $(ARGS) \
		>$(VENV)/processes.log 2>&1 & waiting=$$!; \
	nice -n 3 $(BIN)/pytest -n auto --maxprocesses 4 --dist loadfile -m 'not processes and not nightly' $(ARGS); codes=$$?; \
	for lane in $$flights $$waiting; do wait $$lane; codes="$$codes $$?"; done; \
	cat $(VENV)/flights.log $(VENV)/processes.log; \
	for code in $$codes; do test $$code = 0 -o $$code = 5 || exit $$code; done
endef

test: $(VENV)/.test
	$(PYTEST)

# Long, and seldom to fail where `make test` passes: every Python's wheel, every page's commands, random faults with
# each monitor's positive control, random bytes, mutants. About an hour and a half on two cores.
nightly:
	.ci/wheels
	$(MAKE) slow campaign fuzz mutants

# The tests marked `nightly`, with other random examples every time.
slow: $(VENV)/.test
	$(BIN)/pytest -m nightly --hypothesis-profile=searching $(ARGS)

# Random faults, and each monitor's positive control.
campaign: $(VENV)/.fly
	$(BIN)/gcs-sim campaign --runs 60 --seed 7 --controls 1

fuzz: $(VENV)/.fly
	$(BIN)/python -m tools.fuzz $(ARGS)

# Small wrong changes of formation/, one at a time, which its unit tests must notice: a fixed list, then drawn ones.
mutants: $(VENV)/.test
	$(BIN)/python -m tools.mutants.mutate --named
	$(BIN)/python -m tools.mutants.mutate $(ARGS)

# The paper's experiments again, some tens of minutes, into docs/paper; the manual's tables are made from there.
paper: $(VENV)/.fly
	$(BIN)/python -m tools.figures.paper_tables $(ARGS)

# The manual, into docs/manual/_build/html; a warning, a broken local link too, is an error.
docs: $(VENV)/.docs
	$(BIN)/sphinx-build -q -E -W --keep-going -b html docs/manual docs/manual/_build/html
	@echo "the manual: docs/manual/_build/html/index.html"

# What flights leave, made now, into the built manual: a report, a league's page, the rules, a what-if, a foretold flight.
SAMPLES := docs/manual/_build/html/samples
samples: docs
	rm -rf $(SAMPLES) $(VENV)/samples
	mkdir -p $(SAMPLES)
	$(BIN)/gcs-sim run triangle_circle --out $(VENV)/samples
	cp $(VENV)/samples/report.html $(SAMPLES)/report.html
	$(BIN)/gcs-sim league default paper_istsmc pid --scene circle --vehicle paper_40g --out $(SAMPLES)
	$(BIN)/gcs rules > $(SAMPLES)/rules.md
	$(BIN)/gcs-log whatif $(VENV)/samples/flight.mcap --law pid --out $(SAMPLES)/whatif.html
	$(BIN)/gcs-sim foretell $(VENV)/samples/flight.mcap > $(SAMPLES)/foretold.txt

# What the manual says of commands, keys, messages and tables, anew from the code into its pages. A test holds it fresh.
reference: $(VENV)/.fly
	$(BIN)/python -m tools.reference

# The pictures of README and manual again, but for Rerun's window. The page's need Chromium.
pictures: $(VENV)/.test
	$(BIN)/gcs-sim run triangle_circle --out $(VENV)/pictures
	$(BIN)/gcs-log picture $(VENV)/pictures/flight.mcap --overwrite --out docs/flight.png
	$(BIN)/gcs-log picture $(VENV)/pictures/flight.mcap --gif --overwrite --out docs/flight.gif
	$(BIN)/python -m tools.figures.page_pictures docs/page

# The newest version of every package that is needed, with hashes, into requirements.txt. uv is no part of what is tested.
lock: $(VENV)/.fly
	$(PIP) uv
	head -3 requirements.txt > $(VENV)/requirements.txt
	$(BIN)/uv pip compile pyproject.toml --extra all --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-header \
		--upgrade --quiet --output-file $(VENV)/lock.txt
	cat $(VENV)/lock.txt >> $(VENV)/requirements.txt
	mv $(VENV)/requirements.txt requirements.txt

# Known vulnerabilities of what is locked; says so, and fails, where no database is reached. pip-audit has its own .venv.
audit: $(VENV)/.supply
	$(SUPPLY)/bin/python -m tools.audit

# Wheel and sdist into dist/, and beside them what the wheel needs, as CycloneDX.
wheel: $(VENV)/.supply
	rm -rf dist
	$(SUPPLY)/bin/python -m build --sdist --wheel .
	$(SUPPLY)/bin/cyclonedx-py requirements --pyproject pyproject.toml --output-reproducible --spec-version 1.6 \
		--output-file "$$(ls dist/*.whl | sed 's/whl$$/cdx.json/')" requirements.txt
	@ls dist

check: lint
	$(PYTEST)

lint: setup
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m tools.words

format: setup
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

setup: $(VENV)/.check

# What flies; compiled here, once, so that no flight waits for it.
$(VENV)/.fly: pyproject.toml Makefile
	$(PYTHON) -c 'import sys; assert sys.version_info >= (3, 11), "Python 3.11 or newer is needed, this is " + sys.version'
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(PIP) --editable '.[all]'
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

# What judges the packages, apart from them: it needs other versions of some.
$(VENV)/.supply: $(VENV)/.fly
	$(PYTHON) -m venv $(SUPPLY)
	$(SUPPLY)/bin/python -m pip install --quiet --disable-pip-version-check build pip-audit cyclonedx-bom
	touch $@

# What builds the manual.
$(VENV)/.docs: $(VENV)/.fly
	$(PIP) --editable '.[docs]'
	touch $@

clean:
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .hypothesis .mutants runs docs/manual/_build
