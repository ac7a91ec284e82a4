# Everything is set up by the first target that is made; it needs Python 3.11 with venv, and make.
#
# make demo        render a clip with a hidden effect, find its parameters, find the effect
# make test        the fast tests: minutes
# make test-slow   real recordings, coverage of intervals, false alarms, Cramer-Rao bound, identity, demo: half an hour
# make lint        style, types, and whether the installed packages agree
# make docs        the pages and the reference of the API, into docs-output/
# make validation  the measurements that the validation pages quote
PYTHON ?= $(shell command -v python3.11 || command -v python3)
BIN := .venv/bin
CONSTRAINED := PIP_CONSTRAINT=constraints.txt PIP_DISABLE_PIP_VERSION_CHECK=1
DEMO ?= demo-output
WORKERS ?= 2
# One thread for each worker: two workers that share two cores with BLAS threads wait for each other.
ONE_THREAD := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1
PYTEST := $(ONE_THREAD) $(BIN)/python -m pytest -n $(WORKERS)

.PHONY: demo test test-slow lint format validation docs wheel clean

demo: .venv/ready
	$(BIN)/iris-sysid demo -o $(DEMO) --force

test: .venv/ready
	$(PYTEST) --dist loadfile -m "not slow"

test-slow: .venv/ready
	$(PYTEST) --dist worksteal -m slow --durations=20

lint: .venv/ready
	$(BIN)/python -m pip check
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: .venv/ready
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

validation: .venv/ready
	$(BIN)/python -m validation

docs: .venv/ready-for-docs
	$(BIN)/python -m sphinx --fail-on-warning --keep-going docs docs-output

wheel: .venv/ready
	$(BIN)/python -m build --wheel --no-isolation --outdir dist .

.venv/ready: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(CONSTRAINED) $(BIN)/python -m pip install --quiet --editable ".[dev]"
	touch $@

.venv/ready-for-docs: .venv/ready
	$(CONSTRAINED) $(BIN)/python -m pip install --quiet --editable ".[dev,docs]"
	touch $@

clean:
	rm -rf .venv build dist demo-output docs-output *.egg-info
