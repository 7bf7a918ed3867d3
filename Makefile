# make repro   environment, then every stage of dvc.yaml that is out of date
# make quick   lint, and tests without clusters, trainings and long renders
# make test    formatting, lint, types, tests (PROCESSES=2 of them at once, 2 GiB each)
# make check   tests that take longer: thousands of homes, hundreds of kills
# make bench   benchmarks and their goals, to docs/benchmarks.md: an hour on 2 idle cores, and
#              hours for the topic budgets, which goes on where it was cut off
#              (ONLY="shards farm" selects topics; list: python -m benchmarks.run --help)
# make records checksums of releases, the sample, the open benchmark, the plan of a large release;
#              run it after a change of the renderer's pixels
#              (ONLY="tiny quick" selects some of tiny, quick, sample, benchmark, plan)
# make docs    generated tables, and the site, build/site/index.html; fails on warnings and broken
#              links
# make site    only the site
# make lock    renew the pinned versions within the ranges of pyproject.toml
# make clean   remove the pipeline's outputs (not the environment)

PYTHON ?= python3
PROCESSES ?= 2
SHELL := bash
export TIMEFORMAT := %R s elapsed; CPU: %U s user, %S s system
VENV := .venv
BIN := $(VENV)/bin
export PATH := $(CURDIR)/$(BIN):$(PATH)
# Workers and stages are hundreds of processes; each would compile the project's modules again.
unexport PYTHONDONTWRITEBYTECODE
# The slow files come first, so that no worker ends long after the other.
PYTEST := $(BIN)/python -m pytest -q --numprocesses $(PROCESSES) --dist loadfile --no-loadscope-reorder

FREEZE := build/lock/all/bin/python -m pip freeze --exclude-editable --exclude pip \
	--exclude setuptools | sed 's/+cpu$$//'

.PHONY: env repro quick test lint check bench records docs site lock clean distclean

env: $(VENV)/.installed

$(VENV)/.installed: pyproject.toml requirements.lock torch.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info[:2] < (3, 11))' \
		|| { echo "Python 3.11 or newer is needed: make PYTHON=/path/to/python3.11"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip setuptools
	$(BIN)/python -m pip install --quiet --no-deps --require-hashes --requirement requirements.lock
	$(BIN)/python -m pip install --quiet --no-deps --requirement torch.lock --editable .
	touch $@

repro: env
	@$(BIN)/pbrnet doctor
	$(BIN)/dvc repro

quick: env
	@time { set -x; $(BIN)/ruff check . && $(BIN)/lint-imports && \
		$(PYTEST) -m "not slow and not check"; }

# Tests that fail run once more, alone: one that passes then depends on timing, which is a fault,
# too, and is named.
test: env
	@time { $(MAKE) --no-print-directory lint && set -x && { $(PYTEST) --junitxml build/tests.xml \
		|| { [ $$? -eq 1 ] && $(BIN)/python -m pytest -v --last-failed --maxfail 1 && \
		echo "Named above: tests that failed and passed alone. Please report them."; }; }; }

lint: env
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/lint-imports
	$(BIN)/mypy

check: env
	@time { set -x; $(BIN)/python -m pytest -q -m check --numprocesses $(PROCESSES) --dist load \
		--junitxml build/check.xml; }

bench: env
	$(BIN)/python -m benchmarks.run $(addprefix --only ,$(ONLY))

records: env
	@time $(BIN)/python -m benchmarks.records $(addprefix --only ,$(ONLY))
	$(BIN)/python docs/generate.py

docs: env
	$(BIN)/python docs/generate.py
	@$(MAKE) --no-print-directory site

site: $(VENV)/.docs
	rm -rf build/site
	$(BIN)/python -m sphinx -q -W --keep-going -E -d build/doctrees -b html docs build/site

$(VENV)/.docs: $(VENV)/.installed docs/requirements.lock
	$(BIN)/python -m pip install --quiet --no-deps --requirement docs/requirements.lock
	touch $@

lock:
	$(PYTHON) -m venv build/lock
	build/lock/bin/python -m pip install --quiet --upgrade pip uv
	build/lock/bin/python -m venv build/lock/all
	build/lock/all/bin/python -m pip install --quiet --editable '.[dev]'
	$(FREEZE) > build/lock/dev
	grep -v '^torch==' build/lock/dev > build/lock/hashed
	build/lock/bin/uv pip compile --quiet --no-deps --no-header --no-annotate --generate-hashes \
		build/lock/hashed --output-file requirements.lock
	sed -i "s/^torch==.*/$$(grep '^torch==' build/lock/dev)/" torch.lock
	build/lock/all/bin/python -m pip install --quiet --editable '.[dev,docs]'
	$(FREEZE) | grep -vxFf build/lock/dev > docs/requirements.lock
	rm -rf build/lock

clean:
	rm -rf data models plots predictions report
	git clean --quiet -fdX metrics

distclean: clean
	rm -rf $(VENV) build *.egg-info .mypy_cache .ruff_cache .pytest_cache
