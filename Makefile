# One virtual environment, .venv, with the package (editable), ROS 2 Jazzy and all test tools; for
# test-oldest a second one. PYTHON=/path/to/python chooses the interpreter; otherwise
# tools/find_python looks for one.
SHELL := /bin/bash
.DEFAULT_GOAL := help
.PHONY: help setup demo paper test test-quick test-oldest campaign soak coverage lint clean FORCE

VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/made_in
ROS_ELSEWHERE := import rclpy, sys; sys.exit(rclpy.__file__.startswith(sys.prefix))
DEMO := runs/demo
SEED := 1
COUNT := 500
FAULTS := 200
DESIGNS := 200
CHANNELS := 45
JOBS := 2
MINUTES := 30

OLDEST := .venv-oldest
OLDEST_STAMP := $(OLDEST)/made_in
OLDEST_PYTHON := 3.11
ONE_RUN := test/system/test_reproducibility.py::test_number_of_processes_does_not_matter[2]

# A virtual environment does not survive a moved folder or a removed interpreter.
ifneq ($(file <$(STAMP)),$(CURDIR))
STALE := FORCE
else ifneq ($(shell $(BIN)/python -c 'print("works")' 2>&1),works)
STALE := FORCE
endif

help: ## this list
	@sed -n 's/^\([a-z-]*\):.*## /  make \1	/p' $(MAKEFILE_LIST)

setup: $(STAMP) ## build .venv with everything the package and its tests need

$(STAMP): setup.py pyproject.toml tools/find_python Makefile $(STALE)
	@set -e; rm -f $@; \
	if [ -n "$(STALE)" ]; then \
	  python="$$(tools/find_python $(PYTHON))"; \
	  echo "setup: $(VENV) from $$python ($$("$$python" -V)), the first time takes some minutes"; \
	  "$$python" -m venv --clear $(VENV); \
	fi; \
	extras=ros,test; if $(BIN)/python -c '$(ROS_ELSEWHERE)' 2>/dev/null; then extras=test; fi; \
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[$$extras]"; \
	printf '%s' '$(CURDIR)' >$@; echo "setup: done, $(BIN)/platoon is ready"

demo: setup ## run case A of the paper on ROS 2 nodes, record it, judge it
	@set -e; run="$(DEMO)-$$(date -u +%Y%m%dT%H%M%SZ)"; \
	$(BIN)/platoon run config/paper_a.yaml -o "$$run"; \
	echo; echo "Open $$run/report.html in a browser to see the run."

paper: setup ## repeat the paper: its three cases on ROS 2 nodes, every figure, a comparison
	$(BIN)/platoon paper

test: lint ## check the style and types, then run every test
	$(BIN)/python -m pytest -m "unit or report" -n auto --dist worksteal
	$(BIN)/python -m pytest -m "ros or system" -n 4 --dist worksteal

test-quick: setup ## run the unit tests but the slow ones: no processes, no DDS
	$(BIN)/python -m pytest -m "unit and not slow" -n auto --dist worksteal --hypothesis-profile quick

test-oldest: $(OLDEST_STAMP) ## quick unit tests and one real run with the oldest versions, on Python 3.11
	nice -n 19 $(OLDEST)/bin/python -m pytest -m "unit and not slow" -n auto --dist worksteal --hypothesis-profile few
	$(OLDEST)/bin/python -m pytest '$(ONE_RUN)'

$(OLDEST_STAMP): setup.py pyproject.toml test/oldest.txt
	@set -e; rm -f $@; python="$$(tools/find_python $(OLDEST_PYTHON))"; \
	"$$python" -m venv --clear $(OLDEST); \
	$(OLDEST)/bin/python -m pip install --quiet --disable-pip-version-check \
	  --constraint test/oldest.txt -e '.[ros,test]'; \
	printf '%s' '$(CURDIR)' >$@

campaign: setup ## search for what breaks a rule: COUNT=500 hostile inputs of each kind, FAULTS=200 of platoons, DESIGNS=200, CHANNELS=45
	$(BIN)/python test/campaign/inputs.py --seed $(SEED) --count $(COUNT)
	$(BIN)/platoon campaign --seed $(SEED) --faults $(FAULTS) --jobs $(JOBS)
	$(BIN)/python test/campaign/designs.py --seed $(SEED) --count $(DESIGNS)
	$(BIN)/python test/campaign/channels.py --seed $(SEED) --count $(CHANNELS)

soak: setup ## a run by clocks of MINUTES=30 with a fault every few seconds: nothing grows, nothing is lost
	$(BIN)/python test/campaign/soak.py --seed $(SEED) --minutes $(MINUTES)

coverage: setup ## run every test and print how much of the code ran, in subprocesses too
	$(BIN)/coverage erase
	$(BIN)/coverage run -m pytest -m "unit or report" -n auto --dist worksteal
	$(BIN)/coverage run -m pytest -m "ros or system" -n 4 --dist worksteal
	$(BIN)/coverage combine --quiet
	$(BIN)/coverage report

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/codespell

clean: ## remove .venv and everything built; runs/ stays
	rm -rf $(VENV) $(OLDEST) .coverage build install log .mypy_cache .ruff_cache .pytest_cache .hypothesis *.egg-info
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

FORCE:
