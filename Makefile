# make demo   set up, render a clip with a hidden effect, find its parameters, show what is left
# make test   set up, run the tests
PYTHON ?= $(shell command -v python3.11 || command -v python3)
BIN := .venv/bin
CONSTRAINED := PIP_CONSTRAINT=constraints.txt PIP_DISABLE_PIP_VERSION_CHECK=1

.PHONY: demo test test-slow lint format validation wheel clean

demo: .venv/ready
	$(BIN)/iris-sysid demo -o demo-output --force

test: .venv/ready
	$(BIN)/python -m pytest -n 2 --dist loadfile -m "not slow"

test-slow: .venv/ready
	$(BIN)/python -m pytest -n 2 --dist loadfile -m slow

lint: .venv/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: .venv/ready
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

validation: .venv/ready
	$(BIN)/python -m validation

wheel: .venv/ready
	$(BIN)/python -m build --wheel --no-isolation --outdir dist .

.venv/ready: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(CONSTRAINED) $(BIN)/python -m pip install --quiet --editable ".[dev]"
	touch $@

clean:
	rm -rf .venv build dist demo-output *.egg-info
