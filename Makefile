# mapfuse-robot: `make help` lists the targets. Everything is installed into .venv in this folder, nothing elsewhere.

VENV := .venv
BIN := $(VENV)/bin
DEMO_ARGS ?=
TEST_ARGS ?=
# Open3D is a large download: after so many seconds demo and test go on without it, and numpy projects depth images.
OPEN3D_WAIT_S ?= 60
# Processes that share the tests; 0: this one alone, for a debugger.
TEST_JOBS ?= 2
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# The build backend comes from the same pins (the name of this setting depends on pip's version).
export PIP_CONSTRAINT := constraints.txt
export PIP_BUILD_CONSTRAINT := constraints.txt
# Pictures are written to files: no display is asked for.
export MPLBACKEND := Agg

# mypy checks for Python 3.10 on every Python, but the types in numpy 2.2, the last for 3.10, are too coarse for it.
CHECK_TYPES = @if $(BIN)/python -c 'import sys; sys.exit(sys.version_info < (3, 11))'; \
	then echo $(BIN)/mypy; $(BIN)/mypy; else echo "mypy: left out on Python 3.10, run it on 3.11 or later"; fi

# A copied or moved checkout must not use the environment of the place it came from.
HOME_OF_VENV := $(shell cat $(VENV)/checkout 2>/dev/null)
ifneq ("$(HOME_OF_VENV)","$(CURDIR)")
MOVED := moved
endif

# Fetched before it is installed, so that running out of time leaves nothing half done.
OPEN3D := $(if $(filter x86_64,$(shell uname -m)),open3d-cpu,open3d)
FETCH_OPEN3D = $(BIN)/python -c 'import importlib.util, sys; sys.exit(not importlib.util.find_spec("open3d"))' || \
	{ timeout $(1) $(BIN)/python -m pip download --quiet --no-deps --only-binary=:all: -c constraints.txt \
	    -d $(VENV)/open3d $(OPEN3D) && $(BIN)/python -m pip install --quiet --no-deps $(VENV)/open3d/*.whl; }
INSTALL_DEPTH = { $(FETCH_OPEN3D); } && $(BIN)/python -m pip install --quiet -c constraints.txt -e '.[depth]' && \
	rm -rf $(VENV)/open3d
TRY_DEPTH = @{ $(call INSTALL_DEPTH,$(OPEN3D_WAIT_S)); } 2>$(VENV)/open3d.log || \
	echo "Open3D is left out (no wheel for this computer, or not here within $(OPEN3D_WAIT_S) s; see $(VENV)/open3d.log): numpy projects depth images. 'make setup-depth' tries again."

.PHONY: help setup setup-test setup-depth demo test lint format clean moved
.DELETE_ON_ERROR:
.DEFAULT_GOAL := help

help: ## list the targets
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/make \1:\2/p' Makefile | awk -F: '{ printf "%-16s %s\n", $$1, $$2 }'

setup: $(VENV)/setup-demo ## install what the program needs, with pictures

setup-test: $(VENV)/setup-test ## install that and the tools of the checks

setup-depth: $(VENV)/setup-demo ## install Open3D for depth images, however long its download takes
	@$(call INSTALL_DEPTH,0)

demo: $(VENV)/setup-demo ## set up, then run the demonstration (DEMO_ARGS="--seed 3 -o DIR")
	$(BIN)/mapfuse-robot demo $(DEMO_ARGS)

test: $(VENV)/setup-test ## set up, then run every check and the tests (TEST_ARGS="-k grid")
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(CHECK_TYPES)
	$(BIN)/pytest -n $(TEST_JOBS) --dist worksteal $(TEST_ARGS)

lint: $(VENV)/setup-test ## the checks without the tests
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(CHECK_TYPES)
	$(BIN)/lint-imports --no-cache

format: $(VENV)/setup-test ## format the code and mend what can be mended
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

clean: ## remove the environment and all caches
	rm -rf $(VENV) build dist .coverage htmlcov .hypothesis .mypy_cache .pytest_cache .ruff_cache .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(VENV)/setup-demo: $(VENV)/checkout pyproject.toml constraints.txt
	$(BIN)/python -m pip install --quiet -c constraints.txt -e '.[plots]'
	$(TRY_DEPTH)
	@touch $@

$(VENV)/setup-test: $(VENV)/checkout pyproject.toml constraints.txt
	$(BIN)/python -m pip install --quiet -c constraints.txt -e '.[test]'
	$(TRY_DEPTH)
	@touch $(VENV)/setup-demo $@

# The first Python of 3.10 to 3.13 makes the environment; `make PYTHON=/path/to/python` is tried before the others.
$(VENV)/checkout: $(MOVED)
	@rm -rf $(VENV); \
	for python in "$(PYTHON)" python3 python3.13 python3.12 python3.11 python3.10; do \
	    [ -n "$$python" ] || continue; \
	    "$$python" -c 'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null || continue; \
	    if ! "$$python" -c 'import ensurepip, venv' 2>/dev/null; then \
	        no_venv="$$python"; continue; \
	    fi; \
	    echo "making $(VENV) with $$python"; \
	    "$$python" -m venv $(VENV) && pwd -P >$@ && exit 0; \
	    echo "error: '$$python -m venv $(VENV)' failed: is the disk full or the folder read-only?" >&2; exit 1; \
	done; \
	if [ -n "$$no_venv" ]; then \
	    echo "error: $$no_venv cannot make virtual environments: install its venv package (Debian, Ubuntu: apt install python3-venv)" >&2; \
	else \
	    echo "error: no Python from 3.10 to 3.13 found: install one, or name it with make PYTHON=/path/to/python3" >&2; \
	fi; \
	exit 1
