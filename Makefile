# Run `make help` for what there is.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
ARGS ?=
SCALE ?= demo
STARTS ?= 16
RESULTS ?= results/laptop
POLICY ?= results/policies/gym_motion-gwo
SHOW ?= --web
STUDY := runs/paper-$(SCALE)
# The paper's size needs a GPU; the smaller ones run as many jobs at a time as there are cores.
SCALE_ARGS := $(if $(filter paper,$(SCALE)),device=cuda physics=mjx,hydra/launcher=local)

.DEFAULT_GOAL := help

help: ## Explain the targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "  make %-16s %s\n", $$1, $$2}'

# PyTorch goes first and by its exact version, so that no other requirement chooses a build of it.
$(INSTALLED): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --constraint constraints.txt torch==2.13.0
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[dev]'
	@touch $@

install: $(INSTALLED) ## Make .venv with everything in it (the other targets do it by themselves)

play: $(INSTALLED) ## Watch a trained policy in the browser; SHOW=--video films it, SHOW=--view opens a window; POLICY=FOLDER
	$(BIN)/tlr-evaluate $(POLICY) $(SHOW) $(ARGS)

train: $(INSTALLED) ## Train the two-layered reward at demo scale; ARGS='optimizer=fixed seed=1' changes it
	$(BIN)/tlr-train $(ARGS)

reproduce-paper: $(INSTALLED) ## The paper's study, its analysis and report; SCALE=demo, laptop or paper; goes on where it was
	@answer=$$(mktemp) && trap 'rm -f "$$answer"' EXIT && set -x && \
	TLR_EXP_SWEEP_FILE=$$answer $(BIN)/tlr-train -m +sweep=five_seeds scale=$(SCALE) study=$(notdir $(STUDY)) $(SCALE_ARGS) $(ARGS) && \
	sweep=$$(cat "$$answer") && \
	$(BIN)/tlr-evaluate "$(STUDY)" --starts $(STARTS) --checkpoint last --force && \
	$(BIN)/tlr-export "$$sweep" -o "$$sweep/results" --force && \
	$(BIN)/tlr-report "$$sweep/results" -o "$$sweep/report" --force --repeat "make reproduce-paper SCALE=$(SCALE)$(if $(ARGS), ARGS='$(ARGS)')" && \
	$(BIN)/tlr-sync "$$sweep" && \
	$(BIN)/python -m webbrowser "file://$(CURDIR)/$$sweep/report/report.html"

report: $(INSTALLED) ## Make the report of exported results anew; RESULTS=FOLDER
	$(BIN)/tlr-report $(RESULTS) -o $(RESULTS)/report --force

dashboard: $(INSTALLED) ## Open the MLflow dashboard of the runs in runs/
	$(BIN)/tlr-dashboard runs $(ARGS)

check: $(INSTALLED) ## Style, types and import contracts
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright
	$(BIN)/lint-imports

# A file of tests stays in one process, with what its tests share.
PYTEST := $(BIN)/python -m pytest -rs -n auto --maxprocesses 8 --dist loadfile --no-loadscope-reorder

test: $(INSTALLED) ## The test suite, one process a core (slow and gpu tests apart: ARGS='-m slow')
	$(PYTEST) $(ARGS)

test-fast: $(INSTALLED) ## Most of it within a minute, after every edit: no runs, servers, pictures or simulated studies
	$(PYTEST) --fast $(ARGS)

cluster-tools: $(INSTALLED) ## Install SLURM, its accounts and Ray for test-cluster (Debian or Ubuntu, as root)
	apt-get update -qq
	DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends slurm-wlm slurmdbd munge mariadb-server
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[ray]'

test-cluster: cluster-tools ## Sweeps on a SLURM and a Ray that are brought up on this machine (as root)
	$(BIN)/python -m pytest -rs -m cluster tests/cluster $(ARGS)

bench: $(INSTALLED) ## The benchmarks, as ratios measured in one run
	$(BIN)/python -m pytest benchmarks --benchmark-only $(ARGS)

bench-optimizers: $(INSTALLED) ## Compare the weight optimizers: table and picture of docs/optimizers.md
	$(BIN)/python -m benchmarks.optimizers $(ARGS)

clean: ## Remove the environment and caches (never runs/)
	rm -rf $(VENV) .pytest_cache .ruff_cache .hypothesis .benchmarks build dist *.egg-info

.PHONY: help install play train reproduce-paper report dashboard check test test-fast cluster-tools test-cluster bench bench-optimizers clean
