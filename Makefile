# Each target sets up its environment: `make demo` and `make test` work on a fresh checkout.
.DEFAULT_GOAL := help
.PHONY: help setup bench demo check test test-clock test-pure test-colcon stopping study lint format clean

export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST
unexport PYTHONDONTWRITEBYTECODE  # otherwise each of a hundred processes compiles all modules again
IN_VENV := . .venv/environment;
PYTEST := python -m pytest --dist=worksteal

help:  ## Show the targets
	@echo 'make TARGET [NAME=value]; the first target sets up .venv for all.'
	@sed -n 's/^\([a-z-]*\):.*## /\1\t/p' Makefile | expand -t 20

setup:  ## Make .venv with all dependencies (the other targets also do this)
	@.ci/setup-venv

demo: setup  ## Run the whole stack with simulated drives and a swaying gondola (SCENARIO=gusts DURATION=40 VIEWER=1)
	@$(IN_VENV) exec demo \
	  $(if $(DURATION),--duration '$(DURATION)') $(if $(SCENARIO),--scenario '$(SCENARIO)') $(if $(VIEWER),--viewer)

check: lint  ## Check style and types, and run the quick tests that need no clock, bus or process
	@$(IN_VENV) exec $(PYTEST) -n auto --hypothesis-profile=quick $(PYTEST_ARGS) \
	  -m 'not long and not realtime'

test: setup  ## Run all tests, those of SocketCAN on a real vcan (PYTEST_ARGS='-k …')
	@.ci/setup-colcon
	@.ci/setup-launch
	@$(IN_VENV) exec $(MAKE) --no-print-directory --keep-going --jobs=3 test-pure test-colcon test-clock

# Real-time tests run two at a time, because they mostly wait. The pure tests and those of a colcon
# workspace run at the same time with low priority, and print their output at their end.
test-clock:
	@$(PYTEST) -n 2 $(PYTEST_ARGS) -m 'realtime and not vcan'; status=$$?; \
	  python .ci/vcan/vcan.py --silence 180 -- $(PYTEST) $(PYTEST_ARGS) -m vcan test/processes && exit $$status
test-pure:
	@.ci/beside .venv/test-pure.log $(PYTEST) -n auto $(PYTEST_ARGS) -m 'not realtime'
test-colcon:
	@.ci/beside .venv/test-colcon.log .ci/colcon

stopping: setup  ## Print the distances of the carriages after a failure (PARAMS=file)
	@$(IN_VENV) exec stopping $(PARAMS)

study: setup  ## Compute the paper again: tables and figures in workspace_report/ (STUDY_ARGS=…)
	@$(IN_VENV) exec workspace_study $(STUDY_ARGS)

bench: setup  ## Compare performance with competitors (QUICK=1: some rows, in a minute)
	@$(IN_VENV) exec python test/bench $(if $(QUICK),--quick) $(BENCH_ARGS)

lint: setup  ## Check style, format and types
	@$(IN_VENV) ruff check . && ruff format --check --quiet . && mypy

format: setup  ## Format all Python files
	@$(IN_VENV) ruff format .

clean:  ## Remove .venv and all generated files
	@rm -rf .venv build install log *.egg-info .pytest_cache .hypothesis .mypy_cache .ruff_cache \
	  demo_report bench_report workspace_report
	@find . -name __pycache__ -prune -exec rm -rf {} +
