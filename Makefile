# Everything a fresh Linux machine with Python 3.11+, a C++ compiler and make needs: `make demo`, `make test`.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Constraints also pin the build environment of `pip install .`.
export PIP_CONSTRAINT := $(CURDIR)/constraints.txt
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# Tests under which lines are counted, at two fifths more of their time: of the packages named in pyproject.toml.
TRACED := $(addprefix tests/,capture extract files fusion geometry raster scene)
SOURCES := pyproject.toml CMakeLists.txt constraints.txt $(shell find native src -name '*.[ch]pp' -o -name '*.py')

.PHONY: demo test native clean

demo: $(VENV)/.installed
	$(BIN)/goc demo --out goc-demo --overwrite

test: $(VENV)/.installed-test
	$(BIN)/ruff check src tests benchmarks examples
	$(BIN)/ruff format --check src tests benchmarks examples
	$(BIN)/lint-imports
	$(BIN)/python -m nanobind.stubgen -q -m goc._native -o src/goc/_native.pyi
	PYRIGHT_PYTHON_IGNORE_WARNINGS=1 $(BIN)/pyright --pythonpath $(BIN)/python
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n auto $(TRACED) --cov --cov-report=term:skip-covered
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n auto $(addprefix --ignore=,$(TRACED))

# Build the kernels into src/goc, for work on a source tree: PYTHONPATH=src.
native:
	cmake -S . -B build/dev -G Ninja -DCMAKE_BUILD_TYPE=Release -DPython_EXECUTABLE=$$(command -v python)
	cmake --build build/dev
	cp --remove-destination build/dev/_native*.so src/goc/

clean:
	rm -rf build $(VENV) src/goc/_native*.so

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: $(BIN)/python $(SOURCES)
	$(BIN)/pip install .
	touch $@

$(VENV)/.installed-test: $(BIN)/python $(SOURCES)
	$(BIN)/pip install ".[test]"
	touch $@ $(VENV)/.installed
