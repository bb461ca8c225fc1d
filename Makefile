# Everything runs in a virtual environment that is made on first use.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
NEWEST := .venv-newest
PYTEST := -m pytest -n 2 --dist loadfile  # a file's tests share what it makes

.PHONY: demo test test-all test-newest check format clean

demo: $(STAMP)
	rm -rf demo-out
	$(BIN)/swim2real demo --out demo-out

test: $(STAMP)
	$(BIN)/python $(PYTEST) -m "not slow"

test-all: $(STAMP)
	$(BIN)/python $(PYTEST)

# the same suite on the newest physics engine that pip finds
test-newest: $(NEWEST)/.installed
	$(NEWEST)/bin/python $(PYTEST) -m "not slow"

check: $(STAMP)
	$(BIN)/ruff check --no-cache .
	$(BIN)/ruff format --check .
	$(BIN)/pyright
	$(BIN)/lint-imports

format: $(STAMP)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

$(STAMP): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --upgrade "pip>=25.1"
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable ".[all]" --group dev
	touch $@

$(NEWEST)/.installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(NEWEST)
	$(NEWEST)/bin/python -m pip install --quiet --disable-pip-version-check --upgrade "pip>=25.1"
	grep -v '^mujoco==' constraints.txt > $(NEWEST)/constraints.txt
	$(NEWEST)/bin/python -m pip install --quiet --disable-pip-version-check --constraint $(NEWEST)/constraints.txt --editable ".[all]" --group dev
	$(NEWEST)/bin/python -m pip install --quiet --disable-pip-version-check --upgrade mujoco
	touch $@

clean:
	rm -rf $(VENV) $(NEWEST) demo-out build dist .pytest_cache .ruff_cache .hypothesis
