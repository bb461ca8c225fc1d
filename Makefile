# Everything runs in a virtual environment that is made on first use: with what the demo needs, then with the rest.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
CORE := $(VENV)/.core
STAMP := $(VENV)/.installed
NEWEST = .venv-newest-$(shell $(PYTHON) -c 'import platform; print(platform.python_version())')
PIP := -m pip install --quiet --disable-pip-version-check
EVERYTHING := --editable ".[all]" --group dev --group docs
PYTEST := -m pytest -n 2 --dist loadfile  # a file's tests share what it makes

.PHONY: demo test test-all test-newest check site format clean

demo: $(CORE)
	rm -rf demo-out
	$(BIN)/swim2real demo --out demo-out

test: $(STAMP)
	$(BIN)/python $(PYTEST) -m "not slow"

test-all: $(STAMP)
	$(BIN)/python $(PYTEST)

# the same suite on the newest release of every dependency that pip finds for this Python, each in an environment of its
# own: make test-newest PYTHON=python3.13
test-newest: $(NEWEST)/.installed
	$(NEWEST)/bin/python $(PYTEST) -m "not slow"

check: $(STAMP)
	$(BIN)/ruff check --no-cache .
	$(BIN)/ruff format --check .
	$(BIN)/pyright
	$(BIN)/lint-imports
	$(BIN)/python .ci/surface.py
	$(MAKE) --no-print-directory site

# the documentation, into site/: without a network, warnings are errors. The variable silences mkdocs-material's notice
# of its own future
site: $(STAMP)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

format: $(STAMP)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# without compiling what may never be imported
$(CORE): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python $(PIP) --no-compile --constraint constraints.txt --editable .
	touch $@

$(STAMP): $(CORE)
	$(BIN)/python $(PIP) --upgrade "pip>=25.1"
	$(BIN)/python $(PIP) --constraint constraints.txt $(EVERYTHING)
	-$(BIN)/python -m compileall -q -j 0 $(VENV)/lib > /dev/null  # tests start many processes
	touch $@

$(NEWEST)/.installed: pyproject.toml
	$(PYTHON) -m venv $(NEWEST)
	$(NEWEST)/bin/python $(PIP) --upgrade pip
	$(NEWEST)/bin/python $(PIP) --upgrade --upgrade-strategy eager $(EVERYTHING)
	touch $@

clean:
	rm -rf $(VENV) .venv-newest* demo-out site build dist .pytest_cache .ruff_cache .hypothesis
