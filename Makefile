# Everything runs in a virtual environment in $(VENV), which the targets create and fill.
#   make PYTHON=/path/to/python3.12 test      another interpreter
#   make VENV=/somewhere/else test            another place for the environment

SHELL := /bin/sh
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.SUFFIXES:

# The first of these that is new enough; python3 where none is, which leads to the message below.
CHECK_PYTHON := import sys; sys.exit(sys.version_info < (3, 11))
PYTHON ?= $(shell for p in python3.11 python3 python3.12 python3.13 python; do \
	$$p -c '$(CHECK_PYTHON)' 2>/dev/null && echo $$p && exit; done; echo python3)

VENV ?= .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet
WORKERS ?= 2
PYTEST := $(BIN)/python -m pytest
CHECKED := swim_env agents/swim_agents studies scripts

# One stamp for each set of extras. Each depends on the one before: all sets share one environment, and
# two installations must never run in it at once (make -j).
STAMP_VENV := $(VENV)/.stamp-venv
STAMP_BUILD := $(VENV)/.stamp-build
STAMP_VIEW := $(VENV)/.stamp-view
STAMP_TRAIN := $(VENV)/.stamp-train
STAMP_DEV := $(VENV)/.stamp-dev
STAMP_DOCS := $(VENV)/.stamp-docs
# An editable install finds only the top-level packages that existed when it was made.
SOURCES := pyproject.toml setup.py constraints.txt agents/swim_agents/__init__.py

.PHONY: help venv demo recording gallery benchmark accuracy stability paper docs test test-slow test-ci-slice release lint types clean

help: ## show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-14s %s\n", $$1, $$2 }' $(firstword $(MAKEFILE_LIST))

venv: $(STAMP_DEV) ## set up .venv with all that training, tests and checks need

demo: $(STAMP_TRAIN) ## set up, play the paper's wave, train an agent, compare them into results/demo
	$(BIN)/python scripts/replay.py --scene paper_i --duration 20 --output results/demo/replay
	rm -rf results/demo/train
	$(BIN)/python scripts/train.py demo --output results/demo/train
	$(BIN)/python scripts/compare.py --policies results/demo/train/seed_0 --seeds 0 1 2 \
		--output results/demo/comparison

recording: $(STAMP_TRAIN) ## set up, record an agent beside the paper's wave, and save the viewer's picture
	$(BIN)/python scripts/visualise.py --policy ppo_forward --compare-with paper_wave --noise 0 \
		--output results/recordings/agent_beside_wave.rrd \
		--picture docs/recordings/agent_beside_wave.jpg --at 14.2

benchmark: $(STAMP_DEV) ## set up and measure all costs into docs/benchmark (4 minutes, on an idle machine)
	$(BIN)/python scripts/benchmark.py --output docs/benchmark

accuracy: $(STAMP_DEV) ## set up and run the study of accuracy and cost into docs/accuracy (25 minutes)
	$(BIN)/python scripts/accuracy_cost.py --output docs/accuracy --refresh-front
	$(BIN)/python scripts/accuracy_cost.py --output docs/accuracy --sweeps
	$(BIN)/python scripts/accuracy_cost.py --output docs/accuracy --held-out

stability: $(STAMP_DEV) ## set up and play all hard cases into docs/stability (45 minutes)
	$(BIN)/python scripts/stability.py --output docs/stability

paper: $(STAMP_DEV) ## set up and compare the paper's statements with our figures in docs/paper (15 minutes)
	$(BIN)/python scripts/reproduce_paper.py --output docs/paper

gallery: $(STAMP_TRAIN) ## set up, play policies and scenes, draw them into docs/gallery (some minutes)
	$(BIN)/python scripts/gallery.py --output docs/gallery

test: $(STAMP_DEV) ## set up and run the tests (a quarter of an hour)
	$(PYTEST) -n $(WORKERS) --dist worksteal -m "not slow and not release"

test-slow: $(STAMP_DEV) ## set up and run the tests that take longer
	$(PYTEST) -n $(WORKERS) -m slow --timeout 3600

# Passes with a message while no test is marked (pytest's exit code 5). Tests of a module stay together: those
# that compile a copy of the package would do it once for each worker.
test-ci-slice: $(STAMP_DEV) ## set up and run the fixed-seed slices of the slow tests
	@code=0; $(PYTEST) -m ci_slice --collect-only -qq >/dev/null 2>&1 || code=$$?; \
	if [ $$code -eq 5 ]; then echo "no test is marked ci_slice"; else \
	set -x; $(PYTEST) -n $(WORKERS) --dist loadscope -m ci_slice --timeout 600; fi

release: $(STAMP_DEV) ## set up, list stale studies, check speed and stored results (on an idle machine)
	$(BIN)/python scripts/release.py
	$(PYTEST) -m release --timeout 600

# Strict: a broken link, a wrong formula or a tutorial that fails is an error. Every tutorial runs.
docs: $(STAMP_DOCS) ## set up and build the site into build/docs (a minute or two)
	rm -rf build/docs build/doctrees
	OMP_NUM_THREADS=1 $(BIN)/python -m sphinx -b html -n -W --keep-going -q -j 2 -d build/doctrees docs build/docs
	@echo "open build/docs/index.html"

lint: $(STAMP_DEV) ## check style and layout of the code
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(STAMP_DEV) ## check the types
	$(BIN)/mypy $(CHECKED)

clean: ## remove .venv, builds and the tools' caches; keep results
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .ruff_cache .mypy_cache .hypothesis .coverage
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(STAMP_VENV):
	@$(PYTHON) -c '$(CHECK_PYTHON)' 2>/dev/null || { \
	echo "swim-env needs Python 3.11 or later; '$(PYTHON)' is $$($(PYTHON) -V 2>&1 || true)."; \
	echo "Name another with: make PYTHON=/path/to/python3.11 $(MAKECMDGOALS)"; exit 1; } >&2
	$(PYTHON) -m venv --clear $(VENV)
	@touch $@

# The build backend in the environment itself: pinned like the rest, and installed only once.
$(STAMP_BUILD): $(STAMP_VENV) constraints.txt
	$(PIP) install -c constraints.txt setuptools
	@touch $@

$(STAMP_VIEW): $(STAMP_BUILD) $(SOURCES)
	@echo "Installing the packages to run and to view into $(VENV) (a minute or two the first time) ..."
	$(PIP) install -c constraints.txt --no-build-isolation -e ".[view]"
	@touch $@

$(STAMP_TRAIN): $(STAMP_VIEW) $(SOURCES)
	@echo "Installing the packages to train into $(VENV) (PyTorch is large) ..."
	$(PIP) install -c constraints.txt --no-build-isolation -e ".[train,view]"
	@touch $@

$(STAMP_DEV): $(STAMP_TRAIN) $(SOURCES)
	@echo "Installing the packages to compare, to test and to check into $(VENV) ..."
	$(PIP) install -c constraints.txt --no-build-isolation -e ".[train,view,bench,dev]"
	@touch $@

$(STAMP_DOCS): $(STAMP_DEV) $(SOURCES)
	@echo "Installing the packages to build the site into $(VENV) ..."
	$(PIP) install -c constraints.txt --no-build-isolation -e ".[train,view,bench,dev,docs]"
	@touch $@
