# Everything a person or CI does here. `make help` lists the targets.
.DEFAULT_GOAL := help
SHELL := /bin/bash

VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
AUDIT := build/audit
OLDEST := build/oldest
NEWEST := build/newest
# What touches every library that HLP calls, and takes a minute or two.
LIBRARY_TESTS := tests/test_geometry.py tests/test_settings.py tests/results tests/codebook tests/voting/test_cast.py \
  tests/rendering/test_rasterizer.py tests/objects/test_meshes.py tests/models tests/config/test_build.py \
  tests/stages/test_store.py tests/reporting/mlflow/test_mlflow_tracking.py tests/data/test_bop.py
UV := uv==0.13.8
TOOLS := build/tools
# Systems for which everything must be there without compiling; faiss asks for macOS 14.
PLATFORMS := aarch64-unknown-linux-gnu aarch64-apple-darwin x86_64-pc-windows-msvc
RESOLVE = MACOSX_DEPLOYMENT_TARGET=14.0 $(TOOLS)/bin/uv pip compile -q --python-version 3.11 -c constraints.txt
DOCS_STAMP := $(VENV)/.docs-installed
PYTHON ?=
WORKERS ?= 2
MINUTES ?= 10
# Each process takes the tests of its share of the folders, so that it seldom makes what another makes.
AT_ONCE = -n $(WORKERS) --dist worksteal
BROWSER ?=
SLOW ?= slow
PORT ?= 5000
WORK ?= work
REPOSITORY ?=

# Spinning threads on shared cores cost twenty times their worth; no telemetry, no windows.
export OMP_WAIT_POLICY := PASSIVE
export OMP_NUM_THREADS ?= 2
export OPENBLAS_NUM_THREADS ?= 2
export MKL_NUM_THREADS ?= 2
export MLFLOW_DISABLE_TELEMETRY := true
export MPLBACKEND := Agg
export PIP_DISABLE_PIP_VERSION_CHECK := 1
export PIP_ROOT_USER_ACTION := ignore

.PHONY: help env demo example test test-slow test-commands test-faults test-oldest test-newest fuzz check requirements platforms audit docs dist ui screenshots clean

help: ## list the targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed 's/:.*## /\t/' | expand -t 12

env: $(STAMP) ## make .venv with exact versions of everything

# torch comes first: named by a dependant, pip would take it with gigabytes of CUDA packages.
$(STAMP): pyproject.toml constraints.txt
	@python="$(PYTHON)"; \
	usable() { "$$1" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; }; \
	if [ -z "$$python" ]; then \
	  for each in python3.11 python3.12 python3.13 python3; do \
	    if usable "$$each"; then python=$$each; break; fi; \
	  done; \
	fi; \
	if [ -z "$$python" ] || ! usable "$$python"; then \
	  echo "No usable Python: HLP needs Python 3.11 or newer with the venv module" >&2; \
	  echo "(on Debian or Ubuntu: the package python3-venv). Name one with PYTHON=/path/to/python3." >&2; \
	  exit 1; \
	fi; \
	echo "Making $(VENV) with $$("$$python" --version); this takes a few minutes the first time"; \
	"$$python" -m venv $(VENV)
	@$(BIN)/pip install -q -c constraints.txt "$$(grep '^torch==' constraints.txt)"
	@$(BIN)/pip install -q -c constraints.txt -e '.[dev]'
	@touch $@

demo: $(STAMP) ## poses of synthetic objects: train, recover, score, log to MLflow
	@echo "This takes 5 to 10 minutes on two cores the first time; after a stop, the same command continues"
	@$(BIN)/hlp run work=$(WORK)

example: $(STAMP) ## make anew what `hlp predict learnt=example` shows: two minutes of computing
	@$(BIN)/python benchmarks/example.py

# Some tests start processes of their own: what these import is compiled once, also where that is not kept otherwise.
test: $(STAMP) ## the tests
	@PYTHONDONTWRITEBYTECODE= OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -q $(AT_ONCE)

test-slow: $(STAMP) ## the tests that take longer; those that need a browser fail without one if BROWSER=required
	@HLP_BROWSER=$(BROWSER) $(BIN)/python -m pytest -q $(AT_ONCE) -m "$(SLOW)"

test-commands: $(STAMP) ## the longest commands of README and docs, made small
	@$(BIN)/python -m pytest -q -m minutes tests/docs

test-faults: $(STAMP) ## those of the slow tests that stop runs at named places and damage work folders
	@$(BIN)/python -m pytest -q -m slow tests/faults

# Old versions warn of each other; that is no error.
test-oldest: $(OLDEST)/.installed ## part of the tests, with the lowest versions that pyproject.toml allows
	@$(OLDEST)/bin/python -m pytest -q -n $(WORKERS) -W default -p no:cacheprovider $(LIBRARY_TESTS)

test-newest: $(NEWEST)/.installed ## the same part of the tests, with the newest Python that is here
	@if [ -x $(NEWEST)/bin/python ]; then \
	  $(NEWEST)/bin/python -m pytest -q -n $(WORKERS) -p no:cacheprovider $(LIBRARY_TESTS); fi

$(NEWEST)/.installed: pyproject.toml constraints.txt
	@mkdir -p $(NEWEST); newest=""; \
	for each in python3.14 python3.13 python3.12 $(HOME)/.pyenv/versions/3.14.*/bin/python3 \
	  $(HOME)/.pyenv/versions/3.13.*/bin/python3 $(HOME)/.pyenv/versions/3.12.*/bin/python3; do \
	  if [ -z "$$newest" ] && "$$each" -c 'import venv, ensurepip' 2>/dev/null; then newest=$$each; fi; \
	done; \
	if [ -z "$$newest" ]; then \
	  echo "No Python after 3.11 is here: nothing was tested with one"; \
	else \
	  echo "Testing with $$("$$newest" --version)"; \
	  "$$newest" -m venv $(NEWEST) && \
	  $(NEWEST)/bin/pip install -q $(UV) "$$(grep '^torch==' constraints.txt)" && \
	  $(NEWEST)/bin/uv pip install -q --python $(NEWEST)/bin/python -c constraints.txt -e '.[dev]'; \
	fi
	@touch $@

fuzz: $(STAMP) ## files spoiled at random, MINUTES of CPU time for each reader
	@$(BIN)/python tests/fuzzing/for_minutes.py $(MINUTES)

# torch comes first here too, and stays: as an override it is taken as it was installed.
$(OLDEST)/.installed: $(STAMP)
	@$(BIN)/python -m venv $(OLDEST)
	@$(OLDEST)/bin/pip install -q $(UV) "$$(grep '^torch==' constraints.txt)"
	@$(OLDEST)/bin/pip freeze | grep '^torch==' > $(OLDEST)/torch.txt
	@$(OLDEST)/bin/uv pip install -q --python $(OLDEST)/bin/python --resolution lowest-direct \
	  --override $(OLDEST)/torch.txt -e '.[dev]'
	@touch $@

check: $(STAMP) ## style, types and layers
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/lint-imports

$(TOOLS)/bin/uv: $(STAMP)
	@$(BIN)/python -m venv $(TOOLS)
	@$(TOOLS)/bin/pip install -q $(UV)

requirements: $(TOOLS)/bin/uv ## requirements-detect.txt: what finding learnt objects needs, without what learning needs
	@$(RESOLVE) --universal --no-annotate --custom-compile-command 'make requirements' --group detect -o requirements-detect.txt

# The two that are compiled nevertheless are pure Python.
platforms: $(TOOLS)/bin/uv ## whether there is a wheel of everything for ARM Linux, macOS and Windows
	@for each in $(PLATFORMS); do \
	  $(RESOLVE) --python-platform $$each --only-binary :all: --no-binary pyopengl \
	    --no-binary antlr4-python3-runtime pyproject.toml > build/$$each.txt || exit 1; \
	  echo "$$each: a wheel of everything"; \
	done

audit: $(AUDIT)/bin/pip-audit ## known vulnerabilities of the exact versions in constraints.txt (asks PyPI)
	@$(AUDIT)/bin/pip-audit --requirement constraints.txt --no-deps --disable-pip

# In an environment of its own: it has many dependencies, and none of them are HLP's.
$(AUDIT)/bin/pip-audit: $(STAMP)
	@$(BIN)/python -m venv $(AUDIT)
	@$(AUDIT)/bin/pip install -q pip-audit==2.10.1

docs: $(DOCS_STAMP) ## the documentation as a site in build/docs; warnings are errors
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict
	@echo "Pages: build/docs/index.html (with search: $(BIN)/python -m http.server -d build/docs)"

$(DOCS_STAMP): $(STAMP)
	@$(BIN)/pip install -q -c constraints.txt -e '.[docs]'
	@touch $@

dist: $(STAMP) ## wheel and source archive in dist/; with REPOSITORY=https://HOST/OWNER/NAME, README's links lead there
	@HLP_REPOSITORY=$(REPOSITORY) $(BIN)/python -m hatchling build

ui: $(STAMP) ## browse the runs in MLflow
	@$(BIN)/hlp ui work=$(WORK) port=$(PORT)

SHOWN := build/screenshots
screenshots: docs ## what is seen first, in build/screenshots/pictures; docs/assets anew (needs Chromium and its driver)
	@$(BIN)/hlp run work=$(SHOWN)/work output=$(SHOWN)/run
	@$(BIN)/hlp -m refinement.particles=10,25,50 frames=8 panels=1 work=$(SHOWN)/work output=$(SHOWN)/sweep
	@$(BIN)/python -m pytest -q -m slow tests/browser --shown=$(SHOWN) --screenshots=$(SHOWN)/pictures
	@for each in docs/assets/*.jpg; do cp $(SHOWN)/pictures/$${each##*/} docs/assets 2>/dev/null || true; done

clean: ## remove caches and build outputs; runs and .venv stay
	@rm -rf build dist .pytest_cache .hypothesis .mypy_cache .ruff_cache .import_linter_cache
	@find src tests -name __pycache__ -type d -prune -exec rm -rf {} +
