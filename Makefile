# Two commands are enough on a fresh Debian or Ubuntu: `make mission` and `make test`. Both set up what they need.
SHELL := /bin/bash
VENV := .venv
PY := $(VENV)/bin/python
WORLD ?= demo

INTERFACES := $(shell find interfaces -name '*.msg' -o -name '*.srv' -o -name '*.action' -o -name '*.py' -o -name '*.toml' -o -name package.xml | grep -v /build/)
KERNELS := $(shell find lupin_runtime -name '_kernels.c' -o -name '*.h')
PAGE := $(shell find web -type f -not -path '*/node_modules/*' -not -path '*/dist/*' -not -path '*/generated/*')
TABLES := tools/write_page_types.py $(shell find lupin_runtime lupin_sim -name '*.py') # of which modules of the page are made

.PHONY: setup mission test test-long test-page test-core test-graph test-graph-busy test-host test-mission test-live judge coverage lint bench lock wheel clean

setup: $(VENV)/.lupin $(VENV)/.page

mission: setup
	$(VENV)/bin/lupin up --mission --headless --world $(WORLD)

# `make test` is the check: at most 30 minutes. `make test-long` runs everything else; a test has the marker `long` if it takes more
# than 20 s or needs statistics. The core and the page's units have no clock: cores run side by side, and nothing gets a second try.
# The other stages run one test at a time, since graph, simulator and booted computers need the cores themselves; a test that fails
# there is run again alone, and counted (tools/second_try.py).
LENGTH := not long
PAGE_TESTS := layout stop
PYTEST_OPTIONS := --durations=12 --durations-min=5
AGAIN := $(PY) -m tools.second_try
TIMED_STAGES := page graph host mission

test: setup lint test-core test-page test-graph test-host test-mission judge

test-long: LENGTH := long
test-long: PAGE_TESTS :=
test-long: setup test-core test-page test-graph test-host test-mission test-live judge

test-core: setup
	$(PY) -m pytest -q $(PYTEST_OPTIONS) -n 2 -m "not graph and not sim and not host and not mission and $(LENGTH)" tests

coverage: setup
	$(PY) -m pytest -q -n 2 --cov=lupin_cli --cov=lupin_runtime --cov=lupin_sim --cov-report=term:skip-covered \
	  -m "not graph and not sim and not host and not mission" tests

test-page: setup
	$(PY) tools/build_page.py test
	$(AGAIN) playwright page $(PAGE_TESTS)

test-graph: setup
	$(AGAIN) pytest graph $(PYTEST_OPTIONS) -m "(graph or sim) and not host and not mission and $(LENGTH)" tests

test-host: setup
	$(AGAIN) pytest host $(PYTEST_OPTIONS) -m "host and not mission and $(LENGTH)" tests

test-mission: setup
	$(AGAIN) pytest mission $(PYTEST_OPTIONS) -m "mission and $(LENGTH)" tests

# Graph tests beside four busy loops, without a second try: what fails here depends on the time that the machine has.
BESIDE_LOAD := tests
test-graph-busy: setup
	$(PY) -m tools.busy_loops 4 $(PY) -m pytest -q $(PYTEST_OPTIONS) -m "(graph or sim) and not host and not mission and $(LENGTH)" $(BESIDE_LOAD)

# The page in Chromium against whole runs, about twenty minutes.
test-live: setup
	$(PY) tools/build_page.py live

judge: setup
	$(AGAIN) judge $(TIMED_STAGES)

lint: setup
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/mypy
	$(VENV)/bin/lint-imports
	$(PY) tools/build_page.py lint

bench: setup
	$(PY) -m bench

# One wheel with interfaces, kernels, playbooks and units, which needs no compiler and no checkout, and its constraints for pip.
wheel: setup
	$(PY) tools/build_wheel.py dist

# The lock files: every package with its hashes, and no word of where they came from.
LOCK := $(VENV)/bin/uv pip compile --generate-hashes --python-version 3.11 --python-platform x86_64-manylinux_2_34 \
  --no-header --no-annotate --no-emit-package lupin-interfaces
lock: setup
	$(PY) -m pip install -q uv
	$(LOCK) pyproject.toml --extra dev --output-file requirements.lock
	$(LOCK) bench/peers/requirements.txt --output-file bench/peers/requirements.lock
	$(LOCK) bench/peers/rosbridge_suite.txt --output-file bench/peers/rosbridge_suite.lock
	$(LOCK) tests/support/roslibpy.txt --output-file tests/support/roslibpy.lock

$(VENV)/.system: tools/system-packages
	tools/system-packages
	python3 -m venv $(VENV)
	touch $@

# Nothing is resolved here, since pip would take from the index, in its newest version, what another package requires with an extra:
# the lock is complete, and `pip check` and tests/tools/test_lock.py say so. setuptools and wheel come first: they build what the index
# has as source only (empy 3), the interfaces and Lupin.
PIP := $(PY) -m pip install -q --disable-pip-version-check --no-deps
$(VENV)/.packages: $(VENV)/.system requirements.lock
	sed -n '/^\(setuptools\|wheel\)==/,/[^\]$$/p' requirements.lock > $(VENV)/build.lock
	$(PIP) --require-hashes -r $(VENV)/build.lock
	$(PIP) --require-hashes --no-build-isolation -r requirements.lock
	touch $@

$(VENV)/.interfaces: $(VENV)/.packages $(INTERFACES)
	$(PIP) --no-build-isolation --force-reinstall ./interfaces
	touch $@

$(VENV)/.lupin: $(VENV)/.interfaces pyproject.toml setup.py $(KERNELS)
	$(PIP) --no-build-isolation -e .
	$(PY) -m pip check
	$(PY) -m compileall -q lupin_cli lupin_runtime lupin_sim
	touch $@

# The console's page, which the package carries. Node comes with the environment where the system's is too old for it.
$(VENV)/.page: $(VENV)/.lupin $(PAGE) $(TABLES) tools/build_page.py
	$(PY) tools/build_page.py
	touch $@

clean:
	rm -rf lupin_runtime/console/page web/node_modules web/dist web/src/generated
	rm -rf $(VENV) build *.egg-info
	find lupin_runtime lupin_cli lupin_sim -name '*.so' -delete
