# Every target does its own set-up: a fresh machine needs python3 (3.11 or later), its venv module and make.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed

.PHONY: demo test slow lint bench blind mutants clean
.DEFAULT_GOAL := demo

$(STAMP): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "wheelsoil needs Python 3.11 or later; set PYTHON=/path/to/python3"; exit 1; }
	@test -x $(BIN)/pip || $(PYTHON) -m venv $(VENV) || { echo "could not make a virtual environment; on Debian: apt-get install python3-venv"; exit 1; }
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[test]'
	@touch $@

demo: $(STAMP)
	$(BIN)/wheelsoil demo

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

test: lint
	$(BIN)/pytest -n 2 --dist loadfile --no-loadscope-reorder -m "not slow"

slow: $(STAMP)
	$(BIN)/pytest -n 2 --dist loadfile --no-loadscope-reorder -m slow

# Hides causes and lets the diagnosis find them; resumable. BLIND="--full" takes hours and is what docs/blind_results.md is from.
BLIND ?= --nulls 10 --singles 1 --levels 5 --pairs 2 --outside 1
blind: $(STAMP)
	PYTHONPATH=tests $(BIN)/python -m blind.study --out out/blind --report out/blind/results.md $(BLIND)

# Measures the strength of the tests and writes docs/mutants.md; MUTANTS="--only 'model/*'" for a part of the lists.
mutants: $(STAMP)
	PYTHONPATH=tests $(BIN)/python -m mutants.run $(MUTANTS)

bench: $(STAMP)
	$(BIN)/python -m benchmarks

clean:
	rm -rf $(VENV) .venv-bench out
