# The two commands: `make demo` and `make test`. Both do all the set-up, from the versions that requirements.lock names;
# see README.md. `make lock` takes newer ones; `make test-newest` and `make test-oldest` try the ends of what is allowed.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
PIP_INSTALL := -m pip install --quiet --disable-pip-version-check
# one worker a core, each module of tests whole on one of them, so that its results are made once
WORKERS := -n auto --dist loadfile

.PHONY: demo test test-newest test-oldest lock check lint types format long bench bench-baseline bench-all fuzz schema docs hooks wheel smoke clean

$(STAMP): pyproject.toml requirements.lock
	$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "nebosvod needs Python 3.11 or newer, this is " + sys.version.split()[0] + "; try: make PYTHON=python3.12")'
	mkdir -p build
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python $(PIP_INSTALL) --requirement requirements.lock
	PYTHONWARNINGS='ignore:Editable installation' $(BIN)/python $(PIP_INSTALL) --no-deps --no-build-isolation --editable .
	@echo 'compiling the kernels, once (about half a minute)'
	$(BIN)/nebosvod run minimal -o build/first-run --overwrite > build/first-run.txt
	touch $(STAMP)

demo: $(STAMP)
	$(BIN)/nebosvod run apophis-2029 --overwrite

test: $(STAMP)
	$(BIN)/pytest -m 'not long' $(WORKERS)

# One command refreshes every version, those of the tables of the Earth's rotation and of the observatories with them.
lock: $(STAMP)
	$(BIN)/uv pip compile --quiet --upgrade --universal --python-version 3.11 --extra dev --no-header --output-file requirements.lock pyproject.toml

# The whole suite with the newest versions that pyproject.toml allows, then with the oldest (its floors), each in an
# environment of its own with a cache of kernels of its own.
test-newest: $(STAMP)
	rm -rf build/newest && $(BIN)/uv venv --quiet --python $(BIN)/python build/newest
	VIRTUAL_ENV=build/newest $(BIN)/uv pip install --quiet --upgrade --editable '.[test,docs,de440]'
	NUMBA_CACHE_DIR=$(CURDIR)/build/newest/kernels build/newest/bin/pytest -m 'not long' $(WORKERS) -p no:cacheprovider

test-oldest: $(STAMP)
	rm -rf build/oldest && $(BIN)/uv venv --quiet --python $(BIN)/python build/oldest
	VIRTUAL_ENV=build/oldest $(BIN)/uv pip install --quiet --resolution lowest-direct --editable '.[test,docs,de440]'
	NUMBA_CACHE_DIR=$(CURDIR)/build/oldest/kernels build/oldest/bin/pytest -m 'not long' $(WORKERS) -p no:cacheprovider

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

format: $(STAMP)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

types: $(STAMP)
	$(BIN)/python tools/link_types.py
	$(BIN)/mypy

check: lint types test

long: $(STAMP)
	$(BIN)/pytest -m long

# The figures that are watched, beside benchmarks/baseline.json; then that file anew; then every benchmark there is.
bench: $(STAMP)
	$(BIN)/python benchmarks/figures.py

bench-baseline: $(STAMP)
	$(BIN)/python benchmarks/figures.py --store

bench-all: $(STAMP)
	@for script in benchmarks/*.py; do echo "== $$script"; $(BIN)/python $$script || exit 1; done

fuzz: $(STAMP)
	NEBOSVOD_FUZZ_CASES=100000 $(BIN)/pytest tests/nebosvod/mission/reading/test_fuzz.py \
		tests/nebosvod/results/test_folder_fuzz.py tests/nebosvod/orbits/test_orbit_fuzz.py \
		tests/observation/formats/test_astrometry_fuzz.py tests/observation/spacecraft/test_spacecraft_fuzz.py

schema: $(STAMP)
	$(BIN)/nebosvod schema > scenarios/nebosvod.schema.json
	$(BIN)/nebosvod schema --fit > scenarios/fit.schema.json
	$(BIN)/nebosvod schema --study > scenarios/study.schema.json
	$(BIN)/python tools/mission_reference.py
	$(BIN)/python tools/summaries.py
	$(BIN)/ruff format --quiet nebosvod/notebook/summaries

hooks: $(STAMP)
	$(BIN)/pre-commit install

docs: $(STAMP)
	$(BIN)/sphinx-build -q -W --keep-going docs build/site
	@echo 'documentation: build/site/index.html'

wheel: $(STAMP)
	rm -rf dist
	$(BIN)/python -m build --wheel

# The wheel alone, installed in an environment of its own, passes the smoke tests.
smoke: wheel
	rm -rf build/smoke && $(PYTHON) -m venv build/smoke
	build/smoke/bin/python -m pip install --quiet --disable-pip-version-check 'nebosvod[test] @ file://'"$$(ls $(CURDIR)/dist/*.whl)"
	build/smoke/bin/pytest -m smoke -p no:cacheprovider

clean:
	rm -rf $(VENV) build dist *.egg-info
