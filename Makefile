# Two commands are enough on a fresh Debian or Ubuntu: `make mission` and `make test`. Both set up what they need.
SHELL := /bin/bash
VENV := .venv
PY := $(VENV)/bin/python
WORLD ?= demo

INTERFACES := $(shell find interfaces -name '*.msg' -o -name '*.srv' -o -name '*.action' -o -name '*.py' -o -name '*.toml' -o -name package.xml | grep -v /build/)
KERNELS := $(shell find lupin_runtime -name '_kernels.c' -o -name '*.h')
PAGE := $(shell find web -type f -not -path '*/node_modules/*' -not -path '*/dist/*')

.PHONY: setup mission test test-page test-core test-graph test-host test-mission lint bench lock wheel clean

setup: $(VENV)/.lupin $(VENV)/.page

mission: setup
	$(VENV)/bin/lupin up --mission --headless --world $(WORLD)

# The four stages of the tests. Cores run side by side. Tests that talk over DDS run one after another, since their peers are
# processes that need the cores themselves. Booted computers mostly wait, and a mission keeps its own pace, so several run at once.
PYTEST := $(PY) -m pytest -q --durations=12 --durations-min=5
test: setup lint test-page test-core test-graph test-host test-mission

test-core: setup
	$(PYTEST) -n 2 $(COVERAGE) -m "not graph and not sim and not host and not mission" tests

test-page: setup
	$(PY) tools/build_page.py test
	$(PY) tools/build_page.py e2e

test-graph: setup
	$(PYTEST) -m "(graph or sim) and not host and not mission" tests

test-host: setup
	$(PYTEST) -n 3 --dist loadfile -m "host and not mission" tests

test-mission: setup
	$(PYTEST) -n 2 --dist worksteal -m mission tests

lint: setup
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/mypy
	$(VENV)/bin/lint-imports
	$(PY) tools/build_page.py lint

bench: setup
	$(PY) -m bench

# One wheel with interfaces, kernels, playbooks and units: `pipx install dist/lupin-*.whl` needs no compiler and no checkout.
wheel: setup
	$(PY) tools/build_wheel.py dist

# The lock file: every package with its hashes, and no word of where they came from. Extras stay in it: pip 23 would choose the
# newest version, which has no hash here, for a package that another one requires with an extra.
lock: setup
	$(PY) -m pip install -q uv
	$(VENV)/bin/uv pip compile pyproject.toml --extra dev --generate-hashes --no-strip-extras --python-version 3.11 \
	  --python-platform x86_64-manylinux_2_28 --no-header --no-annotate --no-emit-package lupin-interfaces \
	  --output-file requirements.lock

$(VENV)/.system: tools/system-packages
	tools/system-packages
	python3 -m venv $(VENV)
	touch $@

$(VENV)/.packages: $(VENV)/.system requirements.lock
	$(PY) -m pip install -q --disable-pip-version-check --require-hashes -r requirements.lock
	touch $@

# The generators come from un-prefixed packages that carry several distributions' versions: hold them to the lock file's.
$(VENV)/.interfaces: $(VENV)/.packages $(INTERFACES)
	sed -n 's/\[[^]]*\]//; s/^\(ros-[^ ]*==[^ ]*\).*/\1/p' requirements.lock > $(VENV)/ros-constraints.txt
	PIP_CONSTRAINT=$(CURDIR)/$(VENV)/ros-constraints.txt $(PY) -m pip install -q --disable-pip-version-check \
	  --no-deps --force-reinstall ./interfaces
	touch $@

$(VENV)/.lupin: $(VENV)/.interfaces pyproject.toml setup.py $(KERNELS)
	$(PY) -m pip install -q --disable-pip-version-check --no-deps --no-build-isolation -e .
	$(PY) -m compileall -q lupin_cli lupin_runtime lupin_sim
	touch $@

# The console's page, which the package carries. Node comes with the environment where the system's is too old for it.
$(VENV)/.page: $(VENV)/.packages $(PAGE) tools/build_page.py
	$(PY) tools/build_page.py
	touch $@

clean:
	rm -rf lupin_runtime/console/page web/node_modules web/dist
	rm -rf $(VENV) build *.egg-info
	find lupin_runtime lupin_cli lupin_sim -name '*.so' -delete
