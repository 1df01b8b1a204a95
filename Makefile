# Every target sets up first: on a fresh machine with Python 3.11 and make, `make rde` alone and
# `make test` alone work.

VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
# Python compiles a module once and keeps the bytecode, also where the environment forbids that, as
# many containers do. Tests start many processes.
export PYTHONDONTWRITEBYTECODE :=

.DEFAULT_GOAL := help
.PHONY: help setup rde test test-all test-servers lint docs ui

help:  ## what can be made
	@sed -n 's/^\([a-z-]*\):.*## /  make \1	/p' $(MAKEFILE_LIST)

setup: $(READY)  ## install everything into .venv

rde: $(READY)  ## the main job: find what the rotating detonation engine's simulation leaves out
	$(BIN)/python -m dashred.train conf=rde

test: $(READY)  ## the fast tests
	$(BIN)/python -m pytest -m "not slow" -n auto

test-all: $(READY)  ## the slow tests too
	$(BIN)/python -m pytest -n auto

test-servers: $(READY)  ## runs on PostgreSQL and an S3 server, which the tests start and stop
	@command -v postgres >/dev/null || ls /usr/lib/postgresql/*/bin/postgres >/dev/null 2>&1 || \
	    { echo "PostgreSQL is not installed (Debian: apt install postgresql)" >&2; exit 2; }
	$(BIN)/python -m pip install -qq --requirement requirements-servers.lock
	$(BIN)/python -m pytest -m servers

lint: $(READY)  ## style, format, types, layers
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo

docs: $(READY)  ## the documentation as a site, in build/site
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

ui: $(READY)  ## compare runs in MLflow's pages
	$(BIN)/mlflow ui --backend-store-uri "sqlite:///$(CURDIR)/mlruns/mlflow.db"

# A Python that is old, a shim that leads nowhere, or one without venv (Debian's bare python3) is
# passed over. 3.11 stands first: the lock was made with it. pip is what venv writes last.
$(BIN)/pip:
	@for python in python3.11 python3 python3.13 python3.12; do \
	    if $$python -c 'import sys, ensurepip, venv; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; \
	    then echo "$$python -m venv $(VENV)"; exec $$python -m venv $(VENV); fi; \
	done; \
	echo "dashred needs Python 3.11 or newer with venv (Debian: apt install python3.11-venv)" >&2; \
	exit 2

# pip resolves although the lock is complete: torch's build on PyPI for Linux needs CUDA libraries
# that its CPU wheel, and so the lock, does not have. --no-compile: most of what is installed is
# never imported. What a run imports is compiled here: without bytecode each of a run's processes
# spends 5 s more. The stamp is written last, so that an install that was cut short is taken up again.
$(READY): requirements.lock pyproject.toml | $(BIN)/pip
	@echo "installing into $(VENV): some minutes, this once"
	$(BIN)/python -m pip install -qq --no-compile --requirement requirements.lock
	$(BIN)/python -m pip install -qq --no-deps --no-build-isolation --editable .
	$(BIN)/python -c "import dashred.pipeline.outputs.report, dashred.evaluation.twins.scoring, \
	    lightning, mlflow.pytorch, mlflow.store.tracking.sqlalchemy_store, xarray"
	@touch $@
