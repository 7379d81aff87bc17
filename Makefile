# make demo: from a fresh clone to a located fiber and its report, with nothing but Python 3.11 or newer.
# make demo-hidden: the same with something hidden in the record, which is found; SEED=7 is another street and secret.
# make test: every check that a change must pass; make types and make tests: mypy and pytest alone.
# make coverage: the tests again, with the lines that none of them reaches; a quarter slower.
# make docs: the documentation, with warnings as errors: build/docs/index.html opens offline.
# make notebooks: run them again and keep what they show.
PYTHON ?= python3
BIN := .venv/bin
PYTEST := OMP_NUM_THREADS=1 $(BIN)/pytest -n auto --dist worksteal --durations=20
# Packages are compiled where they are first imported, and kept: most modules of torch never are.
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --constraint constraints.txt
export PYTHONDONTWRITEBYTECODE =

.PHONY: demo demo-hidden test types tests coverage docs notebooks clean

.venv/installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(PIP) torch
	$(PIP) --editable '.[dev]'
	touch $@

demo: .venv/installed
	$(BIN)/roadfiber demo --out runs/demo

SEED ?= 5
demo-hidden: .venv/installed
	$(BIN)/roadfiber demo --hide any --seed $(SEED) --out runs/demo-hidden

test: .venv/installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(MAKE) -j2 types tests  # mypy has one core to itself while the tests' workers start

types: .venv/installed
	$(BIN)/mypy

tests: .venv/installed
	$(PYTEST)

coverage: .venv/installed
	$(PYTEST) --cov --cov-report=term:skip-covered

docs: .venv/installed
	$(BIN)/sphinx-build -q -n -W --keep-going docs build/docs

notebooks: .venv/installed
	cd notebooks && OMP_NUM_THREADS=1 ../$(BIN)/jupyter-execute --inplace --NotebookClient.record_timing=False *.ipynb

clean:
	rm -rf .venv build *.egg-info runs
