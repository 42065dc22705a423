# Two commands are enough on a fresh Debian or Ubuntu: `make mission` and `make test`. Both set up what they need.
SHELL := /bin/bash
VENV := .venv
PY := $(VENV)/bin/python
WORLD ?= demo

INTERFACES := $(shell find interfaces -name '*.msg' -o -name '*.srv' -o -name '*.action' -o -name '*.py' -o -name '*.toml' -o -name package.xml | grep -v /build/)
KERNELS := $(shell find lupin_runtime -name '_kernels.c')

.PHONY: setup mission test lint bench lock clean

setup: $(VENV)/.lupin

mission: setup
	$(VENV)/bin/lupin up --mission --headless --world $(WORLD)

# Cores side by side; what talks over DDS one after another, since its peers are processes that want the cores themselves. Booted
# computers mostly wait, and missions keep their own time, so several go side by side. A busy machine may stall a peer past its
# bound: what failed runs once more, alone, and what fails twice fails.
ONE_BY_ONE := -m "(graph or sim) and not host and not mission"
HOSTS := -m "host and not mission"
MISSIONS := -m mission
CORES := -m "not graph and not sim and not host and not mission"
test: setup lint
	$(PY) -m pytest -q -n 2 $(CORES) tests || $(PY) -m pytest -q --last-failed $(CORES) tests
	$(PY) -m pytest -q $(ONE_BY_ONE) tests || $(PY) -m pytest -q --last-failed $(ONE_BY_ONE) tests
	$(PY) -m pytest -q -n 3 --dist loadfile $(HOSTS) tests || $(PY) -m pytest -q --last-failed $(HOSTS) tests
	$(PY) -m pytest -q -n 2 --dist worksteal $(MISSIONS) tests || $(PY) -m pytest -q --last-failed $(MISSIONS) tests

lint: setup
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/mypy
	$(VENV)/bin/lint-imports

bench: setup
	$(PY) -m bench

# The lock file: every package with its hashes, and no word of where they came from.
lock: setup
	$(PY) -m pip install -q uv
	$(VENV)/bin/uv pip compile pyproject.toml --extra sim --extra dev --generate-hashes --python-version 3.11 \
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
	sed -n 's/^\(ros-[^ ]*==[^ ]*\).*/\1/p' requirements.lock > $(VENV)/ros-constraints.txt
	PIP_CONSTRAINT=$(CURDIR)/$(VENV)/ros-constraints.txt $(PY) -m pip install -q --disable-pip-version-check \
	  --no-deps --force-reinstall ./interfaces
	touch $@

$(VENV)/.lupin: $(VENV)/.interfaces pyproject.toml setup.py $(KERNELS)
	$(PY) -m pip install -q --disable-pip-version-check --no-deps --no-build-isolation -e .
	$(PY) -m compileall -q lupin_cli lupin_runtime lupin_sim
	touch $@

clean:
	rm -rf $(VENV) build *.egg-info
	find lupin_runtime lupin_cli lupin_sim -name '*.so' -delete
