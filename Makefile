# raybench. Needs python3 (3.11 or newer, or PYTHON=...), its venv module and make; everything else goes into .venv.

PYTHON ?= python3
BIN := .venv/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --no-input
OUT := results/quick
ARGS ?=
, := ,

.DELETE_ON_ERROR:
.PHONY: help bench test test-slow fuzz microbench speed baseline renderers chapter chapter-text figures lint docs reference docs-pictures clean

help:
	@echo "make bench       install, run configs/quick.yaml into $(OUT), say where the report is"
	@echo "make test        install, run the tests (ARGS='-k film' chooses)"
	@echo "make test-slow   the tests that 'make test' leaves out: more cases of what it checks"
	@echo "make fuzz        read a thousand damaged scenes, meshes, glTF files, images, configs and events each (ARGS='--seed 2')"
	@echo "make lint        ruff and pyright"
	@echo "make docs        build the documentation: docs/_build/html/index.html, to be opened from there"
	@echo "make reference   write what docs/reference has from the code, after a change of keys, commands, columns or names"
	@echo "make docs-pictures  make its pictures anew (many minutes)"
	@echo "make microbench  time the parts: tests/benchmarks"
	@echo "make speed       paths per second of numba, embree and Mitsuba on this machine, and their ratios (five minutes)"
	@echo "make baseline    measure configs/engines.yaml (half an hour, on an idle machine) and archive it in results/baseline"
	@echo "make renderers   measure configs/renderers.yaml (an hour and a half, on an idle machine) and archive it; LuxCore"
	@echo "                 and Cycles take part where they are installed: docs/guides/other_programs.md and cycles.md"
	@echo "make clean       remove the environment, the caches and $(OUT); other results and references stay"
	@echo "make chapter     measure configs/dissertation.yaml and dahlquist.yaml (half an hour, on an idle machine), archive them and"
	@echo "                 write the dissertation's missing chapter into results/dissertation/chapter"
	@echo "make chapter-text  write it again from the archives and results/dissertation/prose.md; its claims are checked"
	@echo "make figures     write the figures that pages take from results/renderers; what the page on it claims is checked"
	@echo "With another interpreter: make clean, then make bench PYTHON=python3.12"

bench: .venv/.installed
	@$(BIN)/raybench run configs/quick.yaml --out $(OUT)
	@echo
	@echo "The report: $(CURDIR)/$(OUT)/report.html (tables and plots lie beside it)"

test: .venv/.installed-test
	@$(BIN)/python -m pytest --ignore=tests/benchmarks -n auto --dist loadfile $(ARGS)

test-slow: .venv/.installed-test
	@$(BIN)/python -m pytest --ignore=tests/benchmarks -m slow -n auto $(ARGS)

fuzz: .venv/.installed-test
	@$(BIN)/python -m tests.fuzz $(ARGS)

speed: .venv/.installed-test
	@$(BIN)/python -m tests.benchmarks.speed $(ARGS)

microbench: .venv/.installed-test
	@$(BIN)/python -m pytest tests/benchmarks --benchmark-only $(ARGS)

baseline: .venv/.installed
	@$(BIN)/raybench run configs/engines.yaml --out results/engines
	@$(BIN)/raybench archive results/engines --out results/baseline

renderers: .venv/.installed
	@$(BIN)/raybench run configs/renderers.yaml --out results/renderers-run
	@$(BIN)/raybench archive results/renderers-run --out results/renderers --images 1
	@$(MAKE) figures

chapter: .venv/.installed
	@$(BIN)/raybench run dissertation --out results/dissertation-run
	@$(BIN)/raybench run dahlquist --out results/dahlquist-run
	@$(BIN)/raybench archive results/dissertation-run --out results/dissertation
	@$(BIN)/raybench archive results/dahlquist-run --out results/dahlquist
	@$(MAKE) chapter-text

chapter-text: .venv/.installed
	@$(BIN)/python results/dissertation/chapter.py

figures: .venv/.installed
	@$(BIN)/python docs/figures.py

docs: .venv/.installed-docs
	@$(BIN)/python -m sphinx -q -W --keep-going -j auto docs docs/_build/html $(ARGS)
	@echo "The documentation: $(CURDIR)/docs/_build/html/index.html"

reference: .venv/.installed
	@$(BIN)/python -m docs._ext.reference

docs-pictures: .venv/.installed-test
	@$(BIN)/raybench run configs/quick.yaml --out results/quick
	@$(BIN)/raybench run configs/stability.yaml --out results/stability
	@$(BIN)/raybench report results/renderers
	@for program in docs/pictures/*.py; do echo "$$program"; $(BIN)/python "$$program" || exit 1; done

lint: .venv/.installed-test
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check --quiet . || { echo 'not formatted: $(BIN)/ruff format .' >&2; exit 1; }
	@$(BIN)/pyright

# Editable installs with Mitsuba where it can be had; done again when pyproject.toml changes.
define install
	@echo "raybench: installing into .venv, which takes a minute or two" >&2
	@$(PIP) install --quiet --editable '.[mitsuba$(1)]' 2>/dev/null \
		|| { echo "raybench: Mitsuba cannot be installed, and the benchmark runs without it: $(BIN)/python -m pip install -e '.[mitsuba]' says why" >&2; \
		$(PIP) install --quiet --editable '.$(2)'; }
	@touch $@ .venv/.installed
endef

.venv/.installed: pyproject.toml | .venv/bin/python
	$(call install,,)

.venv/.installed-test: pyproject.toml | .venv/bin/python
	$(call install,$(,)test,[test])

.venv/.installed-docs: pyproject.toml | .venv/bin/python
	$(call install,$(,)docs,[docs])

.venv/bin/python:
	@"$(PYTHON)" -c '' 2>/dev/null \
		|| { echo "raybench: $(PYTHON) does not run here; name a Python 3.11 or newer: make PYTHON=/path/to/python" >&2; exit 1; }
	@"$(PYTHON)" -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
		|| { echo "raybench: $$("$(PYTHON)" --version 2>&1) is too old; name a 3.11 or newer: make PYTHON=python3.12" >&2; exit 1; }
	@"$(PYTHON)" -m venv --clear .venv \
		|| { echo "raybench: $(PYTHON) cannot make a virtual environment; on Debian and Ubuntu install python3-venv" >&2; exit 1; }

clean:
	rm -rf .venv $(OUT) .pytest_cache .ruff_cache .hypothesis .benchmarks build dist docs/_build *.egg-info
	find engines harness tests -name __pycache__ -type d -prune -exec rm -rf {} +
