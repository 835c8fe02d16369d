# `make help` lists the targets; each sets up what it needs. Studies: `.venv/bin/python -m studies` lists them.
SHELL := /bin/bash
BIN := .venv/bin
READY := .venv/ready
PEERS := .venv/peers
LOWEST := .venv/lowest
TOOLS := .venv/pins
TWO := -n 2 --dist loadfile --no-loadscope-reorder# two processes; tests of one file share its fixtures; files of few long tests are not left for the end
INSTALL := -m pip install --quiet --disable-pip-version-check --only-binary=:all:
QUIET := --output-format min-text --min-severity error
PACKAGES := $(filter-out hagoromo_blender,$(wildcard hagoromo hagoromo_*))
OWN := --no-deps --no-build-isolation -e .
# bytecode of tests is kept: to rewrite their assertions takes each process 12 s, every time
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help setup demo test test-all test-slow mutants data docs bench figures fuzz crash package blender platforms schemas cycles constraints audit lowest

help: ## this list
	@sed -n 's/^\([a-z-]*\):.* ## /\1 /p' Makefile | while read -r name about; do printf '  make %-10s %s\n' "$$name" "$$about"; done
	@echo '  python -m studies  the studies behind the pages of docs, by name (in .venv/bin)'

setup: $(READY) ## .venv with every dependency at a pinned version, and libLLVM where it may install it

# Wheels only, of pinned versions and with the hashes of constraints.txt, the build backend too; then this checkout. The
# stamp is written last, so a broken set-up starts again.
$(READY): pyproject.toml constraints.txt packaging/pins.py .ci/venv .ci/llvm
	.ci/venv .venv
	$(BIN)/python packaging/pins.py 'hagoromo[dev]' build >.venv/pins.txt
	$(BIN)/python $(INSTALL) --require-hashes -r .venv/pins.txt
	$(BIN)/python $(INSTALL) $(OWN)
	.ci/llvm $(BIN)/python
	touch $@

data: $(READY) ## where each set of real data comes from, its licence, and whether its files are the right ones
	$(BIN)/python -m tests.data

demo: $(READY) ## the paper from end to end, into out/demo/report.html
	$(BIN)/hagoromo demo --out out/demo --force --open-page

test: $(READY) ## style, types, layers, and every quick test: what .ci/run and the workflow run
	$(BIN)/ruff check --quiet .
	$(BIN)/ruff format --check --quiet .
	$(BIN)/pyrefly check $(QUIET)
	$(BIN)/lint-imports --no-cache
	$(BIN)/pytest $(TWO) -m "not slow and not nightly"

test-all: $(READY) ## every test that is not slow: those in a browser, with real data and of many seeds, too (every night)
	$(BIN)/pytest $(TWO) -m "not slow"

platforms: $(READY) ## types as on Windows and on macOS: a call that one of them lacks fails
	$(BIN)/pyrefly check $(QUIET) --python-platform win32 $(PACKAGES)
	$(BIN)/pyrefly check $(QUIET) --python-platform darwin $(PACKAGES)

package: $(READY) ## wheel and sdist, into out/package, after the tests that look into both and install the wheel
	$(BIN)/pytest -q tests/app/test_packaging.py
	$(BIN)/python -c 'from hatchling.build import build_sdist, build_wheel; build_sdist("out/package"); build_wheel("out/package")'
	@ls out/package

blender: $(READY) ## the extension for Blender 5, into out/package: docs/howto/blender.md
	$(BIN)/python packaging/extension.py out/package

fuzz: $(READY) ## a quarter of an hour of spoilt files of every kind: each is read, or refused in one line
	$(BIN)/python -m fuzz --minutes 15 --processes 2 --keep out/fuzz

mutants: $(READY) ## numbers of the laws are changed, 200 one at a time; lists what the nearest tests do not notice (hours)
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.mutants --out out/mutants.json

test-slow: $(READY) ## the tests that take minutes
	$(BIN)/pytest $(TWO) -m slow

docs: $(READY) ## the site, into out/docs/index.html, with the examples run; a dead link or an undocumented public name fails
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict
	@echo out/docs/index.html

bench: $(PEERS) ## the march, its growth, its bounds and its peers: docs/performance.md (a quarter of an hour; 6 GiB)
	$(BIN)/python benchmarks/march.py
	$(BIN)/python benchmarks/bound.py
	$(BIN)/python benchmarks/scaling.py
	$(BIN)/python benchmarks/scale.py
	$(BIN)/python benchmarks/matter_memory.py
	$(BIN)/python benchmarks/open_box.py --out out/bench/open_box.json
	$(BIN)/python benchmarks/equal_error.py
	$(BIN)/python benchmarks/orders.py
	$(BIN)/python benchmarks/formats.py
	$(BIN)/python benchmarks/peers.py --out out/bench
	$(BIN)/python benchmarks/page.py

# bpy needs another NumPy, so Cycles has an environment of its own.
cycles: $(READY) ## Blender's Cycles (1 GB) in .venv/cycles, a rival for benchmarks/orders.py
	$(BIN)/python -m venv .venv/cycles
	.venv/cycles/bin/python $(INSTALL) --require-hashes -r benchmarks/cycles.txt

$(PEERS): $(READY)
	$(BIN)/python packaging/pins.py 'hagoromo[bench]' >.venv/peers.txt
	$(BIN)/python $(INSTALL) --require-hashes -r .venv/peers.txt
	touch $@

FIGURES := figure_6_drape figure_6_wing figure_7_skin figure_7_hair figure_8_angel figure_8_nun figure_8_whole

figures: $(READY) ## figures of README and docs/figures.md, into out/figures (half an hour; 8 GiB); MODE=path, PIXELS=3840, WALKS=64, ONLY=figure_7_skin: as hung, into out/stills
ifdef MODE
	[ -f out/demo/results.json ] || $(BIN)/hagoromo demo --out out/demo --force
	$(BIN)/python -m studies.stills examples/recipes --out out/stills --resolution 1 --modes $(MODE) \
	  --only $(or $(ONLY),$(FIGURES)) --pixels $(or $(PIXELS),3840) --samples $(or $(WALKS),64)
else
	$(BIN)/hagoromo demo --out out/figures --size full --force
	$(BIN)/python -m hagoromo_matter.demo.plates out/figures docs
endif

schemas: $(READY) ## the JSON Schemas of all files, into docs/schemas, from the records that read them
	$(BIN)/hagoromo schema --out docs/schemas

crash: $(READY) ## each verb that writes, killed at its file operations, then on a full disk (half an hour)
	$(BIN)/python -m fuzz.crash --most 30
	$(BIN)/python -m fuzz.crash --full

constraints: $(TOOLS)/ready ## constraints.txt anew, with the hashes of every wheel, and packaging/lowest.txt; UPGRADE=1: the newest versions
	$(TOOLS)/bin/python packaging/constraints.py $(if $(UPGRADE),--upgrade)

audit: $(TOOLS)/ready ## known vulnerabilities of what constraints.txt pins, by pip-audit (a minute)
	$(TOOLS)/bin/pip-audit --requirement constraints.txt --require-hashes --disable-pip --progress-spinner off

$(TOOLS)/ready: constraints.txt packaging/pins.py .ci/venv
	.ci/venv $(TOOLS)
	$(TOOLS)/bin/python packaging/pins.py pins >$(TOOLS)/pins.txt
	$(TOOLS)/bin/python $(INSTALL) --require-hashes -r $(TOOLS)/pins.txt
	touch $@

lowest: ## the quick tests with the lowest versions that pyproject.toml allows, in .venv/lowest on Python 3.11
	.ci/venv $(LOWEST)
	$(LOWEST)/bin/python $(INSTALL) --require-hashes -r packaging/lowest.txt
	$(LOWEST)/bin/python $(INSTALL) $(OWN)
	.ci/llvm $(LOWEST)/bin/python
	$(LOWEST)/bin/pytest $(TWO) -m "not slow"
