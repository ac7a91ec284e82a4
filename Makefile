# Everything is set up by the first target that is made; it needs Python 3.11 with venv, and make.
#
# make demo        render a clip with a hidden effect, find its parameters, find the effect
# make test        the fast tests: minutes
# make test-slow   real recordings, coverage of intervals, false alarms, Cramer-Rao bound, identity, demo: half an hour
# make test-lowest fast tests of the packages with the lowest versions that pyproject.toml allows
# make test-versions fast tests with Python 3.12 and 3.13, where they are installed
# make lint        style, types, and whether the installed packages agree
# make docs        the pages and the reference of the API, into docs-output/
# make validation  the measurements that the validation pages quote
# make torture     damaged input, kills, full disks: what breaks; its short form is part of test-slow
# make fuzz        an hour of mutated input for every reader
# make wheel       the wheel, the same bytes every time, into dist/
# make sbom        the packages that iris-sysid needs, with versions and licences (CycloneDX), into dist/
# make constraints pin what pyproject.toml asks for, with hashes
PYTHON ?= $(shell command -v python3.11 || command -v python3)
BIN := .venv/bin
INSTALL := -m pip --disable-pip-version-check install --quiet
PINNED := $(INSTALL) --require-hashes
DEMO ?= demo-output
DIST ?= dist
WORKERS ?= 2
# One thread for each worker: two workers that share two cores with BLAS threads wait for each other.
ONE_THREAD := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1
PYTEST := $(ONE_THREAD) $(BIN)/python -m pytest -n $(WORKERS) --max-worker-restart 0

# Folders of tests that pass with them; old packages warn of one another, which is no error.
LOWEST ?= $(addprefix tests/,calibration io phenomena trajectory types video)
# Interpreters after that of .venv, and the tests that they run: the values, files, and compiled numbers.
VERSIONS ?= 3.12 3.13
ON_VERSIONS ?= $(addprefix tests/,io trajectory types fitters/test_integrator.py fitters/test_machine_code.py)

SECONDS ?= 3600
COMPILE := .venv-release/bin/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-header --no-annotate

.PHONY: demo test test-slow test-lowest test-versions lint format validation torture fuzz docs wheel sbom constraints clean

demo: .venv/ready
	$(BIN)/iris-sysid demo -o $(DEMO) --force

test: .venv/ready
	$(PYTEST) --dist loadfile -m "not slow"

test-slow: .venv/ready
	$(PYTEST) --dist worksteal -m slow --durations=20

test-lowest: .venv-lowest/ready
	$(ONE_THREAD) .venv-lowest/bin/python -m pytest -n $(WORKERS) --dist loadfile -m "not slow" -W default $(LOWEST)

test-versions: $(VERSIONS:%=.venv-%/ready)
	set -e; for version in $(VERSIONS); do \
	    $(ONE_THREAD) .venv-$$version/bin/python -m pytest -n $(WORKERS) --dist loadfile -m "not slow" $(ON_VERSIONS); \
	done

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

torture: .venv/ready
	$(BIN)/python -m validation.torture

fuzz: .venv/ready-for-fuzz
	$(BIN)/python -m tests.fuzz --seconds $(SECONDS)

docs: .venv/ready-for-docs
	$(BIN)/python -m sphinx --fail-on-warning --keep-going docs docs-output

# Neither dates nor modes of the files that it is built from are in the wheel: it is the same bytes everywhere.
wheel: export SOURCE_DATE_EPOCH ?= 1577836800
wheel: .venv/ready
	rm -rf build/lib
	chmod -R u=rwX,go=rX iris_sysid trackers fitters LICENSE
	umask 022 && $(BIN)/python -m build --wheel --no-isolation --outdir $(DIST) .

sbom: .venv-release/ready
	$(PYTHON) -m venv --clear build/sbom-venv
	build/sbom-venv/bin/python $(PINNED) -r constraints.txt
	mkdir -p $(DIST)
	.venv-release/bin/cyclonedx-py environment --output-reproducible --pyproject pyproject.toml -o $(DIST)/sbom.json build/sbom-venv

constraints: .venv-release/ready
	$(COMPILE) pyproject.toml -o constraints.txt > /dev/null
	$(COMPILE) --group dev -c constraints.txt -o tests/constraints.txt > /dev/null
	$(COMPILE) --group docs -c constraints.txt -o docs/constraints.txt > /dev/null
	$(COMPILE) --group fuzz -c constraints.txt -o tests/fuzz/constraints.txt > /dev/null
	$(COMPILE) --group release -c constraints.txt -o .ci/constraints.txt > /dev/null

.venv/ready: pyproject.toml constraints.txt tests/constraints.txt
	$(PYTHON) -m venv .venv
	$(BIN)/python $(PINNED) -r constraints.txt -r tests/constraints.txt
	$(BIN)/python $(INSTALL) --no-deps --no-build-isolation --editable .
	touch $@

.venv/ready-for-docs: .venv/ready docs/constraints.txt
	$(BIN)/python $(PINNED) -r docs/constraints.txt
	touch $@

.venv/ready-for-fuzz: .venv/ready tests/fuzz/constraints.txt
	$(BIN)/python $(PINNED) -r tests/fuzz/constraints.txt
	touch $@

.venv-release/ready: .ci/constraints.txt
	$(PYTHON) -m venv .venv-release
	.venv-release/bin/python $(PINNED) -r .ci/constraints.txt
	touch $@

.venv-lowest/ready: pyproject.toml .venv-release/ready
	$(PYTHON) -m venv --clear .venv-lowest
	.venv-release/bin/uv pip install --quiet --python .venv-lowest/bin/python --resolution lowest-direct --editable . --group test
	touch $@

.venv-3.%/ready: pyproject.toml constraints.txt tests/constraints.txt
	python3.$* -m venv --clear .venv-3.$*
	.venv-3.$*/bin/python $(PINNED) -r constraints.txt -r tests/constraints.txt
	.venv-3.$*/bin/python $(INSTALL) --no-deps --no-build-isolation --editable .
	touch $@

clean:
	rm -rf .venv .venv-release .venv-lowest $(VERSIONS:%=.venv-%) build dist demo-output docs-output fuzz-output *.egg-info
