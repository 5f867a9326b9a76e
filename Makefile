# One virtual environment, .venv, with the package (editable), ROS 2 Jazzy and all test tools.
# PYTHON=/path/to/python chooses the interpreter; otherwise tools/find_python looks for one.
SHELL := /bin/bash
.DEFAULT_GOAL := help
.PHONY: help setup demo paper test lint clean FORCE

VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/made_in
DEMO := runs/demo

# A virtual environment does not survive a moved folder or a removed interpreter.
ifneq ($(file <$(STAMP)),$(CURDIR))
STALE := FORCE
else ifneq ($(shell $(BIN)/python -c 'print("works")' 2>&1),works)
STALE := FORCE
endif

help: ## this list
	@sed -n 's/^\([a-z]*\):.*## /  make \1	/p' $(MAKEFILE_LIST)

setup: $(STAMP) ## build .venv with everything the package and its tests need

$(STAMP): setup.py pyproject.toml tools/find_python Makefile $(STALE)
	@set -e; rm -f $@; \
	if [ -n "$(STALE)" ]; then \
	  python="$$(tools/find_python $(PYTHON))"; \
	  echo "setup: $(VENV) from $$python ($$("$$python" -V)), the first time takes some minutes"; \
	  "$$python" -m venv --clear $(VENV); \
	fi; \
	extras=ros,test; if $(BIN)/python -c 'import rclpy' 2>/dev/null; then extras=test; fi; \
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[$$extras]"; \
	printf '%s' '$(CURDIR)' >$@; echo "setup: done, $(BIN)/platoon is ready"

demo: setup ## run case A of the paper on ROS 2 nodes, record it, judge it
	@set -e; run="$(DEMO)-$$(date -u +%Y%m%dT%H%M%SZ)"; \
	$(BIN)/platoon run config/paper_a.yaml -o "$$run"; \
	echo; echo "Open $$run/report.html in a browser to see the run."

paper: setup ## repeat the paper: its three cases on ROS 2 nodes, every figure, a comparison
	$(BIN)/platoon paper

test: lint ## check the style and types, then run every test
	$(BIN)/python -m pytest

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/codespell

clean: ## remove .venv and everything built; runs/ stays
	rm -rf $(VENV) build install log .mypy_cache .ruff_cache .pytest_cache .hypothesis *.egg-info
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

FORCE:
