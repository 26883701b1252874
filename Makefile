# On a machine with Python 3.11, pip and make: `make demo`, `make test`. Both make their own environment first.
SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help install demo test test-long golden size coverage docs pictures bench lock audit licences sbom clean

PYTHON ?= $(shell command -v python3.11 || echo python3)
VENV := .venv
BIN := $(VENV)/bin
DONE := $(VENV)/installed
TESTED := $(VENV)/test-installed
DOCUMENTED := $(VENV)/docs-installed
BENCHED := $(VENV)/bench-installed
AUDITED := $(VENV)/audit-installed
BENCHMARKS := startup kinematics design scaling identify
LOCK_VENV := build/lock-venv
USER_VENV := build/user-venv

# One dot for every package that pip looks at; its errors still show.
DOTS := awk '/^ *(Collecting|Obtaining)/ {printf "."; fflush()} /^Installing collected/ {printf " installing\n"; fflush()} END {print ""}'
# One thread per worker: workers with threaded linear algebra only get in each other's way. Of two cores a third worker
# takes what is left while tests wait for a browser or a cluster.
# Each worker has files as a whole, so that what the tests of a file share is made once; who is done first helps the other.
WORKERS := -n 3 --dist worksteal
# Tests start hundreds of commands: where the environment keeps Python from storing what it compiled, each compiles all again.
ONE_THREAD := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE=

help:  ## list these targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-9s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

install: $(TESTED) $(DOCUMENTED)  ## make the environment in .venv from requirements.lock, with all that tests and pages need

# The stamp is written last and removed first: after an interrupted install the environment is made anew.
$(DONE): pyproject.toml requirements.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed: make PYTHON=/path/to/python3.11")'
	@if [ -f $@ ]; then rm $@; else rm -rf $(VENV); $(PYTHON) -m venv $(VENV); fi
	@echo "Installing into $(VENV), once"; start=$$(date +%s); \
		PYTHONUNBUFFERED=1 PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_CONSTRAINT=requirements.lock \
		$(BIN)/python -m pip install --progress-bar off -e . | $(DOTS); \
		echo "Installed in $$(($$(date +%s) - start)) s: $$(du -sm $(VENV) | cut -f1) MB in $(VENV)"
	@touch $@

demo: $(DONE)  ## run the main job: calibrate on real readings, design a plan, write a report
	@start=$$(date +%s); $(BIN)/qsf demo; echo "qsf demo took $$(($$(date +%s) - start)) s"

# pyright asks the environment's own interpreter where to look: pinocchio lies in a folder that only it knows of. It
# works on one core for half a minute, beside the tests; what it says stands among their dots as soon as it is known.
test: $(TESTED) $(DOCUMENTED)  ## lint, format, types and the tests of every change
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check --quiet . || { echo "formatting differs: run $(BIN)/ruff format"; exit 1; }
	@PYRIGHT_PYTHON_IGNORE_WARNINGS=1 $(BIN)/pyright --pythonpath $(BIN)/python & types=$$!; failed=0; \
		$(ONE_THREAD) $(BIN)/python -m pytest $(WORKERS) -m "not long" || failed=$$?; \
		wait $$types || { failed=$$?; echo "pyright found errors: they stand above, among the tests' dots"; }; exit $$failed

test-long: $(TESTED) $(DOCUMENTED)  ## the tests that need not run at every change: fuzz, kills, browsers, every robot and page
	@$(ONE_THREAD) $(BIN)/python -m pytest $(WORKERS) -m long

size: $(TESTED)  ## what a reader must hold in mind: each count, its bound and its goals
	@$(BIN)/python tests/house/sheet.py

golden: $(TESTED) $(DOCUMENTED)  ## 190 command lines held to what is recorded of them, every number and word: two minutes
	@$(ONE_THREAD) $(BIN)/python tests/golden/golden.py

coverage: $(TESTED) $(DOCUMENTED)  ## branch coverage of the library, package by package; 95 % of the five that compute
	@mkdir -p build
	@COVERAGE_FILE=build/coverage $(ONE_THREAD) $(BIN)/python -m pytest $(WORKERS) -q --cov --cov-report=json:build/coverage.json
	@$(BIN)/python tests/coverage_table.py build/coverage.json

docs: $(DOCUMENTED)  ## build the site into build/site, with no warning
	@NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet
	@echo "build/site/index.html"

pictures: $(TESTED) $(DOCUMENTED)  ## remake the pages' pictures; the terminal at 80 and 100 columns into build/pictures
	@$(BIN)/python docs/make_pictures.py

bench: $(BENCHED)  ## measure against Pinocchio, cvxpy, FIGAROH and the memory: docs/results.md, half an hour
	@for script in $(BENCHMARKS); do echo "benchmarks/$$script.py"; $(BIN)/python benchmarks/$$script.py --write; done

$(TESTED) $(DOCUMENTED) $(BENCHED) $(AUDITED): $(VENV)/%-installed: $(DONE)
	@echo "Installing what 'make $*' needs into $(VENV), once"
	@PYTHONUNBUFFERED=1 PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_CONSTRAINT=requirements.lock \
		$(BIN)/python -m pip install --progress-bar off -e '.[$*]' | $(DOTS)
	@touch $@

# Every Python brings its own setuptools into a new environment: without it, the lock has the one that is asked for.
lock:  ## choose the newest versions that resolve together, all extras included, and pin them
	@rm -rf $(LOCK_VENV) && $(PYTHON) -m venv $(LOCK_VENV)
	@$(LOCK_VENV)/bin/python -m pip uninstall --quiet --yes setuptools
	@PYTHONUNBUFFERED=1 PIP_DISABLE_PIP_VERSION_CHECK=1 \
		$(LOCK_VENV)/bin/python -m pip install --progress-bar off -e '.[test,bench,docs,audit]' $(LOCK_ARGS) | $(DOTS)
	@{ echo "# Every distribution that qsframework and its extras need, for Python 3.11 on Linux x86-64."; \
	   echo "# Made by \`make lock\`; used as: pip install -c requirements.lock -e '.[test,docs]'"; \
	   $(LOCK_VENV)/bin/python -m pip freeze --all --exclude pip --exclude-editable | grep -E '^[A-Za-z0-9._-]+==' | LC_ALL=C sort -f; } > requirements.lock
	@rm -rf $(LOCK_VENV)

# pip-audit ends well where it could ask nobody, unless it is strict.
audit: $(BENCHED) $(AUDITED)  ## hold the lock against known vulnerabilities; where that cannot be, list what is newer
	@$(BIN)/pip-audit --strict --no-deps --disable-pip -r requirements.lock \
		|| { echo "Newer than what is locked:"; $(BIN)/python -m pip list --outdated --exclude pip --quiet; exit 1; }

licences: $(BENCHED) $(AUDITED)  ## write LICENCES.md from what is locked
	@$(BIN)/python docs/make_licences.py

# Without pip: what is listed is what a user gets, and nothing that installed it.
sbom: $(AUDITED)  ## the software bill of materials of a user's environment, CycloneDX: build/sbom.json
	@rm -rf $(USER_VENV) && $(PYTHON) -m venv --without-pip $(USER_VENV)
	@PYTHONUNBUFFERED=1 PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_CONSTRAINT=requirements.lock \
		$(BIN)/python -m pip --python $(USER_VENV) install --progress-bar off '.[cluster,day,excel]' | $(DOTS)
	@$(BIN)/cyclonedx-py environment --pyproject pyproject.toml --output-reproducible -o build/sbom.json $(USER_VENV)
	@echo "build/sbom.json"

clean:  ## remove the environment and everything that was built
	@rm -rf $(VENV) build dist .pytest_cache .ruff_cache .hypothesis qsf-demo qsf-script
	@find . -name __pycache__ -type d -prune -exec rm -rf {} +
