# Every target does its own set-up: a fresh machine needs python3 (3.11 or later), its venv module and make.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed

.PHONY: demo test fast slow study lint bench bench-keep blind growth fuzz golden golden-keep notebooks pictures mutants gate-choice wheels clean
.DEFAULT_GOAL := demo

# model/compiled.c is compiled where there is a C compiler (model/core_build.py).
$(STAMP): pyproject.toml constraints.txt hatch_build.py model/core_build.py model/compiled.c
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

# The checks run beside the tests: mypy has a core while tests wait. docs/testing.md says which test belongs where.
test: $(STAMP)
	@$(MAKE) --no-print-directory -j 2 lint fast

PYTEST = $(BIN)/pytest -n 3 --no-loadscope-reorder --durations 15

fast: $(STAMP)
	$(PYTEST) --hypothesis-profile gate -m "not slow and not study"

# SEED=0 draws the same examples each time, as .ci/run does.
slow: $(STAMP)
	$(PYTEST) --hypothesis-profile random $(if $(SEED),--hypothesis-seed $(SEED)) -m "(slow or hypothesis) and not study"

study: $(STAMP)
	$(BIN)/pytest -s -m study

# Compares what the commands give with the numbers kept in tests/golden; CASES="clay-fit joint-*" takes some of them.
GOLDEN := OPENBLAS_NUM_THREADS=1 PYTHONPATH=tests $(BIN)/python -m golden $(foreach case,$(CASES),'$(case)')
golden: $(STAMP)
	$(GOLDEN)

golden-keep: $(STAMP)
	$(GOLDEN) --keep "$$WHY"

# Hides causes and lets the diagnosis find them; resumable. BLIND="--block 0 --report docs/blind_results.md" takes hours.
BLIND ?= --nulls 10 --singles 1 --levels 5 --pairs 2 --outside 1
blind: $(STAMP)
	PYTHONPATH=tests $(BIN)/python -m blind.study --out out/blind --report out/blind/results.md $(BLIND)

# Diagnoses 24 simulated campaigns with 6, 24, 100 and 200 runs; resumable, an hour.
growth: $(STAMP)
	PYTHONPATH=tests $(BIN)/python -m blind.growth --out out/growth --report out/growth/results.md $(GROWTH)

# Damages files of every format and reads them; prints what is a defect.
COUNT ?= 20000
fuzz: $(STAMP)
	PYTHONPATH=tests $(BIN)/python -m fuzz.run --count $(COUNT)

# Runs the notebooks of examples/ and keeps what they show.
notebooks: $(STAMP)
	OPENBLAS_NUM_THREADS=1 PYTHONPATH=tests $(BIN)/python -m notebook_outputs

# Takes the manual's pictures of the pages anew; PAGES="report view" some of them.
pictures: $(STAMP)
	PYTHONPATH=tests $(BIN)/python -m pictures $(PAGES)

# Measures the strength of the tests, into out/mutants.md; MUTANTS="--only 'model/*'" for a part of the lists.
mutants: $(STAMP)
	PYTHONPATH=tests $(BIN)/python -m mutants.run $(MUTANTS)

# Chooses which fast tests the gate needs and leaves the others to the slow set (docs/testing.md); hours, resumable.
gate-choice: $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check coverage
	PYTHONPATH=tests $(BIN)/python -m mutants.gate $(MATRIX)

# Side by side with the peers, into out/bench/results.md; takes twenty minutes on an idle machine.
bench: $(STAMP)
	$(BIN)/python -m benchmarks

# The same, and the marks that are under version control are renewed.
bench-keep: bench
	cp out/bench/marks.md benchmarks/results.md

# A wheel for each platform, with the core compiled by zig (ziglang of PyPI, in an environment of its own), into dist/.
WHEELS := x86_64-linux-gnu.2.17=manylinux_2_17_x86_64 aarch64-linux-gnu.2.17=manylinux_2_17_aarch64 \
  x86_64-windows-gnu=win_amd64 aarch64-macos.11.0=macosx_11_0_arm64 x86_64-macos.11.0=macosx_11_0_x86_64
ZIG := .venv-wheels/bin/python
wheels:
	@test -x $(ZIG) || $(PYTHON) -m venv .venv-wheels
	$(ZIG) -m pip install --quiet --disable-pip-version-check 'ziglang>=0.13,<0.16'
	zig=$$($(ZIG) -c 'import ziglang; print(ziglang.__path__[0] + "/zig")') && for pair in $(WHEELS); do \
	  CC="$$zig cc -target $${pair%=*}" WHEELSOIL_WHEEL_PLATFORM=$${pair#*=} \
	  $(ZIG) -m pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir dist . || exit 1; \
	done
	@ls dist

clean:
	rm -rf $(VENV) .venv-bench .venv-wheels out
