# Everything sets itself up: `make demo` and `make test` work on a fresh checkout.
.DEFAULT_GOAL := help
.PHONY: help setup bench demo check test stopping study lint clean

export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST
unexport PYTHONDONTWRITEBYTECODE  # or each of a hundred processes would compile all again
IN_VENV := . .venv/environment;

help:  ## Show the targets
	@echo 'make TARGET [NAME=value]; whichever comes first sets up what all of them need.'
	@sed -n 's/^\([a-z-]*\):.*## /\1\t/p' Makefile | expand -t 20

setup:  ## Make .venv with everything in it (the other targets do this by themselves)
	@.ci/setup-venv

demo: setup  ## Run the whole stack with simulated drives and a swaying gondola (SCENARIO=gusts DURATION=40)
	@$(IN_VENV) exec demo \
	  $(if $(DURATION),--duration '$(DURATION)') $(if $(SCENARIO),--scenario '$(SCENARIO)')

check: lint  ## Check the style and run what needs no clock, bus or other process: an answer in a minute
	@$(IN_VENV) exec python .ci/test.py --check $(PYTEST_ARGS)

test: setup  ## Run all tests, those of SocketCAN on a real vcan (PYTEST_ARGS='-k …')
	@.ci/setup-colcon
	@$(IN_VENV) exec python .ci/test.py $(PYTEST_ARGS)

stopping: setup  ## Show how near the carriages come when something fails (PARAMS=file)
	@$(IN_VENV) exec stopping $(PARAMS)

study: setup  ## Compute the paper again: tables and figures in workspace_report/ (STUDY_ARGS=…)
	@$(IN_VENV) exec workspace_study $(STUDY_ARGS)

bench: setup  ## Measure performance beside what else one could use (QUICK=1: some rows, in a minute)
	@$(IN_VENV) exec python test/bench $(if $(QUICK),--quick) $(BENCH_ARGS)

lint: setup  ## Check style and types
	@$(IN_VENV) ruff check . && mypy

clean:  ## Remove .venv and everything made
	@rm -rf .venv build install log *.egg-info .pytest_cache .hypothesis .mypy_cache .ruff_cache \
	  demo_report bench_report workspace_report
	@find . -name __pycache__ -prune -exec rm -rf {} +
